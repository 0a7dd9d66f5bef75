"""The robot's end of its pages at a fleet server: requests from the bus, answered by its own application.

    bus ─> Inbox ─> OpenStream ─> a task: application(scope, receive, send) ─> ResponseHead, ResponsePart … ─> bus

The application runs in this process, so routes, limits and locks are those of the robot's own page. Its guard of tokens
is replaced by the rules here: only what `fleet.pages` allows, only /api and /ws, and the role that the fleet server
granted. Commands are reported as events. A job that a request began belongs to the robot: neither a viewer that leaves
nor a line that is lost ends it, nor its way back.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import logging
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import msgspec

from imuscope.server import wire
from imuscope.server.access.route_rules import RouteRules
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.inbox import Inbox
from imuscope.server.extensions.fleet.model.summaries import PagesAllowed
from imuscope.server.extensions.fleet.tunnel.flow_control import Window
from imuscope.server.extensions.fleet.tunnel.http_tunnel_protocol import (
    MAX_OPEN,
    Acknowledge,
    Answer,
    CancelStream,
    ClientMessage,
    EndStream,
    KeepAlive,
    OpenStream,
    ResponseHead,
    ResponsePart,
    StreamError,
    TunnelMessageError,
    decode_request,
    encode,
)
from imuscope.server.text.printable import printable

if TYPE_CHECKING:
    import zenoh
    from starlette.types import ASGIApp, Message

log = logging.getLogger("imuscope.fleet")

MAX_SERVERS = 8
MAX_CLIENT_MESSAGE = 200
"""Messages of a browser that wait to be read."""
SILENCE_S = 15.0
"""A fleet server that sends nothing for this long is disconnected, and its streams with it."""
LEAVE_S = 5.0
HEADERS = frozenset(
    {
        *("accept-ranges", "cache-control", "content-disposition", "content-encoding", "content-length"),
        *("content-range", "content-type", "etag", "last-modified", "retry-after", "vary"),
    }
)
"""Headers of an answer that are sent; cookies and redirections are not."""


def check_allowed(request: OpenStream, pages: PagesAllowed, *, changes: bool) -> None:
    """Refuse what the robot does not let through.

    Args:
        pages: `fleet.pages`.
        changes: whether it changes something.

    Raises:
        DomainError: with the reason and what to do.
    """
    path = request.path
    setting = "in the table [fleet] of the robot's configuration file"
    if pages == "off":
        hint = f'Set pages = "view" {setting}.'
        raise DomainError("not-now", "This robot does not show its pages through the fleet server.", hint)
    if not (path == "/ws" if request.socket is not None else path.startswith("/api/")):
        raise DomainError(
            "not-found", "This is not available through the fleet server.", "Open the page at the robot's own address."
        )
    if changes:
        if request.role != "control":
            raise DomainError("view-only", "This token is view-only.", "Open the page with a control token.")
        if pages != "control":
            hint = f'Set pages = "control" {setting}, or open the page at the robot\'s own address.'
            raise DomainError("view-only", "This robot may only be viewed through the fleet server.", hint)


class PageServer:
    """The pages of this robot. To be used in the event loop, except `declare`.

    Args:
        name, boot: the robot and this run of it.
        pages: `fleet.pages`.
        rules: of the routes of its pages.
        report: takes an event: level and text.
        delay_of: seconds until so many bytes may be sent; 0: they are counted as sent now.
    """

    def __init__(
        self,
        name: str,
        boot: str,
        pages: PagesAllowed,
        rules: RouteRules,
        report: Callable[[wire.Level, str], None],
        delay_of: Callable[[int], float] = lambda size: 0.0,
    ) -> None:
        self._name, self._boot, self.pages = name, boot, pages
        self._rules, self._report, self._delay_of = rules, report, delay_of
        self._inbox = Inbox(self.take)
        self._app: ASGIApp | None = None
        self._session: zenoh.Session | None = None
        self._streams: dict[tuple[str, int], RobotStream] = {}
        self._last_messages: dict[str, float] = {}  # fleet server → when, monotonic s
        self._line = asyncio.Lock()  # one message at a time, in order of arrival: streams take turns

    @property
    def streams(self) -> int:
        """Number of requests and WebSockets that are open."""
        return len(self._streams)

    def serve(self, app: ASGIApp) -> None:
        """Begin to answer with this application, without its guard."""
        self._app = app
        self._inbox.start()

    def declare(self, session: zenoh.Session) -> object:
        """Begin to receive; from any thread. Returns what has to be kept."""
        self._session = session

        def on_request(sample: zenoh.Sample) -> None:
            self._inbox.put(keys.server_of(str(sample.key_expr)), sample.payload.to_bytes())

        return session.declare_subscriber(keys.request_key(self._name), on_request)

    def tick(self) -> None:
        """Close streams of disconnected fleet servers. Call once a second."""
        now = time.monotonic()
        for server in [one for one, received_at in self._last_messages.items() if now - received_at > SILENCE_S]:
            del self._last_messages[server]
            self._stop_all(server)

    def line_lost(self) -> None:
        """End all streams."""
        self._last_messages.clear()
        self._stop_all()

    async def close(self) -> None:
        """End all streams, at once."""
        tasks = [stream.task for stream in self._streams.values()]
        await end_tasks(*tasks)

    def _stop_all(self, server: str = "") -> None:
        for stream in list(self._streams.values()):
            if not server or stream.server == server:
                stream.stop()

    def take(self, server: str, data: bytes) -> None:
        """Take over a message of a fleet server."""
        if not server:
            return
        try:
            message = decode_request(data)
        except TunnelMessageError as error:
            log.warning("A message of the fleet server is ignored. %s", error, extra={"often": ("pages", server)})
            return
        if server not in self._last_messages and len(self._last_messages) >= MAX_SERVERS:
            return
        self._last_messages[server] = time.monotonic()
        if isinstance(message, KeepAlive):
            if message.boot == self._boot:
                mine = tuple(stream for name, stream in self._streams if name == server)
                self._put_soon(server, KeepAlive(self._boot, message.last, mine))
        elif isinstance(message, OpenStream):
            self._open(server, message)
        elif (stream := self._streams.get((server, message.stream))) is not None:
            stream.take(message)

    def _open(self, server: str, request: OpenStream) -> None:
        place = server, request.stream
        if request.boot != self._boot or place in self._streams:
            return
        changes = request.socket is None and self._rules.is_command(request.method, request.path)
        words = f"{printable(request.who) or 'an unnamed viewer'}: {request.method} {printable(request.path[:200])}"
        try:
            if self._app is None or len(self._streams) >= MAX_OPEN:
                words = f"This robot answers at most {MAX_OPEN} requests through the fleet server at once."
                raise DomainError("full", words, "Close an unused page, or try again later.")
            check_allowed(request, self.pages, changes=changes)
        except DomainError as error:
            if changes:
                self._report("warning", f"Refused a command through the fleet server of {words}. {error.message}")
            self._put_soon(server, StreamError(request.stream, 0, error.kind, error.message, error.hint))
            return
        if changes:
            self._report("info", f"Command through the fleet server of {words}.")
        stream = self._streams[place] = RobotStream(self, server, request, may_cancel=not changes)
        stream.task = asyncio.create_task(stream.run(self._app), name="page for the fleet")
        stream.task.add_done_callback(lambda _: self._streams.pop(place, None))

    def _put_soon(self, server: str, answer: Answer) -> None:
        task = asyncio.create_task(self.put(server, answer), name="answer for the fleet")
        _RUNNING.add(task)
        task.add_done_callback(_RUNNING.discard)

    async def put(self, server: str, answer: Answer) -> None:
        """Send a message. Waits for the line, never in the event loop."""
        data = encode(answer)
        async with self._line:
            while delay := self._delay_of(len(data)):
                await asyncio.sleep(delay)
            await asyncio.to_thread(self._write, keys.answers(server, self._name), data)

    def _write(self, key: str, data: bytes) -> None:
        import zenoh

        session = self._session
        if session is None:
            return
        with contextlib.suppress(zenoh.ZError):  # a closed session: the streams are ended
            session.put(
                key,
                data,
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=zenoh.Priority.DATA_LOW,  # reports and their answers come first
            )


_RUNNING: set[asyncio.Task[None]] = set()
"""Tasks without another reference, which would be collected."""


class RobotStream:
    """A request or a WebSocket of a viewer.

    Args:
        may_cancel: whether a request may end before it is answered: it changes nothing.
    """

    task: asyncio.Task[None]

    def __init__(self, pages: PageServer, server: str, request: OpenStream, *, may_cancel: bool) -> None:
        self.server = server
        self._pages, self._request, self._may_cancel = pages, request, may_cancel
        self._is_socket = request.socket is not None
        self._window = Window()
        self._number = 0  # of the next message that is sent
        self._expected = 1
        self._client_messages: deque[Message] = deque()
        self._news = asyncio.Event()
        self._is_stopped = self._has_begun = self._has_ended = False
        first: Message = {"type": "http.request", "body": request.body, "more_body": False}
        self._client_messages.append({"type": "websocket.connect"} if self._is_socket else first)

    # ── from the fleet server ────────────────────────────────────────────────────────────────────────────────────────

    def take(self, message: ClientMessage | Acknowledge | CancelStream) -> None:
        """Take over a message; a gap in the numbers ends the stream."""
        is_next = message.number == self._expected
        self._expected += 1
        if not is_next or isinstance(message, CancelStream):
            self.stop()
        elif isinstance(message, Acknowledge):
            if not self._window.acknowledge(message.size, time.monotonic()):
                self.stop()
        elif self._is_socket and len(self._client_messages) < MAX_CLIENT_MESSAGE:
            self._client_messages.append({"type": "websocket.receive", "text": message.text})
            self._news.set()
        else:
            self.stop()

    def stop(self) -> None:
        """Handle a disconnected viewer: cancel reads, let commands finish."""
        if self._is_stopped:
            return
        self._is_stopped = True
        self._window.close()
        self._news.set()
        if self._is_socket:
            asyncio.get_running_loop().call_later(LEAVE_S, self.task.cancel)
        elif self._has_begun or self._may_cancel:
            self.task.cancel()

    # ── the application ──────────────────────────────────────────────────────────────────────────────────────────────

    async def run(self, app: ASGIApp) -> None:
        try:
            await app(self._scope(), self._receive, self._send)
            if not self._has_ended:
                await self._put(EndStream(0, 0, 1011, ""))
        except asyncio.CancelledError:
            raise
        except Exception:  # the framework has logged it
            if not self._has_ended and not self._is_stopped:
                await self._put(StreamError(0, 0, "fault", "The robot failed to answer.", "Its log has the reason."))
        finally:
            self._window.close()

    def _scope(self) -> dict[str, Any]:
        request = self._request
        scope: dict[str, Any] = {
            "type": "websocket" if self._is_socket else "http",
            "asgi": {"version": "3.0", "spec_version": "2.3"},
            "http_version": "1.1",
            "scheme": "ws" if self._is_socket else "http",
            "path": request.path,
            "raw_path": quote(request.path).encode(),
            "query_string": request.query.encode("latin-1", "replace"),
            "root_path": "",
            "headers": [
                (b"host", b"fleet"),
                *((name.encode(), text.encode("latin-1")) for name, text in request.headers),
            ],
            "client": (_address(request.peer), 0),
            "server": None,
            "state": {"role": request.role if self._pages.pages == "control" else "view"},
            "extensions": {},
        }
        if self._is_socket:
            scope["subprotocols"] = list(request.socket or ())
            scope["extensions"] = {"imuscope.transport": self}
        else:
            scope["method"] = request.method
        return scope

    async def _receive(self) -> Message:
        while not self._client_messages:
            if self._is_stopped:
                gone = {"type": "websocket.disconnect", "code": 1006}
                return gone if self._is_socket else {"type": "http.disconnect"}
            self._news.clear()
            await self._news.wait()
        return self._client_messages.popleft()

    async def _send(self, message: Message) -> None:
        if self._is_stopped or self._has_ended:
            return
        kind = message["type"]
        if kind == "http.response.start":
            self._has_begun = True
            await self._put(ResponseHead(0, 0, message["status"], _sent_headers(message.get("headers", ()))))
        elif kind == "http.response.body":
            await self._put_parts(message.get("body", b""))
            if not message.get("more_body", False):
                await self._put(EndStream(0, 0))
        elif kind == "websocket.accept":
            self._has_begun = True
            await self._put(ResponseHead(0, 0, subprotocol=message.get("subprotocol") or ""))
        elif kind == "websocket.send":
            text = message.get("text")
            data = message.get("bytes", b"") if text is None else text.encode()
            await self._put_parts(data, is_text=text is not None, is_message=True)
        elif kind == "websocket.close":
            await self._put(EndStream(0, 0, message.get("code", 1000), (message.get("reason") or "")[:120]))

    async def _put_parts(self, data: bytes, *, is_text: bool = False, is_message: bool = False) -> None:
        start = 0
        while start < len(data) or (is_message and not start and not data):
            size = min(self._window.piece, len(data) - start)
            await self._window.wait(size)
            if self._is_stopped:
                return
            stop = start + size
            is_last = is_message and stop == len(data)
            self._window.sent(size, time.monotonic())
            await self._put(ResponsePart(0, 0, bytes(data[start:stop]), is_text, is_last))
            if stop == len(data):
                return
            start = stop

    async def _put(self, answer: ResponseHead | ResponsePart | EndStream | StreamError) -> None:
        self._has_ended |= isinstance(answer, EndStream | StreamError)
        number, self._number = self._number, self._number + 1
        changes = {"stream": self._request.stream, "number": number}
        await self._pages.put(self.server, msgspec.structs.replace(answer, **changes))

    # ── for the sender of the live view, which distinguishes slow browsers from stuck ones ──────────────────────────

    def get_write_buffer_size(self) -> int:
        """Bytes that are not taken yet."""
        return self._window.under_way

    def abort(self) -> None:
        self.stop()


def _sent_headers(headers: Any) -> tuple[tuple[str, str], ...]:
    known = ((bytes(name).decode("latin-1").lower(), bytes(text).decode("latin-1")) for name, text in headers)
    return tuple((name, text) for name, text in known if name in HEADERS)


def _address(peer: str) -> str:
    """The address of a viewer, for limits per address."""
    with contextlib.suppress(ValueError):
        return str(ipaddress.ip_address(peer))
    return "fleet"
