"""Time axis of a table: the clock it is made of, its date, and the steps that were found in it.

`TimeAxis.sentences` describes all of it in words; `TimeAxis.described` is stored with the recording.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.registry.families import unit_flag
from imuscope.protocols.schema.plural import counted
from imuscope.recordings.tables.clock import TableClock
from imuscope.recordings.tables.clocks.packets import PacketSpread
from imuscope.recordings.tables.clocks.steps import ClockWatch, repeats_words, shifted
from imuscope.recordings.tables.dates import DAY_S, dated_name
from imuscope.recordings.tables.format import TableFormat
from imuscope.recordings.tables.time_units import (
    RATE_TOLERANCE,
    UNSORTED_SHARE,
    in_order,
    rate_text,
    row_step,
    usual_step,
)

MIN_STEP_AHEAD_S, STEP_AHEAD_SPREAD = 5.0, 3.0
HOUR = 3600.0
HEAD = "the head of the file"
LAST_CHANGE = "the file's last change"
NAME = "the file's name"
FEWEST_STEPS = 8  # in a sample, to speak of an order
EQUAL_STEPS_SHARE = 0.5  # of the steps ahead are nearly equal: not of rows without order
NEARLY_ALL = 0.9  # of the steps: a logger that writes in bursts has some long ones
EPOCHS = {
    "1970": "since 1970 (UTC)",
    "GPS": "of GPS, shown as UTC",
    "week": "of a GPS week that is not in the file",
    "day": "of a day that is not in the file",
    "start": "since the start of the device",
}
CERTAINTY_TEXTS = {
    "stated": "",
    "known": "",
    "inferred": "; to change it: {flag}",
    "assumed": ", which is not sure; to change it: {flag}",
}


@dataclass
class TimeAxis:
    """The axis.

    Args:
        others: clocks that stay columns.
        origin: added to the clock's times, s.
        dated_by: what the origin comes from; "" for a clock that has the date itself.
        head_rate: sampling rate in the head of the file, Hz; 0 if there is none.
        decimal: sign of its numbers.
        options: name of a clock → option that makes it the axis.
        order: of the rows in the file: "" ascending, else the words on it; they are read by their times.
        packets: the times of rows that share one; None if they have their own.
    """

    clock: TableClock
    others: Sequence[TableClock]
    origin: float
    dated_by: str
    usual_s: float
    head_rate: float = 0.0
    decimal: str = "."
    options: Mapping[str, str] = field(default_factory=dict)
    watch: ClockWatch | None = None
    order: str = ""
    packets: PacketSpread | None = None

    @property
    def keeps_clock(self) -> bool:
        """Whether the axis differs from the clock, so that the clock is a column of its own."""
        return self.packets is not None or (self.watch is not None and len(self.watch.shifts) > 1)

    def times(self, clock: Floats, first_row: int) -> Floats:
        """Unix s of rows from `first_row` on, all known."""
        shifts = self.watch.shifts if self.watch is not None else ()
        own = clock if self.packets is None else self.packets.times(first_row, len(clock))
        return (shifted(own, first_row, shifts) if shifts else own) + self.origin

    def at(self, row: int, clock: float) -> float:
        """Unix s of a row with that clock."""
        return float(self.times(np.array([clock]), row)[0])

    @property
    def name(self) -> str:
        return self.clock.name or "the time"

    @property
    def clocks(self) -> list[str]:
        """Names of the clocks that may be columns."""
        return [self.name, *(one.name for one in self.others)]

    def sentences(self) -> list[str]:
        """The clock, its unit, why, and its date; then repeats and out-of-order rows."""
        clock = self.clock
        unit = f" in {clock.unit}" if clock.unit else ""
        why = f" ({clock.why}{CERTAINTY_TEXTS[clock.sure].format(flag=unit_flag())})" if clock.why else ""
        rate = f", {rate_text(1 / self.usual_s)}" if self.usual_s else ""
        if clock.kind == "rows":
            texts = [f"The time axis counts the rows{rate} ({clock.why})."]
        else:
            since = "shown as UTC" if clock.zero_s else EPOCHS[clock.epoch]
            texts = [f"The time axis is {self.name}{unit}, {since}{rate}{why}."]
        if self.head_rate and self.usual_s and abs(self.head_rate * self.usual_s - 1) > RATE_TOLERANCE:
            texts.append(f"The head of the file names another rate, {rate_text(self.head_rate)}.")
        if self.decimal == ",":
            texts.append("Numbers are read with a decimal comma.")
        if self.dated_by:
            texts.append(f"Its date is that of {self.dated_by}.")
        if self.others:
            texts.append(f"Other clocks are columns: {', '.join(self.clocks[1:])}.")
        if self.order:
            texts.append(f"The rows {self.order}; they are read in the order of their times.")
        if self.watch is not None:
            repeats = repeats_words(self.watch, self.name) if self.packets is None else self.packets.words(self.name)
            texts += filter(None, [repeats])
            if self.watch.out_of_order:
                rows = counted(self.watch.out_of_order, "row is", "rows are")
                texts.append(f"{self.name}: {rows} out of order, with the time as it is in the file.")
        return texts

    def described(self) -> dict[str, Any]:
        """For the manifest of a store, and programs."""
        clock, watch = self.clock, self.watch
        return {
            "axis": self.name,
            "kind": clock.kind,
            "unit": clock.unit,
            "epoch": clock.epoch,
            "sure": clock.sure,
            "why": clock.why,
            "dated_by": self.dated_by,
            "rate": 1 / self.usual_s if self.usual_s else None,
            "others": self.clocks[1:],
            "units": {one.name: one.unit or "s" for one in self.others if not one.is_open},
            "options": dict(self.options),
            "repeats": watch.repeats if watch is not None else 0,
            "out_of_order": watch.out_of_order if watch is not None else 0,
            "sentences": self.sentences(),
        }


def order_words(times: Floats) -> str:
    """Words on the order of rows with these times; "" if they ascend. A clock that wraps or is set goes back, too, but
    runs evenly between, and has each time often.
    """
    steps = np.diff(times)
    back, forward = steps < 0, steps[steps > 0]
    if len(steps) < FEWEST_STEPS or back.mean() <= UNSORTED_SHARE:
        return ""
    if back.mean() > NEARLY_ALL or not len(forward):
        return "run backwards"
    is_even = bool((np.abs(forward - np.median(forward)) <= np.median(forward) / 2).mean() > EQUAL_STEPS_SHARE)
    return "" if is_even or len(np.unique(times)) < len(times) / 2 else "are out of order"


def step_limits(times: Floats) -> tuple[float, float]:
    """Step from row to row of the sample, and the length from which a step is one ahead, s."""
    forward = np.diff(in_order(times))
    forward = forward[forward > 0]
    most = float(np.quantile(forward, NEARLY_ALL)) if len(forward) else 0.0
    ahead = max(MIN_STEP_AHEAD_S * usual_step(times), STEP_AHEAD_SPREAD * most) or np.inf
    return row_step(times), ahead


def origin_of(clock: TableClock, first: float, form: TableFormat, path: Path) -> tuple[float, str]:
    """Offset that makes unix s of the times of a clock, and the source of its date.

    Args:
        first: the first time of the clock, s.
    """
    if clock.epoch in ("1970", "GPS"):
        return 0.0, ""
    written = path.stat().st_mtime
    named, start, day = dated_name(path.name), form.started, form.day
    if clock.epoch == "start":
        if start is not None:
            return start - first, HEAD
        if day is not None and (named is None or named // DAY_S != day // DAY_S):
            written_then = written - first if written // DAY_S == day // DAY_S else day - first
            return written_then, f"{HEAD}, which has no time of day"
        return (named - first, NAME) if named is not None else (written - first, LAST_CHANGE)
    known, by = (named, NAME) if named is not None else (written, LAST_CHANGE)
    if clock.epoch == "day" and start is not None:
        return round((start - first) / DAY_S) * DAY_S, HEAD
    if clock.epoch == "day" and day is not None:
        return day, HEAD
    return period_start(clock.epoch, first, known, written), by


def period_start(kind: str, first: float, known: float, written: float) -> float:
    """Unix s of the begin of a "day" or a "week" of GPS.

    Args:
        first: time in it of the first sample, s.
        known: a time of the file, unix s.
        written: its last change.
    """
    if kind == "day":
        midnight = float(np.floor(known / DAY_S) * DAY_S)
        return midnight if midnight + first <= written + HOUR else midnight - DAY_S
    week = 7 * DAY_S
    sunday = float(np.floor((known - 3 * DAY_S) / week) * week + 3 * DAY_S)  # 1970-01-01 was a Thursday
    return (sunday if sunday + first <= known + DAY_S else sunday - week) - 18.0
