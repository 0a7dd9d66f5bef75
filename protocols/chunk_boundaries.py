"""Where did pieces of a stream end, and when did they come? The byte that ends a piece met the least delay.

An adapter hands over 62 bytes when it has them, wherever a frame ends. What is behind waits for the next packet:

    on the line    ──frame──┐┌──────frame──────┐      ┌──frame──
    handed over       62 bytes │ 62 bytes │ the rest waits …
                               └ here: these bytes were sent just now

So the frame in which a piece ends is known twice: by its last byte, which may have waited, and by the last of its bytes
in the piece before, whose place in the frame is known, and so the time that it takes on the line. Whatever the link is,
neither came before it was sent: the earlier of the two is the better (clock_model.py).

Source: FTDI, AN232B-04 "Data Throughput, Latency and Handshaking", section 3.2.
"""

from __future__ import annotations

import numpy as np

from protocols.framing import Ints

_NONE = np.zeros(0, np.int64)


class ChunkBoundaries:
    """Ends of the pieces of one stream, positions in bytes since it began, and their arrivals in unix ns."""

    def __init__(self) -> None:
        self._ends, self._arrivals = _NONE, _NONE
        self._new_ends: list[int] = []
        self._new_arrivals: list[int] = []

    def __len__(self) -> int:
        return len(self._ends) + len(self._new_ends)

    def add(self, end: int, arrival_ns: int) -> None:
        """One piece; positions ascend."""
        self._new_ends.append(end)
        self._new_arrivals.append(arrival_ns)

    def add_many(self, ends: Ints, arrival_ns: Ints) -> None:
        """(n,) pieces."""
        self._merge()
        self._ends = np.concatenate((self._ends, ends))
        self._arrivals = np.concatenate((self._arrivals, arrival_ns))

    def forget(self, position: int) -> None:
        """No frame that is still to be asked about begins before `position`."""
        if len(self) > 1:
            self._merge()
            done = int(np.searchsorted(self._ends, position, "right"))
            self._ends, self._arrivals = self._ends[done:], self._arrivals[done:]

    def sent(self, offset: Ints, size: Ints | int, latest: Ints, byte_ns: float) -> Ints:
        """When frames began on the line at the latest, by the pieces that ended inside them too.

        Args:
            offset: (n,) where they began in the stream. size: their bytes.
            latest: (n,) when they began at the latest by the arrival of their last bytes, unix ns.
            byte_ns: time of a byte on the line.
        Returns:
            (n,) unix ns.
        """
        self._merge()
        if len(self._ends) == 0:
            return latest
        first = np.searchsorted(self._ends, offset, "right")
        np.minimum(first, len(self._ends) - 1, out=first)
        inside = self._ends[first] - offset
        early = self._arrivals[first] - (inside * byte_ns).astype(np.int64)
        return np.where((inside > 0) & (inside < size), np.minimum(early, latest), latest)

    def _merge(self) -> None:
        if self._new_ends:
            self._ends = np.concatenate((self._ends, np.array(self._new_ends, np.int64)))
            self._arrivals = np.concatenate((self._arrivals, np.array(self._new_arrivals, np.int64)))
            self._new_ends, self._new_arrivals = [], []
