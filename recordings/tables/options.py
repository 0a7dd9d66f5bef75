"""Choices of the user on how a file is read, which win over all that the file seems to say.

    --time-column timestamp      heading or number (from 1) of the column of times; "none": count the rows
    a decode option for "unit"   of its numbers: s, ms, us, ns (protocols/family/decode_options.py, `table_role`)
    --date-order dmy             whether 01/02/2026 is in January (mdy) or in February (dmy)
    --rate 100                   samples per second, where no column has times, or to determine their unit
    --packet-stamp last          which sample of a packet has its time, where several rows share one (first or last)
    --columns FILE               names and units, a line a column: HEADING or NUMBER = NAME (UNIT)

In that file, a line with nothing behind "=" leaves its column out, and "* =" all that no other line names.

A sidecar of a recording (recordings/sidecar.py) stores them; options of a command win over it:

    {"time_column": "timestamp", "unit": "ms"}     options of a table by their names; others are absent
    {"clock": "arrival"}                           bytes and messages of devices: their arrival, not their own time
"""

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

from imuscope.recordings.system.regular_file import read_regular
from imuscope.recordings.tables.dates import Order

AxisClock = Literal["", "device", "arrival"]
"""The clock of devices that is the axis: "device", that of the device where it has one; "": the usual, the same."""
PacketStamp = Literal["", "first", "last"]
"""Which sample of a packet has its time; "": as the table suggests."""
NO_COLUMN = "none"
OTHERS = "*"  # columns that no line names
UNITS = ("s", "ms", "us", "µs", "ns")
MAX_HEADING_CHARS = 200  # characters of a heading
MOST_COLUMNS = 500
SLOWEST_HZ, FASTEST_HZ = 1e-6, 1e7
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
    packet_stamp: PacketStamp = ""


@dataclass(frozen=True, slots=True)
class FileReading:
    """The choices for one file."""

    table: TableOptions = field(default_factory=TableOptions)
    clock: AxisClock = ""

    def __bool__(self) -> bool:
        """Whether anything is chosen."""
        return bool(self.as_json())

    def as_json(self) -> dict[str, Any]:
        """For files: the values that are chosen."""
        values = {**asdict(self.table), "clock": self.clock}
        return {name: value for name, value in values.items() if value}


def reading_from(body: Any) -> FileReading | None:
    """Choices in parsed JSON; None if it is not one. A value of the wrong type is ignored."""
    if not isinstance(body, Mapping):
        return None

    def one_of(name: str, choices: tuple[str, ...]) -> Any:
        value = body.get(name)
        return value if isinstance(value, str) and value in choices else ""

    column, rate, columns = body.get("time_column"), body.get("rate"), body.get("columns")
    is_rate = isinstance(rate, int | float) and math.isfinite(rate) and SLOWEST_HZ <= rate <= FASTEST_HZ
    names = columns.items() if isinstance(columns, Mapping) else ()
    table = TableOptions(
        column if isinstance(column, str) else "",
        one_of("unit", UNITS),
        one_of("date_order", get_args(Order)) or None,
        float(rate) if is_rate and rate is not None else 0.0,
        {key: name for key, name in names if isinstance(key, str) and isinstance(name, str)},
        one_of("packet_stamp", get_args(PacketStamp)),
    )
    return FileReading(table, one_of("clock", get_args(AxisClock)))


def over(options: TableOptions, stored: TableOptions) -> TableOptions:
    """Options of a command, completed by those stored with a file."""
    columns = {**stored.columns, **options.columns}
    if options.time_column and options.time_column != stored.time_column:
        return replace(options, columns=columns)  # the other choices belong to another column
    has_unit = bool(options.unit or options.rate)
    return TableOptions(
        options.time_column or stored.time_column,
        options.unit if has_unit else stored.unit,
        options.date_order or stored.date_order,
        options.rate if has_unit else stored.rate,
        columns,
        options.packet_stamp or stored.packet_stamp,
    )


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
