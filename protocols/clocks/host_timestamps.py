"""Time of samples that carry the time of a host's clock: their stamps, as they are.

A stamp that goes back a little (messages that overtook each other) repeats the last time of its message, because times
that a page has drawn never decrease. The decoder has left out stamps of another clock (protocols/messages/decoder.py).
"""

from collections.abc import Sequence

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.clocks.clock_sync import ClockSync, TimedRows

MOST_SOURCES = 1024


class StampClock(ClockSync):
    """`ClockSync` for times that need no mapping. Its uncertainty and drift are unknown: no one measures them."""

    def __init__(self) -> None:
        super().__init__()
        self._newest: dict[int, int] = {}

    def map_to_host(self, parts: Sequence[TimedRows]) -> list[Ints]:
        """Times of the rows of each part, unix ns."""
        self.discontinuities = []
        out = []
        for part in parts:
            if len(self._newest) > MOST_SOURCES:
                self._newest.clear()
            times = np.maximum.accumulate(part.device)
            times = np.maximum(times, self._newest.get(part.source, 0))
            if len(times):
                self._newest[part.source] = int(times[-1])
            out.append(times)
        return out
