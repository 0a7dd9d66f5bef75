"""An HTTP server that webhooks are delivered to, in tests."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from tests.support.timeouts import PATIENCE_S


class Receiver(ThreadingHTTPServer):
    """An HTTP server that keeps what is posted.

    Attributes:
        answers: status of the next answers; 204 after them.
        is_open: answers are sent only while it is set.
    """

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.answers: list[int] = []
        self.is_open = threading.Event()
        self.is_open.set()
        self.paths: list[str] = []
        self.authorizations: list[str] = []
        self.bodies: list[dict[str, Any]] = []
        self._thread = threading.Thread(target=self.serve_forever, args=(0.01,))
        self._thread.start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}/hook?key=secret"

    def end(self) -> None:
        self.is_open.set()
        self.shutdown()
        self._thread.join()
        self.server_close()


class Handler(BaseHTTPRequestHandler):
    def do_POST(self) -> None:
        receiver = self.server
        assert isinstance(receiver, Receiver)
        body = json.loads(self.rfile.read(int(self.headers["content-length"])))
        receiver.paths.append(self.path)
        receiver.authorizations.append(self.headers["authorization"] or "")
        receiver.bodies.append(body)
        receiver.is_open.wait(PATIENCE_S)
        self.send_response(receiver.answers.pop(0) if receiver.answers else 204)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def receiving() -> Iterator[Receiver]:
    receiver = Receiver()
    try:
        yield receiver
    finally:
        receiver.end()


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    with receiving() as receiver:
        yield receiver
