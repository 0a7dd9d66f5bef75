"""Reading loop of one file descriptor, compiled: every read with its own arrival time, without Python in between.

    reading thread   ──gather──> ppoll ─> read ─> clock_gettime ─> buffer, ends, arrivals ──┐ until a stop, or until
                                   ^________________________________________________________┘ a taker is late
    takers           take ──> Chunk, Chunk, Chunk …   of all reads since the last call

A device that sends 2000 times a second wakes its thread as often. In Python each time costs ten times what the kernel
needs, and the thread waits for the interpreter's lock before it can take the time. The compiled loop needs neither: it
releases the lock for the whole call, and stamps a read right after it. As plain Python (protocols/compiled.py) it
releases the lock for each call of the system.

Takers fetch the bytes while the loop goes on: the event loop when it decodes, a recording when it writes.
Each promises by when it will take again (`Flow.deadlines`). While all keep their promise the thread never runs Python;
it does when one is late, when one has found nothing and wants to be woken, and when the memory is full.

The loop reports a failed read without its cause; the caller then reads itself, and gets the exception.

Source: poll(2), read(2), clock_gettime(2).
"""

from __future__ import annotations

import math
import select
import time
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from imuscope.protocols.framing import Ints
from imuscope.server.links.base import Chunk
from imuscope.server.read_kernel import SECOND_NS, gather, promise

BUFFER_BYTES = 1 << 16
MAX_READS = 1024  # per call

_POLLED = np.dtype([("fd", "i4"), ("events", "i2"), ("revents", "i2")])  # struct pollfd, as four int16


class ReadLoop:
    """Memory of the loop for one descriptor. Only one thread at a time may take.

    Args:
        fd: non-blocking.
        stop: a pipe that ends a call when it can be read.
        now_ns: clock of the arrival times: the monotonic clock plus a constant.
        deadlines: see Flow.deadlines.

    Attributes:
        failed: whether the last read failed.
    """

    def __init__(self, fd: int, stop: int, now_ns: Callable[[], int], deadlines: Ints) -> None:
        self.failed = False
        self._deadlines = deadlines
        self._read_count = np.zeros(1, np.int64)
        self._take_count = 0
        self._fd = fd
        self._offset_ns = monotonic_offset_ns(now_ns)
        both = np.array([(fd, select.POLLIN, 0), (stop, select.POLLIN, 0)], _POLLED)
        self._polled = both.view(np.int16)
        data = bytearray(BUFFER_BYTES)
        self._view, self._buffer = memoryview(data), np.frombuffer(data, np.uint8)
        self._ends = np.empty(MAX_READS, np.int64)
        self._arrivals = np.empty(MAX_READS, np.int64)
        self._timespec = np.zeros(2, np.int64)

    def read(self, timeout_s: float | None, until_ns: int) -> None:
        """Read what arrives, in the reading thread, as long as all takers keep their promise.

        Args:
            timeout_s: longest wait for the first byte; None for no limit.
            until_ns: with a late taker, reading goes on until then, by the monotonic clock.
        """
        first_ns = -1 if timeout_s is None else math.ceil(timeout_s * SECOND_NS)
        memory = self._polled, self._buffer, self._ends, self._arrivals, self._timespec, self._read_count
        self.failed = gather(self._fd, *memory, self._deadlines, first_ns, until_ns) < 0

    def take(self) -> list[Chunk]:
        """Chunks since the last call."""
        return self._chunks(int(self._read_count[0]))

    def take_for(self, taker: int, until_ns: int) -> list[Chunk]:
        """Chunks since the last call, for a taker who promises to call again by then, ns by the monotonic
        clock. If there is nothing, the reading thread is to wake it (0).
        """
        count = promise(self._deadlines, taker, until_ns, self._read_count)
        if count == self._take_count and until_ns:
            count = promise(self._deadlines, taker, 0, self._read_count)
            if count > self._take_count:  # read in the meantime
                self._deadlines[taker] = until_ns
        return self._chunks(count)

    def take_last(self) -> list[Chunk]:
        """Chunks since the last call, in the reading thread; the next reads begin with empty memory."""
        chunks = self.take()
        self._read_count[0] = self._take_count = 0
        return chunks

    def _chunks(self, count: int) -> list[Chunk]:
        first, self._take_count = self._take_count, count
        if first == count:
            return []
        begin = int(self._ends[first - 1]) if first else 0
        ends, arrivals = self._ends[first:count].tolist(), (self._arrivals[first:count] + self._offset_ns).tolist()
        if count == first + 1:
            return [Chunk(bytes(self._view[begin : ends[0]]), arrivals[0])]
        parts = zip(pairwise([begin, *ends]), arrivals, strict=True)
        return [Chunk(bytes(self._view[at:end]), when) for (at, end), when in parts]


def monotonic_offset_ns(now_ns: Callable[[], int], tries: int = 5) -> int:
    """Difference of a clock to the monotonic one, from the quickest of some comparisons."""
    best, offset = math.inf, 0
    for _ in range(tries):
        before = time.monotonic_ns()
        theirs = now_ns()
        spent = time.monotonic_ns() - before
        if spent < best:
            best, offset = spent, theirs - before - spent // 2
    return offset
