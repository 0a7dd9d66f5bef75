"""A line of limited rate to a store: a proxy on loopback, used by the libraries of this process alone.

    obstore, delta-rs ─> LimitedLine ─> server of the store       CONNECT for https, absolute addresses for http

The libraries send parts of some MB as fast as the network takes them, which would delay live data on the same line by
seconds. Here bytes pass in small pieces at an even rate, and TCP slows the libraries down. Each direction has the rate:
stored data are read back. A request without the secret of this proxy is refused, so no other process can use it.
"""

import base64
import contextlib
import re
import secrets
import socket
import threading
import time
from dataclasses import dataclass, field
from types import TracebackType
from urllib.parse import urlsplit

from imuscope.server.concurrency.limiters import TokenBucket

PIECE_BYTES = 4096
BURST_S = 0.05
CONNECT_S = 10.0
SILENCE_S = 120.0  # in both directions; a request that waits longer for its answer is repeated
MAX_HEAD = 65_536
_CONNECT = re.compile(rb"CONNECT (\[[0-9A-Fa-f:.]+\]|[^\s:]+):(\d{1,5}) ")
_OTHER = re.compile(rb"[A-Z]+ (http://\S+) ")
_CREDENTIALS = re.compile(rb"\r\nProxy-Authorization: *Basic ([A-Za-z0-9+/=]+)\r\n", re.IGNORECASE)
REFUSED = b"HTTP/1.1 407 Proxy Authentication Required\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
UNREACHABLE = b"HTTP/1.1 502 Bad Gateway\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class LineRate:
    """An even rate, shared by threads.

    Args:
        rate: bytes/s.
    """

    def __init__(self, rate: float) -> None:
        self._lock = threading.Lock()
        self._bucket = TokenBucket(rate, rate * BURST_S, time.monotonic())
        self._bucket.acquire(time.monotonic(), rate * BURST_S)  # no burst before anything was sent

    def wait(self, size: int) -> None:
        """Wait until so many bytes may pass."""
        with self._lock:
            now = time.monotonic()
            pause = self._bucket.wait_s(now, size)
            self._bucket.acquire(now, size)
        if pause > 0:
            time.sleep(pause)


class LimitedLine:
    """The proxy.

    Args:
        rate: bytes/s in each direction.
    """

    def __init__(self, rate: float) -> None:
        secret = secrets.token_hex(16)
        self._credentials = base64.b64encode(f"imuscope:{secret}".encode())
        self._up, self._down = LineRate(rate), LineRate(rate)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://imuscope:{secret}@127.0.0.1:{self._listener.getsockname()[1]}"

    def __enter__(self) -> "LimitedLine":
        threading.Thread(target=self._accept, name="limited line", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _close(self._listener)

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        server: socket.socket | None = None
        try:
            client.settimeout(SILENCE_S)
            head, rest = _head_of(client)
            credentials = _CREDENTIALS.search(head)
            if credentials is None or not secrets.compare_digest(credentials[1], self._credentials):
                client.sendall(REFUSED)
                return
            tunnel, other = _CONNECT.match(head), _OTHER.match(head)
            if tunnel is not None:
                place = (tunnel[1].decode().strip("[]"), int(tunnel[2]))
            elif other is not None:
                parts = urlsplit(other[1].decode())
                place = (parts.hostname or "", parts.port or 80)
            else:
                return
            try:
                server = socket.create_connection(place, CONNECT_S)
            except OSError:
                client.sendall(UNREACHABLE)
                return
            server.settimeout(SILENCE_S)
            if tunnel is not None:
                client.sendall(b"HTTP/1.1 200 Connection established\r\n\r\n")
            else:
                self._up.wait(len(head))
                server.sendall(head)
            passed = _Passed()
            back = threading.Thread(target=_copy, args=(server, client, self._down, passed), daemon=True)
            back.start()
            self._up.wait(len(rest))
            server.sendall(rest)
            _copy(client, server, self._up, passed)
            back.join()
        except (OSError, ValueError):
            return
        finally:
            _close(client)
            if server is not None:
                _close(server)


def _head_of(client: socket.socket) -> tuple[bytes, bytes]:
    """Head of a request, and what followed it in the same read.

    Raises:
        ValueError: there is none.
    """
    data = b""
    while b"\r\n\r\n" not in data:
        piece = client.recv(PIECE_BYTES)
        data += piece
        if not piece or len(data) > MAX_HEAD:
            raise ValueError
    head, end, rest = data.partition(b"\r\n\r\n")
    return head + end, rest


@dataclass(slots=True)
class _Passed:
    """Time at which bytes passed last, in either direction."""

    at: float = field(default_factory=time.monotonic)


def _copy(source: socket.socket, target: socket.socket, pace: LineRate, passed: _Passed) -> None:
    """Pass bytes until the source ends, either fails, or nothing passed in either direction; then both end."""
    with contextlib.suppress(OSError):
        while True:
            try:
                data = source.recv(PIECE_BYTES)
            except TimeoutError:
                if time.monotonic() - passed.at < SILENCE_S:
                    continue
                break
            if not data:
                break
            pace.wait(len(data))
            target.sendall(data)
            passed.at = time.monotonic()
    for one in (source, target):
        with contextlib.suppress(OSError):
            one.shutdown(socket.SHUT_RDWR)


def _close(one: socket.socket) -> None:
    with contextlib.suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)
    one.close()
