"""Options of a table: information from the user on its columns that the file does not contain.

    --time-column timestamp      heading or number (from 1) of the column of times; "none": count the rows
    a decode option for "unit"   of its numbers: s, ms, us, ns (protocols/family/decode_options.py, `table_role`)
    --date-order dmy             whether 01/02/2026 is in January (mdy) or in February (dmy)
    --rate 100                   samples per second, where no column has times, or to determine their unit
    --columns FILE               names and units, a line a column: HEADING or NUMBER = NAME (UNIT)

In that file, a line with nothing behind "=" leaves its column out, and "* =" all that no other line names.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from imuscope.recordings.system.regular_file import read_regular
from imuscope.recordings.tables.dates import Order

NO_COLUMN = "none"
OTHERS = "*"  # columns that no line names
_LINE = re.compile(r"^(?P<column>[^=]+?)\s*=\s*(?P<name>.*)$")


@dataclass(frozen=True, slots=True)
class TableOptions:
    """Options of a table; empty where none is given.

    Args:
        columns: heading or number of a column → its heading, "" to leave it out.
    """

    time_column: str = ""
    unit: str = ""
    date_order: Order | None = None
    rate: float = 0.0
    columns: Mapping[str, str] = field(default_factory=dict, hash=False)


def read_columns(path: Path) -> dict[str, str]:
    """Names of columns from a file.

    Raises:
        ValueError: it cannot be read, or a line has no "=".
    """
    try:
        text = read_regular(path.expanduser()).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError):
        raise ValueError(f"{path} cannot be read; give a text file with a line for each column") from None
    columns = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        match = _LINE.match(line.strip())
        if match is None:
            raise ValueError(f"line {number} of {path.name} has no “=”; write HEADING = NAME (UNIT)")
        columns[match["column"]] = match["name"].strip()
    return columns
