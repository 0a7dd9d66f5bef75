"""Reading loop of one file descriptor, compiled: every read with its own arrival time, many reads per call.

    thread   ──gather──> ppoll ─> read ─> clock_gettime ─> buffer, ends, arrivals ──┐ until `until_ns`, or a stop
                           ^________________________________________________________┘
             <── Chunk, Chunk, Chunk …

A device that sends 2000 times a second wakes its thread as often. In Python each time costs ten times what the kernel
needs, and the thread waits for the interpreter's lock before it can take the time. The compiled loop needs neither: it
releases the lock for the whole call, and stamps a read right after it. As plain Python (protocols/compiled.py) it
releases the lock for each call of the system.

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

from imuscope.server.links.base import Chunk
from imuscope.server.read_kernel import SECOND_NS, gather

BUFFER_BYTES = 1 << 16
MAX_READS = 256  # per call

_POLLED = np.dtype([("fd", "i4"), ("events", "i2"), ("revents", "i2")])  # struct pollfd, as four int16


class ReadLoop:
    """Memory of the loop for one descriptor.

    Args:
        fd: non-blocking.
        stop: a pipe that ends a call when it can be read.
        now_ns: clock of the arrival times: the monotonic clock plus a constant.

    Attributes:
        failed: whether the last read failed.
    """

    def __init__(self, fd: int, stop: int, now_ns: Callable[[], int]) -> None:
        self.failed = False
        self._fd = fd
        self._offset_ns = monotonic_offset_ns(now_ns)
        both = np.array([(fd, select.POLLIN, 0), (stop, select.POLLIN, 0)], _POLLED)
        self._polled = both.view(np.int16)
        data = bytearray(BUFFER_BYTES)
        self._view, self._buffer = memoryview(data), np.frombuffer(data, np.uint8)
        self._ends = np.empty(MAX_READS, np.int64)
        self._arrivals = np.empty(MAX_READS, np.int64)
        self._timespec = np.zeros(2, np.int64)

    def read(self, timeout_s: float | None, until_ns: int) -> list[Chunk]:
        """Bytes that arrive: from the first byte, for which it waits, until a time by the monotonic clock.

        Args:
            timeout_s: longest wait for the first byte; None for no limit.
        """
        first_ns = -1 if timeout_s is None else math.ceil(timeout_s * SECOND_NS)
        memory = self._polled, self._buffer, self._ends, self._arrivals, self._timespec
        count = gather(self._fd, *memory, first_ns, until_ns)
        self.failed = count < 0
        if count < 0:
            count = -1 - count
        if count == 0:
            return []
        ends, arrivals = self._ends[:count].tolist(), (self._arrivals[:count] + self._offset_ns).tolist()
        data = bytes(self._view[: ends[-1]])
        if count == 1:
            return [Chunk(data, arrivals[0])]
        return [Chunk(data[at:end], when) for (at, end), when in zip(pairwise([0, *ends]), arrivals, strict=True)]


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
