"""UTC of samples, as far as a device reports it.

    UtcTime        12:00:00.0          12:00:01.0        in some messages
    device clock   70.0  70.1  70.2 …  71.0  71.1        in all messages
    UTC            .0    .1    .2      1.0   1.1         the last reported UTC plus the device time since

After a step of the device clock, UTC is unknown until the next report.
"""

from collections.abc import Callable, Sequence

import numpy as np

from imuscope.protocols.arrays import Floats, Ints
from imuscope.protocols.clocks.dates import UNKNOWN
from imuscope.protocols.events import Batch, ClockStep


class Dating:
    """UTC of one device during one connection.

    Args:
        utc: UTC of a batch, by the protocol (registry.ProtocolInfo).
    """

    def __init__(self, utc: Callable[[Batch], Ints | None]) -> None:
        self._utc = utc
        self._ahead_ns: int | None = None  # UTC minus device time, of the last report

    def utc_of(self, batches: Sequence[Batch], steps: Sequence[ClockStep]) -> list[Floats | None]:
        """UTC of the samples of a drain, unix s, NaN where unknown; None for a batch without any known UTC."""
        own = [self._utc(batch) for batch in batches]
        if self._ahead_ns is None and all(one is None for one in own):
            return [None] * len(batches)
        edges, ahead = self._offsets_from_device_time(batches, own, steps)
        out: list[Floats | None] = []
        for batch, utc_values in zip(batches, own, strict=True):
            utc = np.full(len(batch), np.nan)
            if batch.time_ns is not None:
                offset_ns = ahead[np.searchsorted(edges, batch.offset, "right")]
                utc = np.where(
                    np.isnan(offset_ns), np.nan, (batch.time_ns + np.nan_to_num(offset_ns).astype(np.int64)) / 1e9
                )
            if utc_values is not None:
                utc = np.where(utc_values == UNKNOWN, utc, utc_values / 1e9)
            out.append(None if np.isnan(utc).all() else utc)
        last = ahead[-1]
        self._ahead_ns = None if np.isnan(last) else int(last)
        return out

    def _offsets_from_device_time(
        self, batches: Sequence[Batch], own: Sequence[Ints | None], steps: Sequence[ClockStep]
    ) -> tuple[Ints, Floats]:
        """Offsets in the stream, ascending, and UTC minus device time before the first and from each of them on; NaN
        where unknown.
        """
        places = [np.array([step.offset for step in steps], np.int64)]
        values = [np.full(len(steps), np.nan)]
        for batch, utc_values in zip(batches, own, strict=True):
            if utc_values is not None and batch.time_ns is not None:
                which = utc_values != UNKNOWN
                places.append(batch.offset[which])
                values.append((utc_values[which] - batch.time_ns[which]).astype(np.float64))
        joined = np.concatenate(places)
        order = np.argsort(joined, kind="stable")
        first = np.nan if self._ahead_ns is None else float(self._ahead_ns)
        return joined[order], np.concatenate(([first], np.concatenate(values)[order]))
