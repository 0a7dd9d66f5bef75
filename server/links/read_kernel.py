"""Loop that reads a device's bytes with the time of each read: calls of the system, without Python in between.

The memory of the loop is shared with the threads that take what it has read (server/links/read_loop.py):

    reading thread                        takers
    buffer, ends, arrivals                promise: deadline of a taker, then the number of reads
    fence                                          fence
    read_count ── published
    fence
    deadlines ── all in the future: goes on; else it returns soon

Either the reading thread sees a deadline that was set, or the taker who set it sees the reads before.
"""

import time

from imuscope.protocols.arrays import Array, Ints
from imuscope.protocols.native.kernels import INT, INTS, ArrayType, LibraryFunction, compiled, fence

ROOM_BYTES = 1 << 12  # a tty returns at most so much at once
SECOND_NS = 1_000_000_000
_STOP_REVENTS = 7  # revents of the second of two
_MONOTONIC = time.CLOCK_MONOTONIC
_SHORTS, _BUFFER = ArrayType("int16", 1), ArrayType("uint8", 1)

ppoll = LibraryFunction("ppoll", "int32", "int64", "uint64", "int64", "int64")
read = LibraryFunction("read", "int64", "int32", "int64", "uint64")
clock_gettime = LibraryFunction("clock_gettime", "int32", "int32", "int64")


@compiled(INT, INT, _SHORTS, _BUFFER, INTS, INTS, INTS, INTS, INTS, INT, INT, waits=True)
def gather(
    fd: int,
    polled: Array,
    buffer: Array,
    ends: Ints,
    arrivals: Ints,
    timespec: Ints,
    read_count: Ints,
    deadlines: Ints,
    first_ns: int,
    until_ns: int,
) -> int:
    """Wait for bytes, then read while all takers have promised to take them, and until a time.

    Args:
        polled: two `struct pollfd`: of `fd`, and of a pipe that stops the loop when it is readable.
        buffer: receives the bytes.
        ends, arrivals: end of each read in `buffer`, and its time by the monotonic clock, ns.
        timespec: (2,) memory for seconds and nanoseconds.
        read_count: (1,) number of reads; those before the call stay.
        deadlines: time of each taker by the monotonic clock until which it will have taken, ns.
        first_ns: longest wait for the first byte; negative for no limit.
        until_ns: time by the monotonic clock at which the loop ends if a deadline is over and anything was read.

    Returns:
        0; −1 if a read failed.
    """
    done = read_count[0]
    size = 0
    if done > 0:
        size = ends[done - 1]
    wait_ns = first_ns
    while done < len(ends) and len(buffer) - size >= ROOM_BYTES:
        timeout = 0
        if wait_ns >= 0:
            timespec[0] = wait_ns // SECOND_NS
            timespec[1] = wait_ns % SECOND_NS
            timeout = timespec.ctypes.data
        if ppoll(polled.ctypes.data, 2, timeout, 0) <= 0 or polled[_STOP_REVENTS] != 0:
            return 0
        count = read(fd, buffer.ctypes.data + size, len(buffer) - size)
        if count <= 0:
            return -1
        clock_gettime(_MONOTONIC, timespec.ctypes.data)
        now = timespec[0] * SECOND_NS + timespec[1]
        size += count
        ends[done] = size
        arrivals[done] = now
        done += 1
        fence()
        read_count[0] = done
        fence()
        wait_ns = -1
        for taker in range(len(deadlines)):
            if deadlines[taker] <= now:
                wait_ns = until_ns - now
                if wait_ns <= 0:
                    return 0
    return 0


@compiled(INT, INTS, INT, INT, INTS)
def promise(deadlines: Ints, taker: int, until_ns: int, read_count: Ints) -> int:
    """Set the time until which a taker takes; the number of reads, of which the loop may not have seen that time."""
    deadlines[taker] = until_ns
    fence()
    done = int(read_count[0])
    fence()
    return done
