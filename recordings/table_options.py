"""Options of a table: information from the user on its columns that the file does not contain.

    --time-column timestamp      heading or number (from 1) of the column of times; "none": count the rows
    a decode option for "unit"   of its numbers: s, ms, us, ns (protocols/decode_options.py, `table_role`)
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

from imuscope.recordings.mcap_writer import RecordingError
from imuscope.recordings.regular_file import read_regular
from imuscope.recordings.table_dates import Order
from imuscope.recordings.table_format import MAX_COLUMNS, TableFormat
from imuscope.recordings.table_headings import ColumnHeading

NO_COLUMN = "none"
OTHERS = "*"
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


def renamed(file: str, form: TableFormat, options: TableOptions) -> tuple[list[str], set[int]]:
    """Headings of the columns, with those of the user in place of the file's; and columns to leave out.

    Raises:
        RecordingError: too many are left.
    """
    texts = list(form.headings) or [""] * form.columns
    left_out = {i for i, text in enumerate(texts) if not text and not any(row[i].strip() for row in form.sample)}
    for i, text in enumerate(list(texts)):
        plain = ColumnHeading.of(text)
        key = next((key for key in (str(i + 1), plain.text, plain.name) if key and key in options.columns), None)
        if key is not None and options.columns[key]:
            texts[i] = options.columns[key]
        elif key is not None or options.columns.get(OTHERS, OTHERS) == "":
            left_out.add(i)
    if len(texts) - len(left_out) > MAX_COLUMNS:
        words = f"{file} has {len(texts)} columns; {MAX_COLUMNS} are read."
        hint = f"Name those to read in a file for --columns: a line “HEADING = NAME” for each, and “{OTHERS} =”."
        raise RecordingError(words, hint)
    return texts, left_out
