"""Clock of a table, and the questions that a table leaves open."""

from dataclasses import dataclass
from typing import Literal

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.tables.dates import Order
from imuscope.recordings.tables.time_units import UnitReading

Kind = Literal["number", "text", "date+time", "parts", "week", "utc", "counter", "rows"]
Epoch = Literal["1970", "GPS", "week", "day", "start"]
Sure = Literal["stated", "known", "inferred", "assumed"]
FEWEST_ROWS, MOST_TIMES = 20, 2  # rows, with no more different times than that: the clock stood, or lost its digits
OpenQuestion = Literal["time", "unit", "order", "rate"]
"""What a file leaves open: its column of times, their unit, day or month first, or a rate that fits."""


@dataclass(frozen=True, slots=True)
class TableClock:
    """A clock of a table.

    Args:
        name: its headings.
        columns: their places.
        unit: "ms"; "" for text and for a unit that is open.
        factors: s per number of each column.
        epoch: what its zero is: "week" and "day" lack the date, "start" is that of the device or the program.
        sure: "stated" by the file or the user, "known" from the form, "inferred" from the numbers, "assumed".
        why: the reason, as an end of a sentence.
        readings: of a unit that is open.
        rank: before others, least first.
        zone: by which a text without a zone is ahead of UTC, s.
        part: s per number of the last column, which is a part of a second; 0 if it is not one.
        base: of the digits.
    """

    name: str
    columns: tuple[int, ...]
    kind: Kind
    unit: str = ""
    factors: tuple[float, ...] = (1.0,)
    epoch: Epoch = "1970"
    sure: Sure = "known"
    why: str = ""
    order: Order = "dmy"
    readings: tuple[UnitReading, ...] = ()
    rank: int = 5
    zone: float = 0.0
    zero_s: float = 0.0  # unix s of its zero, if that is another date
    part: float = 0.0
    base: int = 10

    @property
    def is_open(self) -> bool:
        """Whether its unit is not known."""
        return not self.factors and self.kind in ("number", "counter")


class AmbiguousTableError(RecordingError):
    """Refusal of a table that can be read in more than one way, or in none without an option.

    Args:
        clock: whose unit is open, if that is the question.
    """

    def __init__(self, message: str, hint: str, about: OpenQuestion, clock: TableClock | None = None) -> None:
        super().__init__(message, hint)
        self.about, self.clock = about, clock


def few_times(file: str, name: str, times: int, rows: int, written: str = "") -> AmbiguousTableError:
    """Refusal of a table, many rows of which have one or two times."""
    what = "all have the same time" if times == 1 else f"have {times} different times"
    hint = "Write its times with more digits, name another column with --time-column, or count the rows with "
    words = f"{file}: {rows} rows {what} in {name}{written}."
    return AmbiguousTableError(words, f"{hint}--time-column none --rate HZ.", "time")
