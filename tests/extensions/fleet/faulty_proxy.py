"""A proxy that fails like a bad line before an S3 server: it answers 503, and cuts connections in the middle."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections import Counter
from types import TracebackType

BUSY = b"HTTP/1.1 503 Slow Down\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class FaultyProxy:
    """A TCP proxy on loopback. Of three connections the first is answered by 503, and the second is cut.

    Args:
        port: of the server.
        cut_after: bytes to the server after which a connection is cut.
    """

    def __init__(self, port: int, cut_after: int = 8192) -> None:
        self.faults: Counter[str] = Counter()
        self._server_port, self._cut_after = port, cut_after
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._open: set[socket.socket] = set()
        self._count = 0

    def __enter__(self) -> FaultyProxy:
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for one in (self._listener, *self._open):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            self._count += 1
            work = (self._forward, self._busy, self._cut)[self._count % 3]
            threading.Thread(target=work, args=(client,), daemon=True).start()

    def _busy(self, client: socket.socket) -> None:
        with client, contextlib.suppress(OSError):
            client.recv(65536)
            client.sendall(BUSY)
            self.faults["503"] += 1

    def _cut(self, client: socket.socket) -> None:
        self._forward(client, self._cut_after)

    def _forward(self, client: socket.socket, most: int | None = None) -> None:
        server = socket.create_connection(("127.0.0.1", self._server_port))
        self._open |= {client, server}
        threading.Thread(target=self._copy, args=(server, client, None), daemon=True).start()
        self._copy(client, server, most)

    def _copy(self, source: socket.socket, target: socket.socket, most: int | None) -> None:
        done = 0
        with contextlib.suppress(OSError):
            while data := source.recv(16384):
                done += len(data)
                if most is not None and done > most:
                    self.faults["cut"] += 1
                    break
                target.sendall(data)
        for one in (source, target):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()
