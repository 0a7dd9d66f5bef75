"""Clock of a table, and what the headings of columns with times say."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from imuscope.recordings.mcap_writer import RecordingError
from imuscope.recordings.table_dates import Order
from imuscope.recordings.table_headings import ColumnHeading
from imuscope.recordings.time_units import LONG, SPELLINGS, UnitReading

Kind = Literal["number", "text", "date+time", "parts", "week", "utc", "counter", "rows"]
Epoch = Literal["1970", "GPS", "week", "day", "start"]
Sure = Literal["stated", "known", "inferred", "assumed"]
OpenQuestion = Literal["time", "unit", "order", "rate"]
"""What a file leaves open: its column of times, their unit, day or month first, or a rate that fits."""

TIMES = ("time", "timestamp", "t", "date", "datetime", "utc")
FINE, FINE_S, FINE_DOT_S = "sample_time_fine", 1e-4, 1e-6  # of an MTi, and of a DOT
COUNTERS = ("packet_counter", "counter", "sample_counter", "sample_number", "sample", "samples")
UTC_PARTS = ("year", "month", "day", "hour", "minute", "second", "nano")
GPS_EPOCH = 315_964_800.0
WEEK = 604_800.0
NO_UNIT = re.compile(r"utc|gps|gnss|local|unix|epoch|boot|ros|iso|rfc|:|date|time|since")  # in the brackets of a time
DECIMALS = re.compile(r"[.,]\d")
FEWEST = 3  # rows whose steps say something
_STEMS = "time|timestamp|stamp|datetime|t|ts|clock|elapsed|uptime|epoch"
_BEFORE = (
    "sensor|system|sys|device|dev|host|unix|gps|gnss|utc|log|local|elapsed|boot|sample|rec|record|ros|imu|header|msg|"
    "field|wall|phone|cpu|mcu|since|arrival"
)
_AFTER = "|".join(SPELLINGS) + "|utc|elapsed|boot|sample|unix|epoch"
TIME = re.compile(rf"^(?:(?:{_BEFORE})_)*(?:{_STEMS})(?:_(?:{_AFTER}))*$")
ELAPSED = re.compile(rf"^(?:elapsed_)?(?:{'|'.join(one for one in SPELLINGS if len(one) > 3)})(?:_elapsed)?$")
OF_WEEK = ("time_of_week", "i_tow", "itow", "tow", "gps_tow", "gps_time_of_week")
INERTIAL = re.compile(
    r"acc(?!ur|ou|es|ep|um)|gyr|angular|omega|imu|^[ag][ _.]?[xyz]$|^[aw]_rs|pqr|uvw|quat|attitude|roll|pitch",
    re.IGNORECASE,
)


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
    """

    name: str
    columns: tuple[int, ...]
    kind: Kind
    unit: str
    factors: tuple[float, ...]
    epoch: Epoch
    sure: Sure
    why: str
    order: Order = "dmy"
    readings: tuple[UnitReading, ...] = ()
    rank: int = 5

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


def words_of(name: str) -> str:
    """A heading in lower case with _ between its words: timeOfWeekMs is time_of_week_ms."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.strip())
    return re.sub(r"[^0-9a-zµμ%]+", "_", spaced.lower()).strip("_")


def named_unit(heading: ColumnHeading) -> str:
    """Unit that the heading of a time names, "" for none."""
    text = heading.unit.strip().lower()
    if unit := SPELLINGS.get(text) or LONG.get(text, ""):
        return unit
    words = [word for word in words_of(heading.name).split("_") if word in SPELLINGS]
    return SPELLINGS[words[-1]] if words else ""


def has_odd_unit(heading: ColumnHeading) -> bool:
    """Whether the brackets of a heading name a unit that is not known: ticks, counts."""
    text = heading.unit.strip().lower()
    return bool(text) and not named_unit(heading) and not NO_UNIT.search(text)


def without_unit(words: str) -> str:
    stem, _, last = words.rpartition("_")
    return stem if last in SPELLINGS else words


def is_plain(heading: ColumnHeading) -> bool:
    words = words_of(heading.name)
    return words in TIMES or without_unit(words) in TIMES or heading.name.startswith("__")
