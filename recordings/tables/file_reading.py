"""Choices of the user on how a file is read: options of a table, and the clock that is the time axis.

    {"time_column": "timestamp", "unit": "ms"}     in the sidecar of a recording (recordings/sidecar.py)
    {"clock": "arrival"}                                bytes and messages of devices: their arrival, not their own time
    {}                                                  everything as the file itself says

Other keys are absent. The choices win over all that the file seems to say, and options of a command win over them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

from imuscope.recordings.tables.dates import Order
from imuscope.recordings.tables.options import TableOptions

AxisClock = Literal["", "device", "arrival"]
"""The clock of devices that is the axis: "device", that of the device where it has one; "": the usual, the same."""
UNITS = ("s", "ms", "us", "µs", "ns")
LONGEST = 200  # characters of a heading
MOST_COLUMNS = 500
SLOWEST_HZ, FASTEST_HZ = 1e-6, 1e7


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
        table = self.table
        values = {
            "time_column": table.time_column,
            "unit": table.unit,
            "date_order": table.date_order,
            "rate": table.rate,
            "columns": dict(table.columns),
            "clock": self.clock,
        }
        return {name: value for name, value in values.items() if value}


def reading_from(body: Any) -> FileReading | None:
    """Choices in parsed JSON; None if it is none. A value of the wrong type is ignored."""
    if not isinstance(body, Mapping):
        return None
    order, rate, columns = body.get("date_order"), body.get("rate"), body.get("columns")
    unit, clock = _text(body.get("unit")), _text(body.get("clock"))
    is_rate = isinstance(rate, int | float) and math.isfinite(rate) and SLOWEST_HZ <= rate <= FASTEST_HZ
    names = columns.items() if isinstance(columns, Mapping) else ()
    table = TableOptions(
        _text(body.get("time_column")),
        unit if unit in UNITS else "",
        order if order in get_args(Order) else None,
        float(rate) if is_rate and rate is not None else 0.0,
        {key: name for key, name in names if isinstance(key, str) and isinstance(name, str)},
    )
    return FileReading(table, clock if clock in get_args(AxisClock) else "")  # type: ignore[arg-type]


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""


def over(options: TableOptions, stored: TableOptions) -> TableOptions:
    """Options of a command, completed by those stored with a file."""
    columns = {**stored.columns, **options.columns}
    if options.time_column and options.time_column != stored.time_column:
        return replace(options, columns=columns)  # the others are of another column
    has_unit = bool(options.unit or options.rate)
    return TableOptions(
        options.time_column or stored.time_column,
        options.unit if has_unit else stored.unit,
        options.date_order or stored.date_order,
        options.rate if has_unit else stored.rate,
        columns,
    )
