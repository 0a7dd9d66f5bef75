"""Time of a capture: exactly the device's clock, plus an offset.

    device   ──┬── stretch 1: + offset 1 ──┬── stretch 2: + offset 2 ──      a stretch ends where the clock stepped
    arrival  ──┴── derived from the same clock by recordings/capture_timing.py ──

In a capture without arrival times, arrivals carry no information: they were derived from the device's own clock. So a
time is the device's plus one offset, found at the first rows and kept: spacing, rate and length are those of the
device, to the nanosecond, whatever else the stream carries (a GNSS solution stamped earlier keeps its earlier time). A
new offset is found only where the clock steps and the arrivals do not follow.

Two captures of one device can thus be overlaid; two devices in one capture have an offset each.
"""

from collections.abc import Sequence

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.clocks.clock_sync import ClockSync, TimedRows

ASTRAY_NS = 500_000_000  # at a step: rows this far from the time by the offset get a new one


class CaptureClock(ClockSync):
    """`ClockSync` for arrival times that carry no information of their own.

    Attributes:
        discontinuities: always empty: the decoder reports steps.
    """

    def __init__(self) -> None:
        super().__init__()
        self._offset: int | None = None
        self._steps: list[int] = []

    def stepped(self, offsets: Sequence[int]) -> None:
        """Stream positions of clock steps, ascending; before `map_to_host` of the rows around them."""
        self._steps += offsets

    def restart(self) -> None:
        """Find the offset again."""
        self._offset = None

    def map_to_host(self, parts: Sequence[TimedRows]) -> list[Ints]:
        """Times of the rows of each non-empty part, unix ns."""
        parts = [part for part in parts if len(part.device)]
        if not parts:
            return []
        out = [np.empty(len(part.device), np.int64) for part in parts]
        edges = [edge for edge in self._steps if edge <= max(_end(part) for part in parts)]
        self._steps = self._steps[len(edges) :]
        begin = [0] * len(parts)
        for edge in [*edges, None]:
            stops = [len(part.device) if edge is None else _before(part, edge) for part in parts]
            self._segment(parts, [slice(*pair) for pair in zip(begin, stops, strict=True)], out)
            begin = stops
            if edge is not None:
                rest = [part.rows(slice(at, None)) for part, at in zip(parts, begin, strict=True)]
                self._anchor([part for part in rest if len(part.device)])
        return out

    def _segment(self, parts: Sequence[TimedRows], rows: Sequence[slice], out: Sequence[Ints]) -> None:
        some = [part.rows(which) for part, which in zip(parts, rows, strict=True) if which.start < which.stop]
        if not some:
            return
        if self._offset is None:
            self._offset = _offset(some)
            self.restarts += 1
        for part, which, times in zip(parts, rows, out, strict=True):
            times[which] = part.device[which] + self._offset

    def _anchor(self, rest: Sequence[TimedRows]) -> None:
        """Find the offset of the rows after a step, unless the arrivals went along (a pause)."""
        if rest and self._offset is not None and abs(_offset(rest) - self._offset) > ASTRAY_NS:
            self._offset = None


def _offset(parts: Sequence[TimedRows]) -> int:
    """Arrival less device time, by the message with most rows, from which the arrivals were derived."""
    busiest = max(parts, key=lambda part: len(part.device))
    return int(busiest.arrival[0] - busiest.device[0])


def _before(part: TimedRows, edge: int) -> int:
    """Number of rows of a part before a position in the stream."""
    return len(part.device) if part.offset is None else int(np.searchsorted(part.offset, edge))


def _end(part: TimedRows) -> int:
    return 0 if part.offset is None else int(part.offset[-1])
