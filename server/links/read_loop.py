"""Reading loop of one file descriptor, compiled: every read with its own arrival time, without Python in between.

    reading thread   ──gather──> ppoll ─> read ─> clock_gettime ─> buffer, ends, arrivals ──┐ until a stop, or until
                                   ^________________________________________________________┘ a taker is late
    session          take ──> Chunk, Chunk, Chunk …   of all reads since the last call
    recording        follows the memory by itself (recordings/mcap/read_memory.py)

A device that sends 2000 times a second wakes its thread as often. In Python each time costs ten times what the kernel
needs, and the thread waits for the interpreter's lock before it can take the time. The compiled loop needs neither: it
releases the lock for the whole call, and stamps a read right after it. As plain Python (protocols/native/kernels.py) it
releases the lock for each call of the system.

Both fetch the bytes while the loop goes on: the event loop when it decodes, a recording when it writes. The session
promises by when it will take again (`Flow.deadlines`). While it keeps its promise the thread never runs Python; it does
when it is late, when one of both has found nothing and wants to be woken, and when the memory is full.

The loop reports a failed read without its cause; the caller then reads itself, and gets the exception.

Source: poll(2), read(2), clock_gettime(2).
"""

import math
import select
import time
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.recordings.mcap.read_memory import BUFFER_BYTES, MAX_READS, NEVER_NS, READ_COUNT, ReadFollower, ReadMemory
from imuscope.server.links.base import RECORDING_DEADLINE, Chunk
from imuscope.server.links.read_kernel import ROOM_BYTES, SECOND_NS, gather, promise

MAX_MEMORIES = 4096  # 256 MB
CLOCK_COMPARISONS = 5  # of two clocks

_POLLED = np.dtype([("fd", "i4"), ("events", "i2"), ("revents", "i2")])  # struct pollfd, as four int16


class ReadLoop:
    """Loop for one descriptor. Only one thread at a time may take, follow or unfollow.

    Args:
        fd: non-blocking.
        stop: a pipe that ends a call when it can be read.
        now_ns: clock of the arrival times: the monotonic clock plus a constant.
        deadlines: see Flow.deadlines.

    Attributes:
        failed: whether the last read failed.
        follower: takes all reads for a recording; None if none does.
    """

    def __init__(self, fd: int, stop: int, now_ns: Callable[[], int], deadlines: Ints) -> None:
        self.failed = False
        self.follower: ReadFollower | None = None
        self._deadlines = deadlines
        self._take_count = 0
        self._was_followed = False  # in the present memory
        self._fd = fd
        self._offset_ns = monotonic_offset_ns(now_ns)
        both = np.array([(fd, select.POLLIN, 0), (stop, select.POLLIN, 0)], _POLLED)
        self._polled = both.view(np.int16)
        self._memory = ReadMemory(self._offset_ns)
        self._timespec = np.zeros(2, np.int64)

    def read(self, timeout_s: float | None, until_ns: int) -> None:
        """Read what arrives, in the reading thread, as long as all takers keep their promise.

        Args:
            timeout_s: longest wait for the first byte; None for no limit.
            until_ns: with a late taker, reading goes on until then, by the monotonic clock.
        """
        first_ns = -1 if timeout_s is None else math.ceil(timeout_s * SECOND_NS)
        memory = self._memory
        arrays = self._polled, memory.buffer, memory.ends, memory.arrivals, self._timespec, memory.state
        self.failed = gather(self._fd, *arrays, self._deadlines, first_ns, until_ns) < 0

    def take(self) -> list[Chunk]:
        """Chunks since the last call."""
        return self._chunks(int(self._memory.state[READ_COUNT]))

    def take_for(self, taker: int, until_ns: int) -> list[Chunk]:
        """Chunks since the last call, for a taker who promises to call again by then, ns by the monotonic
        clock. If there is nothing, the reading thread is to wake it (0).
        """
        state = self._memory.state
        count = promise(self._deadlines, taker, until_ns, state)
        if count == self._take_count and until_ns:
            count = promise(self._deadlines, taker, 0, state)
            if count > self._take_count:  # read in the meantime
                self._deadlines[taker] = until_ns
        return self._chunks(count)

    def take_last(self) -> list[Chunk]:
        """Chunks since the last call, in the reading thread; if the memory is full, the next reads begin with an
        empty one.
        """
        chunks = self.take()
        count, memory = self._take_count, self._memory
        if count == MAX_READS or (count and BUFFER_BYTES - memory.ends[count - 1] < ROOM_BYTES):
            self._take_count = 0
            if self._was_followed:
                self._memory = ReadMemory(self._offset_ns)
                self._was_followed = self.follower is not None
            else:
                memory.state[READ_COUNT] = 0
            if self.follower is not None:
                self.follower.extend(count, self._memory)
        return chunks

    def follow(self) -> ReadFollower:
        """Begin to follow, after all earlier reads were taken."""
        self.follower = ReadFollower(self._memory, self._take_count, self._sleep)
        self._was_followed = True
        return self.follower

    def unfollow(self) -> None:
        """End the follower, after all earlier reads were taken."""
        if self.follower is not None:
            follower, self.follower = self.follower, None
            self._deadlines[RECORDING_DEADLINE] = NEVER_NS
            follower.extend(self._take_count, None)
            follower.wake()

    @property
    def is_far_ahead(self) -> bool:
        """Whether so much waits for the follower that reading must pause."""
        return self.follower is not None and len(self.follower.memories) > MAX_MEMORIES

    def wake_follower(self) -> None:
        """Wake the follower if it wants that, in the reading thread."""
        if self.follower is not None and not self._deadlines[RECORDING_DEADLINE]:
            self._deadlines[RECORDING_DEADLINE] = NEVER_NS
            self.follower.wake()

    def _sleep(self, follower: ReadFollower) -> bool:
        memory = follower.memories[-1]
        count = promise(self._deadlines, RECORDING_DEADLINE, 0, memory.state)
        if len(follower.memories) == 1 and count == follower.take_count and follower is self.follower:
            return True
        self._deadlines[RECORDING_DEADLINE] = NEVER_NS
        return False

    def _chunks(self, count: int) -> list[Chunk]:
        first, self._take_count = self._take_count, count
        if first == count:
            return []
        memory = self._memory
        view, begin = memory.view, int(memory.ends[first - 1]) if first else 0
        ends, arrivals = memory.ends[first:count].tolist(), (memory.arrivals[first:count] + self._offset_ns).tolist()
        if count == first + 1:
            return [Chunk(bytes(view[begin : ends[0]]), arrivals[0])]
        parts = zip(pairwise([begin, *ends]), arrivals, strict=True)
        return [Chunk(bytes(view[at:end]), when) for (at, end), when in parts]


def monotonic_offset_ns(now_ns: Callable[[], int]) -> int:
    """Difference of a clock to the monotonic one, from the quickest of some comparisons."""
    best, offset = math.inf, 0
    for _ in range(CLOCK_COMPARISONS):
        before = time.monotonic_ns()
        theirs = now_ns()
        spent = time.monotonic_ns() - before
        if spent < best:
            best, offset = spent, theirs - before - spent // 2
    return offset
