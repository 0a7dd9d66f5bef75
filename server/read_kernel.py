"""Loop that reads a device's bytes with the time of each read: calls of the system, without Python in between."""

from __future__ import annotations

import time

from imuscope.protocols.compiled import INT, INTS, ArrayType, LibraryFunction, compiled
from imuscope.protocols.events import Array
from imuscope.protocols.framing import Ints

ROOM_BYTES = 1 << 12  # a tty returns at most so much at once
SECOND_NS = 1_000_000_000
_STOPPED = 7  # revents of the second of two
_MONOTONIC = time.CLOCK_MONOTONIC
_SHORTS, _BUFFER = ArrayType("int16", 1), ArrayType("uint8", 1)

ppoll = LibraryFunction("ppoll", "int32", "int64", "uint64", "int64", "int64")
read = LibraryFunction("read", "int64", "int32", "int64", "uint64")
clock_gettime = LibraryFunction("clock_gettime", "int32", "int32", "int64")


@compiled(INT, INT, _SHORTS, _BUFFER, INTS, INTS, INTS, INT, INT, waits=True)
def gather(
    fd: int,
    polled: Array,
    buffer: Array,
    ends: Ints,
    arrivals: Ints,
    timespec: Ints,
    first_ns: int,
    until_ns: int,
) -> int:
    """Wait for bytes, then read until a time.

    Args:
        polled: two `struct pollfd`: of `fd`, and of a pipe that stops the loop when it is readable.
        buffer: receives the bytes.
        ends, arrivals: end of each read in `buffer`, and its time by the monotonic clock, ns.
        timespec: (2,) memory for seconds and nanoseconds.
        first_ns: longest wait for the first byte; negative for no limit.
        until_ns: time by the monotonic clock at which the loop ends, if anything was read.

    Returns:
        Number of reads; if the last one failed, −1 minus the number of those before.
    """
    done = 0
    size = 0
    wait_ns = first_ns
    while done < len(ends) and len(buffer) - size >= ROOM_BYTES:
        timeout = 0
        if wait_ns >= 0:
            timespec[0] = wait_ns // SECOND_NS
            timespec[1] = wait_ns % SECOND_NS
            timeout = timespec.ctypes.data
        if ppoll(polled.ctypes.data, 2, timeout, 0) <= 0 or polled[_STOPPED] != 0:
            return done
        count = read(fd, buffer.ctypes.data + size, len(buffer) - size)
        if count <= 0:
            return -1 - done
        clock_gettime(_MONOTONIC, timespec.ctypes.data)
        now = timespec[0] * SECOND_NS + timespec[1]
        size += count
        ends[done] = size
        arrivals[done] = now
        done += 1
        wait_ns = until_ns - now
        if wait_ns <= 0:
            return done
    return done
