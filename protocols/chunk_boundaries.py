"""Boundaries and arrival times of the chunks of a stream; the last byte of a chunk has the least delay.

An adapter passes on 62 bytes when it has them, wherever a frame ends. The bytes after them wait for the next packet:

    on the line    ──frame──┐┌──────frame──────┐      ┌──frame──
    passed on         62 bytes │ 62 bytes │ the rest waits …
                               └ here: these bytes were sent just now

So the frame in which a chunk ends is timed twice: by its last byte, which may have waited, and by the last of its bytes
in the chunk before, whose place in the frame, and so its time on the line, is known. On any link, neither arrived
before it was sent: the earlier of the two estimates is the better (clock_model.py).

Source: FTDI, AN232B-04 "Data Throughput, Latency and Handshaking", section 3.2.
"""

from __future__ import annotations

import numpy as np

from protocols.framing import Ints

_NONE = np.zeros(0, np.int64)


class ChunkBoundaries:
    """Ends of the chunks of one stream, positions in bytes since it began, and their arrivals in unix ns."""

    def __init__(self) -> None:
        self._ends, self._arrivals = _NONE, _NONE
        self._new_ends: list[int] = []
        self._new_arrivals: list[int] = []

    def __len__(self) -> int:
        return len(self._ends) + len(self._new_ends)

    def add(self, end: int, arrival_ns: int) -> None:
        """Add one chunk; positions ascend."""
        self._new_ends.append(end)
        self._new_arrivals.append(arrival_ns)

    def add_many(self, ends: Ints, arrival_ns: Ints) -> None:
        """Add (n,) chunks."""
        self._merge()
        self._ends = np.concatenate((self._ends, ends))
        self._arrivals = np.concatenate((self._arrivals, arrival_ns))

    def forget(self, position: int) -> None:
        """Drop what is not needed for frames that begin at or after `position`."""
        if len(self) > 1:
            self._merge()
            done = int(np.searchsorted(self._ends, position, "right"))
            self._ends, self._arrivals = self._ends[done:], self._arrivals[done:]

    def sent(self, offset: Ints, size: Ints | int, latest: Ints, byte_ns: float) -> Ints:
        """Latest possible start of transmission of each frame, using the chunks that end inside it as well.

        Args:
            offset: (n,) start of each in the stream. size: its bytes.
            latest: (n,) latest start by the arrival of their last bytes, unix ns.
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
