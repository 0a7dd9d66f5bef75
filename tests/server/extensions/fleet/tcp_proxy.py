"""A TCP proxy that is cut when a test says so, and one that fails like a bad line before an S3 server."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections import Counter

BUSY = b"HTTP/1.1 503 Slow Down\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class TcpProxy:
    """A TCP proxy on loopback, until it is cut.

    Args:
        port: of the server.
    """

    def __init__(self, port: int) -> None:
        self._server_port = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._open: set[socket.socket] = set()
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Cut the line for good."""
        for one in (self._listener, *self._open):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        self._forward(client)

    def _forward(self, client: socket.socket) -> None:
        with client, contextlib.suppress(OSError):
            server = socket.create_connection(("127.0.0.1", self._server_port))
            self._open |= {client, server}
            threading.Thread(target=self._copy, args=(server, client), daemon=True).start()
            self._copy(client, server)

    def _copy(self, source: socket.socket, target: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while (data := source.recv(65536)) and self._passes(source, data):
                target.sendall(data)
        for one in (source, target):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _passes(self, source: socket.socket, data: bytes) -> bool:
        """Whether data are passed on; if not, the connection is cut."""
        return True


class FaultyProxy(TcpProxy):
    """Of three connections the first is answered by 503, and the second is cut after some bytes to the server."""

    def __init__(self, port: int, cut_after: int = 8192) -> None:
        self.faults: Counter[str] = Counter()
        self._cut_after = cut_after
        self._left: dict[socket.socket, int] = {}
        self._count = 0
        super().__init__(port)

    def __enter__(self) -> FaultyProxy:
        return self

    def __exit__(self, *_: object) -> None:
        self.cut()

    def _serve(self, client: socket.socket) -> None:
        self._count += 1
        if self._count % 3 == 1:
            with client, contextlib.suppress(OSError):
                client.recv(65536)
                client.sendall(BUSY)
                self.faults["503"] += 1
            return
        if self._count % 3 == 2:
            self._left[client] = self._cut_after
        self._forward(client)

    def _passes(self, source: socket.socket, data: bytes) -> bool:
        if source not in self._left:
            return True
        self._left[source] -= len(data)
        if self._left[source] < 0:
            self.faults["cut"] += 1
        return self._left[source] >= 0
