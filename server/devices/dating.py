"""UTC of samples, as far as a device says it.

    UtcTime        12:00:00.0          12:00:01.0        in some messages
    device clock   70.0  70.1  70.2 …  71.0  71.1        in all
    UTC            .0    .1    .2      1.0   1.1         what the last one said, and the device's clock since

Where the clock stepped, nothing is known until the next one says it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from protocols.dates import UNKNOWN
from protocols.events import Batch, ClockStep

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Dating:
    """Of one device during one connection.

    Args:
        utc: of the protocol (registry.ProtocolInfo).
    """

    def __init__(self, utc: Callable[[Batch], Ints | None]) -> None:
        self._utc = utc
        self._ahead_ns: int | None = None  # UTC less device time, by the last sample that said it

    def of(self, batches: Sequence[Batch], steps: Sequence[ClockStep]) -> list[Floats | None]:
        """UTC of the samples of a drain, unix s, NaN where it is not known; None for a batch of which none is."""
        own = [self._utc(batch) for batch in batches]
        if self._ahead_ns is None and all(one is None for one in own):
            return [None] * len(batches)
        edges, ahead = self._told(batches, own, steps)
        out: list[Floats | None] = []
        for batch, said in zip(batches, own, strict=True):
            utc = np.full(len(batch), np.nan)
            if batch.time_ns is not None:
                by = ahead[np.searchsorted(edges, batch.offset, "right")]
                utc = np.where(np.isnan(by), np.nan, (batch.time_ns + np.nan_to_num(by).astype(np.int64)) / 1e9)
            if said is not None:
                utc = np.where(said == UNKNOWN, utc, said / 1e9)
            out.append(None if np.isnan(utc).all() else utc)
        last = ahead[-1]
        self._ahead_ns = None if np.isnan(last) else int(last)
        return out

    def _told(
        self, batches: Sequence[Batch], own: Sequence[Ints | None], steps: Sequence[ClockStep]
    ) -> tuple[Ints, Floats]:
        """Places in the stream, ascending, and how far UTC is ahead of the device's clock before the first of them and
        from each on; NaN where that is not known."""
        places = [np.array([step.offset for step in steps], np.int64)]
        values = [np.full(len(steps), np.nan)]
        for batch, said in zip(batches, own, strict=True):
            if said is not None and batch.time_ns is not None:
                which = said != UNKNOWN
                places.append(batch.offset[which])
                values.append((said[which] - batch.time_ns[which]).astype(np.float64))
        joined = np.concatenate(places)
        order = np.argsort(joined, kind="stable")
        first = np.nan if self._ahead_ns is None else float(self._ahead_ns)
        return joined[order], np.concatenate(([first], np.concatenate(values)[order]))
