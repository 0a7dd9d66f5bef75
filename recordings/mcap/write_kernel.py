"""Loop that writes the reads of live links into a recording: calls of the system, without Python in between.

    ReadMemory of each link ──> records of messages ──write──> file, every `turn_ns`

A turn of a recording in Python costs thirty times the write itself, which is much on a small computer.

Source: MCAP specification, "Message (op=0x05)"; write(2), nanosleep(2).
"""

import time

from imuscope.protocols.arrays import Array, Ints
from imuscope.protocols.native.kernels import INT, INTS, TABLE, ArrayType, LibraryFunction, compiled, fence

BUFFER, ENDS, ARRIVALS, STATE, OFFSET, CHANNEL, TAKE_COUNT, MESSAGES, FIRST, LAST = range(10)  # rows of `links`
WRITTEN, SIZE, PART = 0, 1, 2  # positions in `counters`
HEAD_BYTES = 31  # MESSAGE_HEAD of records.py, which imports mcap: the build of this loop has NumPy alone
_SECOND_NS = 1_000_000_000
_MONOTONIC = time.CLOCK_MONOTONIC
_OUT = ArrayType("uint8", 1)
_IDLE_TURNS = 20

memcpy = LibraryFunction("memcpy", "uint64", "uint64", "uint64", "uint64")
write = LibraryFunction("write", "int64", "int32", "int64", "uint64")
nanosleep = LibraryFunction("nanosleep", "int32", "int64", "int64")
clock_gettime = LibraryFunction("clock_gettime", "int32", "int32", "int64")


@compiled(INT, _OUT, INT, INT, INT)
def _put(out: Array, at: int, value: int, count: int) -> int:
    for k in range(count):
        out[at + k] = value >> (8 * k) & 255
    return at + count


@compiled(INT, INT, _OUT, INT, INTS)
def _flush(fd: int, out: Array, size: int, counters: Ints) -> int:
    """Write; −1 if not all of it could be, which is noted."""
    count = write(fd, out.ctypes.data, size)
    if count == size:
        counters[WRITTEN] += size
        return 0
    counters[SIZE] = size
    counters[PART] = max(count, 0)
    return -1


@compiled(INT, INT, TABLE, INT, _OUT, INT, INTS, INTS, INTS)
def _append(fd: int, links: Ints, link: int, out: Array, size: int, ends: Ints, arrivals: Ints, counters: Ints) -> int:
    """Append a link's new reads to the records in `out`; their size, or −1 if writing failed."""
    memcpy(ends.ctypes.data, links[STATE, link] + 8, 8)
    count = int(ends[0])
    fence()
    memcpy(ends.ctypes.data, links[STATE, link], 8)
    count = min(count, int(ends[0]))
    fence()
    take_count = int(links[TAKE_COUNT, link])
    if count <= take_count:
        return size
    begin = 0
    if take_count > 0:
        memcpy(ends.ctypes.data, links[ENDS, link] + 8 * (take_count - 1), 8)
        begin = int(ends[0])
    memcpy(ends.ctypes.data, links[ENDS, link] + 8 * take_count, 8 * (count - take_count))
    memcpy(arrivals.ctypes.data, links[ARRIVALS, link] + 8 * take_count, 8 * (count - take_count))
    for k in range(count - take_count):
        length = int(ends[k]) - begin
        if size + HEAD_BYTES + length > len(out):
            if _flush(fd, out, size, counters) < 0:
                return -1
            size = 0
        when = int(arrivals[k] + links[OFFSET, link])
        at = _put(out, size, 5, 1)
        at = _put(out, at, 22 + length, 8)
        at = _put(out, at, int(links[CHANNEL, link]), 2)
        at = _put(out, at, 0, 4)
        at = _put(out, at, when, 8)
        at = _put(out, at, when, 8)
        memcpy(out.ctypes.data + at, links[BUFFER, link] + begin, length)
        size = at + length
        begin = int(ends[k])
        links[FIRST, link] = min(links[FIRST, link], when)
        links[LAST, link] = max(links[LAST, link], when)
        links[MESSAGES, link] += 1
        links[TAKE_COUNT, link] += 1
    return size


@compiled(INT, INT, TABLE, _OUT, INTS, INTS, INTS, INTS, INTS, INT, INT, INT, waits=True)
def write_reads(
    fd: int,
    links: Ints,
    out: Array,
    ends: Ints,
    arrivals: Ints,
    timespec: Ints,
    counters: Ints,
    stop_flag: Ints,
    turn_ns: int,
    until_ns: int,
    most: int,
) -> int:
    """Write the reads of links until the flag is set, until a link's memory is used up, or until a time.

    Args:
        fd: of the file, which is open for appending.
        links: (10, n) a column for each link: addresses of the arrays of its ReadMemory, the offset of its times,
            the channel, and, changed here: reads of the memory that are written, messages written, earliest and latest
            time.
        out: memory of records.
        ends, arrivals: (MAX_READS,) memory.
        timespec: (2,) memory.
        counters: (3,) changed here: bytes written; after a failure also the size of the records in `out`, and how much
            of them was written.
        stop_flag: (1,) other than 0 to end the loop.
        turn_ns: time between two turns.
        until_ns: time by the monotonic clock at which the loop ends.
        most: number of bytes after which the loop ends.

    Returns:
        0; 1 if nothing arrived for a while; −1 if not all of `out` could be written.
    """
    idle = 0
    while True:
        size, finished = 0, 0
        for link in range(links.shape[1]):
            size = _append(fd, links, link, out, size, ends, arrivals, counters)
            if size < 0:
                return -1
            memcpy(ends.ctypes.data, links[STATE, link] + 8, 8)
            if links[TAKE_COUNT, link] >= ends[0]:
                finished = 1
        idle += 1
        if size > 0:
            idle = 0
            if _flush(fd, out, size, counters) < 0:
                return -1
        clock_gettime(_MONOTONIC, timespec.ctypes.data)
        now = timespec[0] * _SECOND_NS + timespec[1]
        if finished != 0 or stop_flag[0] != 0 or now >= until_ns or counters[WRITTEN] >= most:
            return 0
        if idle >= _IDLE_TURNS:
            return 1
        timespec[0] = turn_ns // _SECOND_NS
        timespec[1] = turn_ns % _SECOND_NS
        nanosleep(timespec.ctypes.data, 0)
