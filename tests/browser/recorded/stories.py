"""The built page, told what a server has sent before: no server, no simulator, and a clock that stands still.

    server/page ─────────────── GET ──┐
    tests/golden/wire: answers ─ /api ─┼──> a page in Chromium, at the time of its newest sample
                       frames ── /ws ──┘

What is on the page is the same each time, and nothing on it moves by itself, so that a look at its layout or its
colours takes no time and no luck. A request without a recorded answer gets 404, which the console reports, which
fails the test.

The clock stands still in the page's window (CLOCK), not in its worker, which declares a silent connection dead: it gets
a line now and then (KEEP_S).
"""

from __future__ import annotations

import base64
import hashlib
import json
import mimetypes
import struct
import threading
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from playwright.sync_api import Page

from imuscope.server.api.static_files import HEADERS
from tests.conftest import READY
from tests.support.chromium import until
from tests.support.server_process import ROOT
from tests.web.record_wire import recorded

PAGE = ROOT / "server" / "page"
KEEP_S = 0.5
#: A window of two seconds shows the samples.
SOON_S = 1.4
PNG = b"\x89PNG"
_MAGIC = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"  # RFC 6455, 1.3

CLOCK = """(() => {
  let now = TIME * 1000 - performance.timeOrigin;
  performance.now = () => now;
  window.turnClock = seconds => { now += seconds * 1000; };
})()"""

Answer = Any
"""JSON, bytes, or a function of the query and the body that gives one of these."""

_NO_STORE = {
    "store": "",
    "at_once": 2,
    "running": 0,
    "waiting": 0,
    "timeout_s": 60.0,
    "memory_mb": 1024,
    "questions": [],
}
USUAL_STORIES: dict[str, Answer] = {
    "GET /api/ports": [],
    "GET /api/extensions": [],
    "GET /api/query": _NO_STORE,
    "GET /api/alarms": [],
    "GET /api/workspaces": {"workspaces": [], "defaults": {}},
    "GET /api/recordings": [],
    "GET /api/recorder": {"op": "recorder", "running": False, "id": "", "title": "", "devices": [], "started": None}
    | {"bytes": 0, "behind_s": 0.0, "free": None, "seconds_left": None, "message": "", "hint": "", "headless": []},
    "GET /api/recorder/memory": [],
    "GET /api/recorder/storage": {"used": 0, "free": 10**9, "quota": 0},
    "GET /api/uploads": {"enabled": False, "store": "", "robot": "", "problem": "", "recordings": []},
    "GET /api/map": {"tiles": False, "attribution": ""},
    "GET /api/views/scene": {"address": "/viser/"},
    "POST /api/analysis/histogram": [],  # of a histogram that a page begins with before another analysis is chosen
}
"""Answers of a server that has nothing."""


class Story:
    """A page's server, of recorded frames.

    Args:
        names: of files in tests/golden/wire; the first one's frames are sent, answers come from all.
        answers: more of them, by method and path, with or without the query; a path that ends with `/*` is of all
        below it.
    """

    def __init__(self, *names: str, answers: Mapping[str, Answer] | None = None) -> None:
        scenes = [recorded(name) for name in names]
        self.samples = [base64.b64decode(one) for one in scenes[0]["samples"]]
        self.texts: list[Any] = [self._soon_after(text) for text in scenes[0].get("read", scenes[0]["texts"])]
        self.answers = dict(USUAL_STORIES)
        for scene in scenes:
            self.answers |= scene["answers"]
        self.answers |= answers or {}
        self.requests: list[str] = []
        self._pages: list[Page] = []
        self._ended = threading.Event()
        handler = type("Handler", (_Handler,), {"story": self})
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self._server.daemon_threads = True
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self.url = f"http://127.0.0.1:{self._server.server_port}"

    def _soon_after(self, text: Any) -> Any:
        """A greeting soon after the samples: settings were read in between, which took longer on a slow machine."""
        if text["op"] != "hello" or not self.samples:
            return text
        [sent] = struct.unpack_from("<d", self.samples[-1], 32)
        return {**text, "server_time": min(text["server_time"], sent + SOON_S)}

    def __enter__(self) -> Story:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        for page in self._pages if kind is None else ():  # of a failure they are looked at
            page.context.close()  # before it would miss the server
        self._ended.set()
        self._server.shutdown()
        self._server.server_close()

    @property
    def time(self) -> float:
        """Time of the newest figures, unix s."""
        [health] = [text for text in self.texts if text["op"] == "health"]
        [hello] = [text for text in self.texts if text["op"] == "hello"]
        return float(max([one["time"] for one in health["devices"]], default=hello["server_time"]))

    def open(self, open_page: Callable[..., Page], place: str = "", **how: Any) -> Page:
        """The page at a place, connected and shown."""
        page = open_page(self.url + place, before=CLOCK.replace("TIME", repr(self.time)), **how)
        self._pages.append(page)
        until(page, "window.imuscope?.store.connection.value === 'open' && !window.imuscope.store.filling.value")
        until(page, READY if self.samples and place.partition("?")[0] in ("", "/", "/#/") else "true")  # for its keys
        return page

    def answer(self, method: str, path: str, body: str) -> Answer:
        """What is recorded for a request; None if nothing is."""
        self.requests.append(f"{method} {path}")
        place, _, query = path.partition("?")
        ordered = f" {json.dumps(json.loads(body), sort_keys=True)}" if body else ""
        for key in (f"{method} {path}{ordered}", f"{method} {path}", f"{method} {place}{ordered}", f"{method} {place}"):
            if key in self.answers:
                result = self.answers[key]
                return result(parse_qs(query), json.loads(body or "null")) if callable(result) else result
        below = (key for key in self.answers if key.endswith("/*") and f"{method} {place}".startswith(key[:-1]))
        return next((self.answers[key] for key in below), None)

    def send_all(self, send: Callable[[str | bytes], None]) -> None:
        """What is sent to a page, until the story ends."""
        for text in self.texts:
            if text["op"] != "history_end":
                send(json.dumps(text))
        for sample in self.samples:
            send(sample)
        send(json.dumps({"op": "history_end"}))
        while not self._ended.wait(KEEP_S):
            send(json.dumps({"op": "history_end"}))


class _Handler(BaseHTTPRequestHandler):
    story: Story
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        if self.headers.get("upgrade", "").lower() == "websocket":
            return self._stream()
        path = urlsplit(self.path).path
        if path.startswith("/api/"):
            return self._answer()
        file = (PAGE / (path.lstrip("/") or "index.html")).resolve()
        if PAGE not in file.parents or not file.is_file():
            return self._send(404, b"", "text/plain")
        return self._send(200, file.read_bytes(), mimetypes.guess_type(file.name)[0] or "text/plain")

    def _answer(self) -> None:
        body = self.rfile.read(int(self.headers.get("content-length") or 0)).decode()
        result = self.story.answer(self.command, self.path, body)
        if isinstance(result, bytes):
            return self._send(200, result, "image/png" if result.startswith(PNG) else "application/octet-stream")
        missing = {"kind": "not-found", "message": f"Nothing was recorded of {self.path}.", "hint": ""}
        status, report = (404, missing) if result is None else (200, result)
        return self._send(status, json.dumps(report).encode(), "application/json")

    do_POST = _answer  # noqa: N815 (the base class calls these)
    do_PUT = _answer  # noqa: N815
    do_PATCH = _answer  # noqa: N815
    do_DELETE = _answer  # noqa: N815

    def _send(self, status: int, content: bytes, kind: str) -> None:
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.send_header("content-type", kind)
        if kind == "application/octet-stream":
            self.send_header("x-exact", "1")  # all samples of a window
        self.send_header("content-length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def _stream(self) -> None:
        accept = hashlib.sha1((self.headers["sec-websocket-key"] + _MAGIC).encode()).digest()
        self.send_response(101)
        self.send_header("upgrade", "websocket")
        self.send_header("connection", "Upgrade")
        self.send_header("sec-websocket-accept", base64.b64encode(accept).decode())
        self.send_header("sec-websocket-protocol", self.headers["sec-websocket-protocol"].split(",")[0])
        self.end_headers()
        self.close_connection = True
        try:
            self.story.send_all(self._send_frame)
        except OSError:
            return  # the page has gone

    def _send_frame(self, content: str | bytes) -> None:
        data = content.encode() if isinstance(content, str) else content
        kind = 0x81 if isinstance(content, str) else 0x82
        large = struct.pack(">BH", 126, len(data)) if len(data) < 0x10000 else struct.pack(">BQ", 127, len(data))
        size = bytes([len(data)]) if len(data) < 126 else large
        self.wfile.write(bytes([kind]) + size + data)
        self.wfile.flush()

    def log_message(self, *_: Any) -> None:
        return
