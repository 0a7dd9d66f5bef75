"""The page behind a proxy that has put it below a path, as one of several at the address of a robot."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from socketserver import BaseRequestHandler, ThreadingTCPServer
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Page

from tests.conftest import READY
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

TOKEN = "a-token-of-this-test-only"


class PathProxy(ThreadingTCPServer):
    """A proxy that hands on what is below PATH, one request for each connection.

    Attributes:
        strays: requests for something else.
    """

    PATH = "/imu"
    daemon_threads = True
    allow_reuse_address = True

    def __init__(self, target: str, *, passes_sockets: bool) -> None:
        super().__init__(("127.0.0.1", 0), _Connection)
        self.target = urlsplit(target)
        self.passes_sockets = passes_sockets
        self.strays: list[str] = []
        self.url = f"http://127.0.0.1:{self.server_address[1]}{self.PATH}/"


class _Connection(BaseRequestHandler):
    server: PathProxy

    def handle(self) -> None:
        with suppress(OSError):
            self._hand_on()

    def _hand_on(self) -> None:
        head = b""
        while b"\r\n\r\n" not in head:
            if not (more := self.request.recv(65_536)):
                return
            head += more
        first, _, rest = head.partition(b"\r\n")
        method, path, _ = first.decode().split(" ")
        is_socket = b"\r\nupgrade: websocket" in head.lower()
        if not path.startswith(f"{PathProxy.PATH}/"):
            self.server.strays.append(path)
            return
        if is_socket and not self.server.passes_sockets:
            self.request.sendall(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n")
            return
        with socket.create_connection((self.server.target.hostname, self.server.target.port)) as robot:
            more = "X-Forwarded-For: 10.0.0.9\r\nX-Forwarded-Proto: http\r\n"
            if not is_socket:
                more += "Connection: close\r\n"
                rest = b"\r\n".join(line for line in rest.split(b"\r\n") if not line.lower().startswith(b"connection:"))
            robot.sendall(f"{method} {path.removeprefix(PathProxy.PATH)} HTTP/1.1\r\n{more}".encode() + rest)
            threading.Thread(target=_copy, args=(self.request, robot), daemon=True).start()
            _copy(robot, self.request)


def _copy(source: socket.socket, target: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(65_536):
            target.sendall(data)
        target.shutdown(socket.SHUT_WR)


@pytest.fixture
def proxy(serve: Callable[..., ServerProcess], tmp_path: Path) -> Iterator[Callable[..., PathProxy]]:
    """Starts a proxy of a server with a token."""
    config = tmp_path / "imuscope.toml"
    config.write_text(f'control_token = "{TOKEN}"\n')
    server = serve("sim:xbus?rate=20", arguments=("--config", str(config)))
    begun: list[PathProxy] = []

    def begin(*, passes_sockets: bool = True) -> PathProxy:
        begun.append(PathProxy(server.url, passes_sockets=passes_sockets))
        threading.Thread(target=begun[-1].serve_forever, args=(0.05,), daemon=True).start()
        return begun[-1]

    yield begin
    for one in begun:
        one.shutdown()
        one.server_close()


def test_everything_is_requested_below_the_path(
    proxy: Callable[..., PathProxy], open_page: Callable[..., Page]
) -> None:
    behind = proxy()
    page = open_page(f"{behind.url}?token={TOKEN}")
    until(page, READY)
    assert page.url.partition("#")[0] == behind.url, "the token has gone from the address, the path has not"
    page.goto(f"{behind.url}#/recordings")
    until(page, "document.querySelector('h1, h2')?.innerText.includes('Library')")
    for place in ("docs", "docs/http-api"):
        page.goto(behind.url + place)
        until(page, "getComputedStyle(document.querySelector('header')).display === 'flex'")
        places = page.evaluate("[...document.querySelectorAll('a[href]')].map(link => new URL(link.href).pathname)")
        assert {PathProxy.PATH} == {name[: len(PathProxy.PATH)] for name in places}
    assert behind.strays == []


def test_a_proxy_that_passes_no_websocket_is_not_a_server_that_stopped(
    proxy: Callable[..., PathProxy], browser: Browser
) -> None:
    page = browser.new_page()  # which may complain
    page.goto(f"{proxy(passes_sockets=False).url}?token={TOKEN}")
    until(page, "/its WebSocket cannot be opened/.test(document.body.innerText)")
    assert "Access refused" not in page.inner_text("body")
    page.close()
