"""The holder's end of the connection to the server."""

from __future__ import annotations

import errno
import socket
import struct

from imuscope.server.extensions.shares.holder.messages import STAMP, MessageKind, MessageReader, message

_CREDENTIALS = struct.Struct("3i")  # process, user and group of the other end, see unix(7)
SERVER_S = 0.008
"""Bytes of the device are collected for this long: their stamps go with them, and fewer messages cost less."""


class ServerConnection:
    """The connection to the server. Bytes of the device are collected for a moment: their stamps go with them."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self.fd = connection.fileno()
        peer = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        self.pid: int = _CREDENTIALS.unpack(peer)[0]
        self._reader = MessageReader()
        self._waiting = bytearray()
        self._collected: list[tuple[int, bytes]] = []
        self.collected = 0
        self.due_at = 0.0

    @property
    def backlog(self) -> int:
        return len(self._waiting)

    def add(self, stamp_ns: int, data: bytes) -> None:
        """Collect bytes of the device."""
        self._collected.append((stamp_ns, data))
        self.collected += len(data)
        if not self.due_at:
            self.due_at = stamp_ns / 1e9 + SERVER_S

    def pass_on(self) -> None:
        """Send the collected bytes."""
        data = b"".join([message(MessageKind.DATA, STAMP.pack(stamp) + data) for stamp, data in self._collected])
        self._collected.clear()
        self.collected, self.due_at = 0, 0.0
        self.send(data)

    def send(self, data: bytes) -> None:
        """Send, after the bytes collected before."""
        if self._collected:
            self.pass_on()
        self._waiting += data
        self.flush()

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
