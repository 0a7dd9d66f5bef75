"""Direct writer: from the memory of live links into a recording, in machine code (write_kernel.py).

It runs in the thread of a recording's writer, and ends at least once a second, or when something else is to be written.
"""

import time

import numpy as np

from imuscope.protocols.messages.records import records_of
from imuscope.recordings.mcap import write_kernel as rows
from imuscope.recordings.mcap.read_memory import MAX_READS, NEVER_NS, ReadFollower
from imuscope.recordings.mcap.writer import McapWriter

OUT_BYTES = 1 << 18


class DirectWriter:
    """Followed links of a recording.

    Attributes:
        stop_flag: (1,) set to 1 by any thread to end `write` soon.
    """

    def __init__(self) -> None:
        self.stop_flag = np.zeros(1, np.int64)
        self._followed: list[tuple[str, ReadFollower]] = []
        self._out = np.empty(OUT_BYTES, np.uint8)
        self._ends, self._arrivals = np.empty(MAX_READS, np.int64), np.empty(MAX_READS, np.int64)
        self._timespec = np.zeros(2, np.int64)
        self._counters = np.zeros(3, np.int64)

    def add(self, device: str, follower: ReadFollower) -> None:
        """Also write the reads of a link, as chunks received from `device`."""
        if all(one is not follower for _, one in self._followed):
            self._followed = [*self._followed, (device, follower)]

    def __bool__(self) -> bool:
        return bool(self._followed)

    @property
    def written(self) -> int:
        """Bytes written by a call that has not returned yet."""
        return int(self._counters[rows.WRITTEN])

    @property
    def oldest_ns(self) -> int:
        """Arrival of the oldest read that was not written, ns; NEVER if there is none."""
        return min((ns for _, one in self._followed if (ns := one.oldest_ns) is not None), default=NEVER_NS)

    def sleep(self) -> bool:
        """Whether no link has anything, and the next read of any wakes the recording."""
        return all([one.sleep() for _, one in self._followed])  # noqa: C419 - all of them

    def write(self, writer: McapWriter, shift_ns: int, turn_ns: int, longest_ns: int, most: int) -> bool:
        """Write until the flag is set, or for a time; whether anything came lately.

        Args:
            shift_ns: added to the times.
            turn_ns: between two turns.
            longest_ns: how long; 0 for one turn.
            most: end after so many bytes.

        Raises:
            RecordingError: see McapWriter.
        """
        links = np.zeros((rows.LAST + 1, len(self._followed)), np.int64)
        for link, (device, follower) in zip(links.T, self._followed, strict=True):
            memory = follower.memories[0]
            addresses = memory.buffer, memory.ends, memory.arrivals, memory.state
            link[: rows.STATE + 1] = [one.ctypes.data for one in addresses]
            link[rows.OFFSET] = memory.offset_ns + shift_ns
            link[rows.CHANNEL] = writer.bytes_channel(device, "rx")
            link[rows.TAKE_COUNT], link[rows.FIRST] = follower.take_count, NEVER_NS
        arrays = self._out, self._ends, self._arrivals, self._timespec, self._counters, self.stop_flag
        until_ns = time.monotonic_ns() + longest_ns
        result = rows.write_reads(writer.fileno(), links, *arrays, turn_ns, until_ns, most)
        for link, (_, follower) in zip(links.T, self._followed, strict=True):
            follower.take_count = int(link[rows.TAKE_COUNT])
            follower.advance()
            if count := int(link[rows.MESSAGES]):
                writer.count(int(link[rows.CHANNEL]), count, int(link[rows.FIRST]), int(link[rows.LAST]))
        self._followed = [one for one in self._followed if not one[1].has_ended]
        written, size, part = self._counters.tolist()
        self._counters.fill(0)
        unwritten = [record for _, record in records_of(self._out[:size].tobytes())]
        writer.note_written(written, unwritten, part)
        return bool(result == 0)
