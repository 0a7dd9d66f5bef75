"""A table as it will be read, for the page. recordings/library/table_preview.py makes it from a file."""

from dataclasses import dataclass, field
from typing import Literal

from imuscope.recordings.tables.clock import OpenQuestion
from imuscope.recordings.tables.options import PacketStamp

Role = Literal["time", "clock", "arrival", "value", "left out"]


@dataclass(frozen=True, slots=True)
class PreviewColumn:
    """A column of a table.

    Args:
        number: from 1.
        heading: as in the file.
        name, unit: as it is read.
        group, axis: name of the vector that it belongs to, and its axis; "" for a column of its own.
        role: "time": part of the time axis; "clock": another clock.
    """

    number: int
    heading: str
    name: str
    unit: str
    group: str
    axis: str
    role: Role


@dataclass(frozen=True, slots=True)
class UnitChoice:
    """A unit that the times can have: samples per second in it, null if unknown; whether that is plausible."""

    unit: str
    rate: float | None
    is_plausible: bool


@dataclass(frozen=True, slots=True)
class TablePreview:
    """A table as it will be read.

    Args:
        separator: " " for any run of blanks.
        skipped: lines before the first row.
        clocks: clocks that were found: name → the time column that makes it the axis.
        clock: name of the one that is the axis; "" if none is.
        time_column: that makes it the axis; "none": the rows are counted.
        units: of numbers that are times; [] if there is nothing to choose.
        unit, rate: of the axis; rate null if unknown.
        epoch: what its zero is; "" without an axis.
        sure: "stated", "known", "inferred", "assumed"; "" without an axis.
        sentences: the axis, why it is that, and the assumptions.
        times: of the first rows, unix s; null if unknown.
        rows: the first rows: numbers as they are read, cells of clocks and times as in the file.
        about: open question: "time", "unit", "order", "rate"; "" if the table can be read.
        problem, hint: the refusal in words; "" if it can be read.
        packet_stamp: sample of a packet that has its time; "" if rows have their own.
    """

    separator: str
    decimal: str
    skipped: int
    columns: list[PreviewColumn]
    clocks: dict[str, str]
    clock: str
    time_column: str
    units: list[UnitChoice]
    unit: str
    rate: float | None
    epoch: str
    sure: str
    sentences: list[str]
    times: list[float | None]
    rows: list[list[str | float | None]]
    about: OpenQuestion | Literal[""] = ""
    problem: str = ""
    hint: str = ""
    heading: list[str] = field(default_factory=list)
    packet_stamp: PacketStamp = ""


@dataclass(frozen=True, slots=True)
class TableQuestion:
    """Open question of a table, and the question in words."""

    about: OpenQuestion
    message: str
