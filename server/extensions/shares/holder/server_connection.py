"""The holder's end of the connection to the server."""

from __future__ import annotations

import _socket
import errno
import struct
import time

from imuscope.server.extensions.shares.holder.messages import HEADER, STAMP, MessageKind, MessageReader
from imuscope.server.system.light_modules import INFINITY

_CREDENTIALS = struct.Struct("3i")  # process, user and group of the other end, see unix(7)
_DATA = struct.Struct(HEADER.format + STAMP.format[1:])
_DATA_KIND = int(MessageKind.DATA)  # packed in a third of the time
SERVER_NS = 8_000_000
"""Between two messages with bytes of the device, unless there are many: their stamps go with them."""
SERVER_BYTES = 1 << 15  # collected before it is time
EARLY_NS = 2_000_000  # before that: bytes that arrive then take it along, which saves a wake-up


class ServerConnection:
    """The connection to the server. Bytes of the device are collected for a moment: their stamps go with them."""

    def __init__(self, connection: _socket.socket) -> None:
        self._connection = connection
        self.fd = connection.fileno()
        peer = connection.getsockopt(_socket.SOL_SOCKET, _socket.SO_PEERCRED, _CREDENTIALS.size)
        self.pid: int = _CREDENTIALS.unpack(peer)[0]
        self._reader = MessageReader()
        self._waiting = bytearray()
        self._collected: list[tuple[int, bytes]] = []
        self._early_ns, self._latest = 0, 0.0  # bytes with a later stamp are sent at once; others then, monotonic s
        self._size = 0
        self.due_at = INFINITY

    @property
    def backlog(self) -> int:
        return len(self._waiting)

    def add(self, stamp_ns: int, data: bytes) -> bool:
        """Collect bytes of the device. Returns whether it is time to pass them on."""
        self._collected.append((stamp_ns, data))
        self._size += len(data)
        self.due_at = self._latest
        return stamp_ns >= self._early_ns or self._size >= SERVER_BYTES

    def pass_on(self) -> None:
        """Send the collected bytes."""
        parts: list[bytes] = []
        for stamp_ns, data in self._collected:
            parts += (_DATA.pack(_DATA_KIND, STAMP.size + len(data), stamp_ns), data)
        self._collected.clear()
        now_ns = time.monotonic_ns()
        self._early_ns, self._latest = now_ns + SERVER_NS - EARLY_NS, (now_ns + SERVER_NS) / 1e9
        self._size, self.due_at = 0, INFINITY
        self.send(b"".join(parts))

    def send(self, data: bytes) -> None:
        """Send, after the bytes collected before."""
        if self._collected:
            self.pass_on()
        self._waiting += data
        self.flush()

    def keep(self, data: bytes) -> None:
        """Let bytes wait that the server has not taken."""
        self._waiting += data

    def flush(self) -> None:
        """Send what waits, as far as it is taken; errors show when reading."""
        try:
            while self._waiting:
                del self._waiting[: self._connection.send(self._waiting)]
        except OSError:
            return

    def read(self) -> list[tuple[MessageKind, bytes]]:
        """Messages of the server.

        Raises:
            OSError: it is gone.
            MessageError: it speaks something else.
        """
        data = self._connection.recv(1 << 16)
        if not data:
            raise OSError(errno.EPIPE, "closed")
        return list(self._reader.feed(data))

    def close(self) -> None:
        self._connection.close()
