"""Boundaries and arrival times of the chunks of a stream; the last byte of a chunk has the least delay.

An adapter passes on 62 bytes when it has them, regardless of frames. The bytes after them wait for the next packet:

    on the line    ──frame──┐┌──────frame──────┐      ┌──frame──
    passed on         62 bytes │ 62 bytes │ the rest waits …
                               └ here: these bytes were sent just now

So the frame in which a chunk ends is timed twice: by its last byte, which may have waited, and by the last of its bytes
in the chunk before, whose place in the frame, and so its time on the line, is known. On any link, neither arrived
before it was sent: the earlier of the two estimates is the better (clock_model.py).

Source: FTDI, AN232B-04 "Data Throughput, Latency and Handshaking", section 3.2.
"""

from bisect import bisect_right
from collections.abc import Iterable

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.clocks.kernels import earliest_sent

SEARCHED_CHUNKS = 64  # chunks that cost less to convert than to search


class ChunkBoundaries:
    """Ends of the chunks of one stream, positions in bytes since it began, and their arrivals in unix ns."""

    def __init__(self) -> None:
        self._ends: list[int] = []
        self._arrivals: list[int] = []

    def __len__(self) -> int:
        return len(self._ends)

    def add(self, end: int, arrival_ns: int) -> None:
        """Add one chunk; positions ascend."""
        self._ends.append(end)
        self._arrivals.append(arrival_ns)

    def add_many(self, ends: Iterable[int], arrival_ns: Iterable[int]) -> None:
        """Add chunks in order."""
        self._ends.extend(ends)
        self._arrivals.extend(arrival_ns)

    def forget(self, position: int) -> None:
        """Drop bytes that are not needed for frames that begin at or after `position`."""
        if len(self._ends) > 1:
            done = bisect_right(self._ends, position)
            del self._ends[:done], self._arrivals[:done]

    def sent(self, offset: Ints, size: Ints | int, latest: Ints, byte_ns: float) -> Ints:
        """Latest possible start of transmission of each frame, using the chunks that end inside it as well.

        Args:
            offset: (n,) start of each in the stream. size: its bytes.
            latest: (n,) latest start by the arrival of their last bytes, unix ns.
            byte_ns: time of a byte on the line.

        Returns:
            (n,) unix ns.
        """
        first, last = 0, len(self._ends)
        if last > SEARCHED_CHUNKS and len(offset):  # a frame is timed by the first chunk that ends after its start
            first = bisect_right(self._ends, int(offset.min()))
            last = bisect_right(self._ends, int(offset.max()), first) + 1
        ends, arrivals = np.array(self._ends[first:last], np.int64), np.array(self._arrivals[first:last], np.int64)
        if not len(ends):
            return latest
        sizes = np.array((size,), np.int64) if isinstance(size, int) else size
        sent = np.empty(len(offset), np.int64)
        earliest_sent(offset, sizes, latest, byte_ns, ends, arrivals, sent)
        return sent
