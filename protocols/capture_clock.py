"""Time of a capture: the device's clock, exactly.

    device   ──┬── stretch 1: + offset 1 ──┬── stretch 2: + offset 2 ──      a stretch ends where the clock stepped
    arrival  ──┴── made from the same clock by recordings/capture_timing.py ─────

Where nobody noted when the bytes came, there is nothing to learn from arrivals: they were made from the device's own
clock. So a time is the device's plus one offset, found at the first rows and kept: spacing, rate and length are those
of the device, to the nanosecond, whatever else the stream carries (a GNSS solution stamped a moment earlier keeps its
earlier time). Only where the clock steps, and the times of arrival did not go along, a new offset is found.

Two captures of one device can be laid over each other by this; two devices in one capture have an offset each.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from protocols.clock_sync import ClockSync, TimedRows

Floats = NDArray[np.float64]

ASTRAY_NS = 500_000_000  # at a step: rows that are so far from where the offset puts them have another


class CaptureClock(ClockSync):
    """`ClockSync` where the times of arrival say nothing of their own.

    Attributes:
        breaks: always empty: steps are told by the decoder.
    """

    def __init__(self) -> None:
        super().__init__()
        self._offset: int | None = None
        self._steps: list[int] = []

    def stepped(self, offsets: Sequence[int]) -> None:
        """Where in the stream the clock stepped, ascending; before `times` of the rows around them."""
        self._steps += offsets

    def restart(self) -> None:
        """Find the offset anew."""
        self._offset = None

    def times(self, parts: Sequence[TimedRows]) -> list[Floats]:
        """Times of the rows of each part that has any, unix s."""
        parts = [part for part in parts if len(part.device)]
        if not parts:
            return []
        out = [np.empty(len(part.device)) for part in parts]
        edges = [edge for edge in self._steps if edge <= max(_end(part) for part in parts)]
        self._steps = self._steps[len(edges) :]
        begin = [0] * len(parts)
        for edge in [*edges, None]:
            stops = [len(part.device) if edge is None else _before(part, edge) for part in parts]
            self._stretch(parts, [slice(*pair) for pair in zip(begin, stops, strict=True)], out)
            begin = stops
            if edge is not None:
                rest = [part.rows(slice(at, None)) for part, at in zip(parts, begin, strict=True)]
                self._anchor([part for part in rest if len(part.device)])
        return out

    def _stretch(self, parts: Sequence[TimedRows], rows: Sequence[slice], out: Sequence[Floats]) -> None:
        some = [part.rows(which) for part, which in zip(parts, rows, strict=True) if which.start < which.stop]
        if not some:
            return
        if self._offset is None:
            self._offset = _offset(some)
            self.restarts += 1
        for part, which, times in zip(parts, rows, out, strict=True):
            times[which] = (part.device[which] + self._offset) / 1e9

    def _anchor(self, rest: Sequence[TimedRows]) -> None:
        """The clock stepped before these rows: they have another offset, unless the arrivals went along (a pause)."""
        if rest and self._offset is not None and abs(_offset(rest) - self._offset) > ASTRAY_NS:
            self._offset = None


def _offset(parts: Sequence[TimedRows]) -> int:
    """Arrival less device time, by the message with most rows: by that the times of arrival were made."""
    busiest = max(parts, key=lambda part: len(part.device))
    return int(busiest.arrival[0] - busiest.device[0])


def _before(part: TimedRows, edge: int) -> int:
    """How many rows of a part lie before a place in the stream."""
    return len(part.device) if part.offset is None else int(np.searchsorted(part.offset, edge))


def _end(part: TimedRows) -> int:
    return 0 if part.offset is None else int(part.offset[-1])
