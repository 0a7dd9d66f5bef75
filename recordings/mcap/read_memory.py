"""Memory of the reads of a live link, which a reading loop fills while a recording takes from it.

    reading loop ──> ReadMemory: bytes, where each read ends, when it arrived, how many there are
                        │ full: the next one                                    ──> the session takes, too
                        v
    ReadFollower: [memory, partly written] [memory] [memory being filled] ──> the recording's writer, from machine code

A follower gets every read since it was created, however late it takes them: a memory with a follower is not reused.
Creating, ending or extending a follower needs the lock; taking from one does not.
"""

from collections import deque
from collections.abc import Callable

import numpy as np

NEVER_NS = (1 << 63) - 1
BUFFER_BYTES = 1 << 16
MAX_READS = 1024
READ_COUNT, READ_LIMIT = 0, 1  # positions in ReadMemory.state


class ReadMemory:
    """Consecutive reads.

    Args:
        offset_ns: added to a time of the monotonic clock gives that of the recording.

    Attributes:
        buffer: (BUFFER_BYTES,) their bytes; `view` of the same.
        ends, arrivals: (MAX_READS,) end of each read in `buffer`, and its time by the monotonic clock, ns.
        state: (2,) number of reads, and of those that a follower takes: NEVER while more may come.
    """

    __slots__ = ("arrivals", "buffer", "ends", "offset_ns", "state", "view")

    def __init__(self, offset_ns: int) -> None:
        data = bytearray(BUFFER_BYTES)
        self.view, self.buffer = memoryview(data), np.frombuffer(data, np.uint8)
        self.ends, self.arrivals = np.empty(MAX_READS, np.int64), np.empty(MAX_READS, np.int64)
        self.state = np.array([0, NEVER_NS], np.int64)
        self.offset_ns = offset_ns


class ReadFollower:
    """Reads of one link that a recording takes.

    Args:
        memory: present one of the reading loop.
        take_count: number of its reads that are not part of the recording.
        sleep: called before the recording waits: whether it is woken by the next read, because there is none now.

    Attributes:
        memories: the first is partly written.
        take_count: number of reads of the first that are written.
        wake: called when there is a read after `sleep`.
    """

    def __init__(self, memory: ReadMemory, take_count: int, sleep: "Callable[[ReadFollower], bool]") -> None:
        self.memories = deque([memory])
        self.take_count = take_count
        self._sleep = sleep
        self.wake: Callable[[], None] = lambda: None

    def sleep(self) -> bool:
        """Whether nothing is there, and the next read wakes."""
        return self.has_ended or self._sleep(self)

    def extend(self, count: int, following: ReadMemory | None) -> None:
        """Take only `count` reads of the last memory, then those of the following one, if there is one."""
        last = self.memories[-1]
        if following is not None:
            self.memories.append(following)
        last.state[READ_LIMIT] = count

    def advance(self) -> None:
        """Go on with the next memory if all of the first is written."""
        while self.take_count == self.memories[0].state[READ_LIMIT] and len(self.memories) > 1:
            self.memories.popleft()
            self.take_count = 0

    @property
    def has_ended(self) -> bool:
        """Whether all is written, and no more comes."""
        return len(self.memories) == 1 and self.take_count == self.memories[0].state[READ_LIMIT]

    @property
    def oldest_ns(self) -> int | None:
        """Arrival of the oldest read that is not written, ns; None if there is none."""
        memory = self.memories[0]
        if self.take_count < min(memory.state):
            return int(memory.arrivals[self.take_count]) + memory.offset_ns
        return None
