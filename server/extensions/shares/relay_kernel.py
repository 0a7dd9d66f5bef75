"""Loop of a shared port as calls of the system: bytes of the device to its clients and to the server, without Python.

    port ──read──> clients: at once ── one takes less ──> returns: the rest waits in its queue (holder/queues.py)
              └──> server: message with the time of the read, collected until a time

The holder calls it as long as nothing else is to be done, and does everything else itself, as it does all without
machine code. It has no numpy, so all arguments are numbers, and it loads the function from the library of this source
that its starter names (`place`). The rest comes back through a pipe, which needs no address of memory.
"""

import time

import numpy as np

from imuscope.protocols.native.kernels import FOUR, INT, LibraryFunction, TupleType, compiled, library_place
from imuscope.server.extensions.shares.holder.messages import MessageKind
from imuscope.server.links.read_kernel import SECOND_NS, clock_gettime, read

READ_BYTES = 1 << 12
SERVER_BYTES = 1 << 15  # bytes for the server, of which the last read must have room
HEAD_BYTES = 13  # messages.HEADER and messages.STAMP
AGREED_NS = 8_000_000  # between two writes to the server, see server_connection.SERVER_NS
_MONOTONIC = time.CLOCK_MONOTONIC
_DATA = int(MessageKind.DATA)
_PORT_READABLE = 0x40  # EPOLLRDNORM, of event_loop.RELAYED
MS_NS = 1_000_000

epoll_wait = LibraryFunction("epoll_wait", "int32", "int32", "int64", "int32", "int32")
write = LibraryFunction("write", "int64", "int32", "int64", "uint64")
memcpy = LibraryFunction("memcpy", "int64", "int64", "int64", "uint64")


@compiled(TupleType((INT,) * 8), INT, INT, FOUR, INT, INT, INT, waits=True)
def relay(
    port: int, epoll: int, clients: tuple[int, int, int, int], server: int, spill: int, until_ns: int
) -> tuple[int, int, int, int, int, int, int, int]:
    """Pass on what arrives, until another descriptor is ready, a client or the server takes less, or a time.

    Args:
        port: non-blocking descriptor of the device.
        epoll: watches the port for event_loop.RELAYED, and what else is to be waited for.
        clients: non-blocking descriptors; −1 for none.
        server: the same; −1 for none.
        spill: a pipe for the rest: the last read, if a client has not taken it all, then bytes for the server.
        until_ns: by the monotonic clock.

    Returns:
        state: 0 the time is over, 1 something else is ready, −1 the port failed, 2 bytes are left over;
        all bytes read; size of the last read; what each client has taken of that, −1 for a client that failed;
        bytes for the server that are left over.
    """
    event = np.empty(4, np.int32)
    timespec = np.empty(2, np.int64)
    buffer = np.empty(READ_BYTES, np.uint8)
    collected = np.empty(SERVER_BYTES, np.uint8)
    kind = np.empty(1, np.uint8)
    length = np.empty(1, np.int32)
    kind[0] = _DATA
    into, start = collected.ctypes.data, buffer.ctypes.data
    clock_gettime(_MONOTONIC, timespec.ctypes.data)
    now = timespec[0] * SECOND_NS + timespec[1]
    flush_ns, size, total, count, state = until_ns, 0, 0, 0, 0
    a, b, c, d = 0, 0, 0, 0
    while state == 0 and now < until_ns:
        wait_ns = min(until_ns, flush_ns) - now
        if wait_ns < 0:
            wait_ns = 0
        ready = epoll_wait(epoll, event.ctypes.data, 1, (wait_ns + MS_NS - 1) // MS_NS)
        if ready > 0 and event[0] & _PORT_READABLE == 0:
            state = 1
        elif ready > 0:
            got = read(port, start, READ_BYTES)
            if got <= 0:
                state = -1
            else:
                count = got
        clock_gettime(_MONOTONIC, timespec.ctypes.data)
        now = timespec[0] * SECOND_NS + timespec[1]
        if state == 0 and ready > 0:
            total += count
            a, b, c, d = count, count, count, count
            if clients[0] >= 0:
                a = write(clients[0], start, count)
            if clients[1] >= 0:
                b = write(clients[1], start, count)
            if clients[2] >= 0:
                c = write(clients[2], start, count)
            if clients[3] >= 0:
                d = write(clients[3], start, count)
            if server >= 0:
                if size == 0:
                    flush_ns = now + AGREED_NS
                length[0] = 8 + count
                timespec[0] = now
                memcpy(into + size, kind.ctypes.data, 1)
                memcpy(into + size + 1, length.ctypes.data, 4)
                memcpy(into + size + 5, timespec.ctypes.data, 8)
                memcpy(into + size + HEAD_BYTES, start, count)
                size += HEAD_BYTES + count
            if a < count or b < count or c < count or d < count:
                state = 2
        is_due = now >= flush_ns or now >= until_ns or state != 0
        if size > 0 and (is_due or SERVER_BYTES - size < READ_BYTES + HEAD_BYTES):
            sent = write(server, into, size)
            if sent < 0:
                sent = 0
            if sent < size:
                if state == 2:
                    write(spill, start, count)
                write(spill, into + sent, size - sent)
                return 2, total, count, a, b, c, d, size - sent
            size = 0
            flush_ns = until_ns
    if state == 2:
        write(spill, start, count)
    return state, total, count, a, b, c, d, 0


def place() -> tuple[str, str] | None:
    """The library with `relay` as machine code of this source, and its name in it; None without."""
    return library_place(relay)
