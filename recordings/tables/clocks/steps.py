"""Steps of a clock: where it goes back, ahead or stands still, and the time axis that is made of it.

    clock    ╱╱╱╱╱          a step back begins a segment; the axis goes on after a short gap, so that nothing lies
                  ╱╱╱╱╱     over the samples before, and the clock itself stays a column
    axis     ╱╱╱╱╱  ╱╱╱╱╱

A counter that wraps goes on: its period is known. A step ahead stays as it is, because a pause and a clock that was set
look alike; a long one begins a segment too. Rows that are only out of order (the clock returns at once) keep their
times.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.plural import counted
from imuscope.recordings.tables.dates import DAY_S

StepKind = Literal["back", "ahead", "wrap"]

GAP_RATIO = 2.0  # of the length of a gap: the unknown time between two segments is drawn as one
NEXT_ROWS = 8  # rows within which a clock that is only out of order returns
PAUSE_S = 60.0  # a longer step ahead begins a segment; a shorter one is a gap
REPEATED_SHARE = 0.5  # of the rows repeat a time
MOST_STEPS = 10_000
_SIZES = (
    *((2 * size, size, unit) for size, unit in ((86_400.0, "days"), (3600.0, "h"), (60.0, "min"))),
    *((0.1 * size, size, unit) for size, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))),
)
"""From which duration on, s, it is written in which unit."""
WRAPS = tuple(1 << bits for bits in (8, 16, 24, 31, 32))


@dataclass(frozen=True, slots=True)
class StepOfClock:
    """A step.

    Args:
        row: the first row after it, from 0.
        by_s: difference of the clock from the usual step, s.
        before, after: the clock on both sides, s.
    """

    row: int
    kind: StepKind
    by_s: float
    before: float
    after: float


class ClockWatch:
    """Watches a clock, block by block.

    Args:
        usual_s: usual step.
        ahead_s: a longer step is one ahead.
        periods_s: at which the clock may wrap.
    """

    def __init__(self, usual_s: float, ahead_s: float, periods_s: Sequence[float] = ()) -> None:
        self._usual, self._ahead, self._periods = usual_s, ahead_s, periods_s
        self._pending = np.empty(0)
        self._last: float | None = None
        self._left: float | None = None  # the clock before a row that was out of order
        self._shift = 0.0
        self.steps: list[StepOfClock] = []
        self.left_out = 0
        self.shifts: list[tuple[int, float]] = [(0, 0.0)]  # first row, and the sum added to the clock from there on
        self.rows = 0
        self.repeats = 0
        self.out_of_order = 0
        self.first = self.final = self.lowest = self.highest = float("nan")

    def feed(self, times: Floats) -> None:
        """Add the times of further rows, all known."""
        if not len(times):
            return
        if not np.isfinite(self.first):
            self.first = float(times[0])
        self.final = float(times[-1])
        self.lowest = float(np.fmin(self.lowest, times.min()))
        self.highest = float(np.fmax(self.highest, times.max()))
        joined = np.concatenate((self._pending, times))
        ready = max(0, len(joined) - NEXT_ROWS)
        self._take(joined, ready)
        self._pending = joined[ready:]

    def end(self) -> None:
        """Take the last rows."""
        self._take(self._pending, len(self._pending))
        self._pending = np.empty(0)

    @property
    def is_constant(self) -> bool:
        """Whether all of several rows have one time."""
        return self.rows > 1 and self.lowest == self.highest

    @property
    def segments(self) -> list[StepOfClock]:
        """The steps at which a segment begins."""
        return [step for step in self.steps if step.kind == "back" or (step.kind == "ahead" and step.by_s > PAUSE_S)]

    def _take(self, times: Floats, ready: int) -> None:
        """Look at the first `ready` rows; those behind them show how it continues."""
        if not ready:
            return
        before = times[0] if self._last is None else self._last
        steps = np.diff(times[:ready], prepend=before)
        self.repeats += int(np.count_nonzero(steps == 0)) - (self._last is None)
        for row in np.flatnonzero((steps < 0) | (steps > self._ahead)).tolist():
            previous = float(times[row - 1]) if row else float(before)
            self._step(times, row, previous)
        self.rows += ready
        self._last = float(times[ready - 1])

    def _step(self, times: Floats, row: int, previous: float) -> None:
        now = float(times[row])
        by = now - previous - self._usual
        if len(self.steps) >= MOST_STEPS:
            self.left_out += 1
            return
        at = self.rows + row
        if by > 0 and self._left is not None and now - self._left <= self._ahead:
            self._left = None  # the clock is back where it was
            return
        if by > 0:
            self.steps.append(StepOfClock(at, "ahead", by, previous, now))
            return
        period = next((one for one in self._periods if self._wraps(previous, now, one)), None)
        if period is not None:
            self.steps.append(StepOfClock(at, "wrap", -period, previous, now))
            self._shift += period
        elif self._is_out_of_order(times, row, previous):
            self.out_of_order += 1
            self._left = previous
            return
        else:
            self.steps.append(StepOfClock(at, "back", by, previous, now))
            self._shift = previous + self._shift + (GAP_RATIO * self._ahead if np.isfinite(self._ahead) else 1.0) - now
        self.shifts.append((at, self._shift))

    def _wraps(self, previous: float, now: float, period: float) -> bool:
        return now >= 0 and previous <= period and 0 < now + period - previous <= min(self._ahead, period / 2)

    def _is_out_of_order(self, times: Floats, row: int, previous: float) -> bool:
        back = previous - float(times[row])
        after = times[row : row + NEXT_ROWS]
        jumps = np.diff(after)
        return bool(len(jumps)) and bool(((after[1:] > previous) & (jumps > 0.5 * back + 0.5 * self._usual)).any())


def shifted(times: Floats, first_row: int, shifts: Sequence[tuple[int, float]]) -> Floats:
    """Times of rows from `first_row` on, on the axis."""
    if len(shifts) == 1:
        return times + shifts[0][1] if shifts[0][1] else times
    rows = np.array([row for row, _ in shifts])
    by = np.array([shift for _, shift in shifts])
    moved: Floats = times + by[np.searchsorted(rows, np.arange(first_row, first_row + len(times)), "right") - 1]
    return moved


def periods_of(factor: float, kind: str, epoch: str) -> tuple[float, ...]:
    """Periods at which a clock of that unit may wrap, s."""
    if epoch == "day":
        return (DAY_S,)
    if epoch == "week":
        return (7 * DAY_S,)
    if kind == "text" and epoch == "start":
        return (3600.0,)
    if kind == "counter":
        return tuple(count * factor for count in WRAPS)
    return tuple(count * factor for count in WRAPS[1:]) if kind == "number" and epoch == "start" else ()


def step_words(step: StepOfClock, name: str) -> str:
    size = duration_text(abs(step.by_s))
    match step.kind:
        case "back":
            return f"{name} goes back by {size} at row {step.row + 1}: a new segment begins there."
        case "ahead":
            return f"{name} goes ahead by {size} at row {step.row + 1}: samples are missing, or the clock was set."
        case "wrap":
            return f"{name} wraps after {size} at row {step.row + 1}; it is continued."


def duration_text(seconds: float) -> str:
    """A duration with the precision that it has."""
    for least, size, unit in _SIZES:
        if seconds >= least:
            return f"{seconds / size:.6g} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def repeats_words(watch: ClockWatch, name: str) -> str:
    """A sentence on rows that repeat the time of the one before; "" if there are none."""
    if not watch.repeats:
        return ""
    words = f"{name}: {counted(watch.repeats, 'row repeats', 'rows repeat')} the time of the row before"
    if watch.repeats < REPEATED_SHARE * watch.rows:
        return f"{words}."
    return f"{words}: it is coarser than the samples. Where their rate is known, --time-column none --rate counts them."
