"""HTTP server: uvicorn with our WebSocket protocol.

permessage-deflate off     samples hardly compress, and it costs five times the CPU
proxy headers off          the client is the peer itself; a forwarded request needs a token (server/access/auth.py)
little unsent data         TCP_NOTSENT_LOWAT: data for a slow browser waits in its send queue, where the oldest is
                           dropped, not in megabytes of kernel buffer, where it would become stale
TLS context                of server/http/tls.py, checked once an hour: a renewed certificate needs no restart; the
                           handshake is ours (server/http/connections.py), so that it is counted and bounded in time
transport is passed        in the WebSocket's scope, so that the sender can see whether bytes move
prepared frames            made once for all browsers are sent directly if the socket accepts them at once
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import gc
import json
import logging
import resource
import signal
import socket
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame
from websockets.http11 import Request
from websockets.protocol import State

from imuscope.server.concurrency.heartbeat import next_beat
from imuscope.server.errors import status_of
from imuscope.server.http import shutdown as ending
from imuscope.server.http.connections import ConnectionLimits, Connections, Handshake
from imuscope.server.settings.config import Config
from imuscope.server.system.end_signals import end_signals
from imuscope.server.wire import Problem

if TYPE_CHECKING:
    from starlette.types import ASGIApp

    from imuscope.server.http.tls import CertificateManager

log = logging.getLogger("imuscope.serving")

DATE_S = 1.0  # between two updates of the date of answers
ACCEPTED_S = 0.05  # before the end: connections that are being accepted are known by then, and so are closed
CHECK_INTERVAL_S = 3600.0  # between two checks of the certificate on disk
MAX_FILES = 65_536
SWITCH_S = 0.001  # longest wait of a reading thread for a busy loop, per datagram; 5 ms would lose them
NOT_SENT_BYTES = 64 * 1024  # precedent: HTTP/2 servers, so that priorities stay meaningful
MAX_FROM_BROWSER = 64 * 1024  # a subscribe to all of a few thousand channels
MAX_PINGS = 20  # WebSocket pings per second; a browser sends none, a library one in twenty seconds
ACCEPT_QUEUE = 2048  # connections that the system holds until they are accepted
ACCEPTED_AT_ONCE = 16  # for some turns of the loop before one is read: in a flood it would be the one idle longest
MAX_FRAGMENTS = 1024  # of one message; an empty one adds nothing to its size, and still takes memory
REPORTED = ("Invalid HTTP request received.", "Invalid UTF-8 sequence received from client.")
MAX_FROM_VIEWER = 1024 * 1024  # meshes for the 3D scene are sent in pieces of half that size


class BoundedHttp(H11Protocol):
    """uvicorn's HTTP with bounds: requests must arrive completely within a time limit, and the number of connections is
    limited, so that descriptors are left for recordings and links (server/http/connections.py).
    """

    server_state: Connections
    _request_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        if self.server_state.admit(self):
            self.server_state.moved(self)
            self._start_request_timer()

    def resume_writing(self) -> None:
        self.server_state.moved(self)
        super().resume_writing()

    def _start_request_timer(self) -> None:
        if self._request_timer is None:
            self._request_timer = self.loop.call_later(self.server_state.limits.head_s, self.transport.abort)

    def _cancel_request_timer(self) -> None:
        if self._request_timer is not None:
            self._request_timer.cancel()
            self._request_timer = None

    def data_received(self, data: bytes) -> None:
        self.server_state.moved(self)
        self._start_request_timer()
        super().data_received(data)
        if self.cycle is not None and not self.cycle.response_complete:
            self._cancel_request_timer()  # complete, and being answered

    def send_400_response(self, msg: str) -> None:
        """Report non-HTTP input with its sender, rate-limited: uvicorn's own line (`_is_ours`) has neither."""
        peer = (self.client or ("", 0))[0]
        text = f"Rejected data from {peer or 'an unknown peer'}: {msg}"
        log.warning("%s", text, extra={"event": "no-http", "data": {"peer": peer}, "often": ("no-http", peer)})
        super().send_400_response(msg)

    def handle_websocket_upgrade(self, event: Any) -> None:
        self._cancel_request_timer()
        most = self.server_state.limits.connections // 2
        if self.server_state.websockets >= most:
            self._refuse_websocket(most)
            return
        self.server_state.remove(self)
        super().handle_websocket_upgrade(event)

    def _refuse_websocket(self, most: int) -> None:
        words = f"The maximum of {most} WebSockets is open."
        problem = Problem("full", words, "Close an unused page, or try again later.")
        body = json.dumps(asdict(problem)).encode()
        length = str(len(body)).encode()
        headers = [(b"content-type", b"application/json"), (b"content-length", length), (b"connection", b"close")]
        head = h11.Response(status_code=status_of(problem.kind), headers=headers)
        for part in (head, h11.Data(data=body), h11.EndOfMessage()):
            self.transport.write(self.conn.send(part) or b"")
        self.transport.close()

    def on_response_complete(self) -> None:
        self.server_state.moved(self)
        self._cancel_request_timer()  # from here on uvicorn's own keep-alive time-out applies
        super().on_response_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        self.server_state.remove(self)
        self._cancel_request_timer()
        super().connection_lost(exc)


def _over_tls(keeper: CertificateManager) -> type[asyncio.Protocol]:
    """Protocol factory for accepted connections: our HTTP, once the handshake is over."""

    def create(config: uvicorn.Config, server_state: Connections, **others: Any) -> Handshake:
        return Handshake(keeper.context, server_state, partial(BoundedHttp, config, server_state, **others))

    return cast(type[asyncio.Protocol], create)


def _is_ours(record: logging.LogRecord) -> bool:
    """Whether uvicorn's message is not a duplicate of ours, nor about a normal cancellation or a client's bytes."""
    error = record.exc_info[1] if record.exc_info is not None else None
    is_known = isinstance(error, asyncio.CancelledError) or getattr(error, "is_logged", False)
    return record.msg not in REPORTED and not is_known


def raise_limit() -> None:
    """Raise the limit of file descriptors; the usual 1024 is for programs that use select(2)."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    limit = MAX_FILES if hard == resource.RLIM_INFINITY else min(hard, MAX_FILES)
    if soft < limit:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (limit, hard))


def report_loop_error(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Log that no connection can be accepted in a line, rate-limited; asyncio writes sixteen tracebacks a second."""
    error = context.get("exception")
    if not isinstance(error, OSError) or error.errno not in (errno.EMFILE, errno.ENFILE):
        loop.default_exception_handler(context)
        return
    text = f"New connections wait: {error.strerror}. Raise the limit of open files (ulimit -n, or LimitNOFILE=)."
    log.warning("%s", text, extra={"event": "no-descriptors", "often": "no-descriptors"})


class WebSocketProtocol(WebSocketsSansIOProtocol):
    """uvicorn's WebSocket that exposes its transport; other viewers may send larger messages than our page."""

    _pings: Sequence[float] = ()  # when the last ones came, s

    def handle_connect(self, event: Request) -> None:
        if event.path.startswith("/viser"):
            self.conn.max_message_size = MAX_FROM_VIEWER
        super().handle_connect(event)
        scope = getattr(self, "scope", None)
        if scope is not None:  # the handshake was a WebSocket's
            extensions = cast(dict[str, Any], scope["extensions"])
            extensions["imuscope.transport"] = self.transport
            extensions["imuscope.try_send"] = self.try_send

    def try_send(self, frame: bytes) -> bool:
        """Send a prepared frame if nothing is queued before it; otherwise do nothing and return False."""
        transport = self.transport
        if self.conn.state is not State.OPEN or transport.get_write_buffer_size() or transport.is_closing():
            return False
        transport.write(frame)
        return True

    def handle_ping(self) -> None:
        """Count pings, which the library answers at once, and disconnect a client that sends a flood of them."""
        now = self.loop.time()
        self._pings = [at for at in self._pings if now - at < 1] + [now]
        if len(self._pings) > MAX_PINGS:
            self.transport.abort()
        elif not self.transport.is_closing():
            super().handle_ping()

    def handle_cont(self, event: Frame) -> None:
        """Bound the number of fragments of a message; the library only bounds its size."""
        if self.transport.is_closing():
            return  # the rest of the data that had too many fragments
        if len(self.frames) >= MAX_FRAGMENTS:
            self.frames = []
            self.conn.send_close(1009)
            self.handle_parser_exception()
            return
        super().handle_cont(event)

    async def send(self, message: Any) -> None:
        """Note that a refusal with a response ends the handshake; otherwise uvicorn logs it as an error."""
        await super().send(message)
        if message["type"] == "websocket.http.response.body" and not message.get("more_body", False):
            self.handshake_complete = True


class Server(uvicorn.Server):
    """uvicorn's server with a callback when it serves, which also renews its certificate."""

    def __init__(
        self,
        config: uvicorn.Config,
        on_ready: Callable[[], None],
        keeper: CertificateManager | None,
        limits: ConnectionLimits,
    ) -> None:
        self._is_ending = False
        self._wake: Callable[[], None] | None = None
        super().__init__(config)
        self.server_state: Connections = Connections(limits)
        self._on_ready = on_ready
        self._keeper = keeper
        self._certificate_task: asyncio.Task[None] | None = None

    @property
    def should_exit(self) -> bool:
        """Whether it ends; may be set in a signal handler or by another thread."""
        return self._is_ending

    @should_exit.setter
    def should_exit(self, on: bool) -> None:
        self._is_ending = on
        if on and self._wake is not None:
            self._wake()

    async def main_loop(self) -> None:
        """Serve until `should_exit`. Uvicorn looks ten times a second whether it is set."""
        loop, ended = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed
                loop.call_soon_threadsafe(ended.set)

        self._wake = wake
        while not await self.on_tick(0):  # every time the date of the answers, too
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout_at(next_beat(loop.time(), DATE_S)):
                    await ended.wait()
        await asyncio.sleep(ACCEPTED_S)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        with ending.waiting_for("the start"):
            await super().startup(sockets)
        for one in sockets or ():
            one.listen(ACCEPT_QUEUE)  # asyncio has set it to ACCEPTED_AT_ONCE
        if not self.should_exit:
            if self._keeper is not None:
                self._certificate_task = asyncio.create_task(watch_certificate(self._keeper), name="certificate")
            self._on_ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        loop = asyncio.get_running_loop()
        timers = [loop.call_later(ending.GRACE_S, self._cut_off), loop.call_later(ending.CUT_S, self._cancel)]
        if self._certificate_task is not None:
            self._certificate_task.cancel()
        for one in list(self.server_state.handshakes):
            one.transport.abort()
        try:
            with ending.waiting_for("the connections and services"):
                await super().shutdown(sockets)
        finally:
            for timer in timers:
                timer.cancel()

    def _cut_off(self) -> None:
        """Close connections that ignored the close request (server/http/shutdown.py)."""
        for connection in list(self.server_state.connections):
            transport = getattr(connection, "transport", None)
            if transport is not None:
                transport.abort()

    def _cancel(self) -> None:
        for task in self.server_state.tasks:
            task.cancel()


def keeper_of(config: Config) -> CertificateManager | None:
    """Certificate manager if TLS is enabled; its library takes a while to import.

    Raises:
        ConfigError: the certificate cannot be used.
    """
    if config.scheme == "http":
        return None
    from imuscope.server.http.tls import CertificateManager

    return CertificateManager(config)


async def watch_certificate(keeper: CertificateManager, every_s: float = CHECK_INTERVAL_S) -> None:
    """Reload a renewed certificate, as long as the server runs."""
    while True:
        await asyncio.sleep(every_s)
        try:
            if await asyncio.to_thread(keeper.check):
                log.warning("a new certificate is in use; its SHA-256 is %s", keeper.tls.fingerprint)
        except ValueError as error:
            log.warning("the certificate was not replaced: %s", error)


def listen(host: str, port: int) -> socket.socket:
    """A listening socket; port 0 lets the system choose.

    Raises:
        OSError: the address cannot be used.
    """
    family, kind, number, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[
        0
    ]
    listener = socket.socket(family, kind, number)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if hasattr(socket, "TCP_NOTSENT_LOWAT"):
            listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, NOT_SENT_BYTES)
        if family == socket.AF_INET6 and host in ("::", ""):
            listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        listener.bind(address)
        listener.listen(ACCEPT_QUEUE)
    except OSError:
        listener.close()
        raise
    return listener


def server(
    app: ASGIApp,
    on_ready: Callable[[], None],
    keeper: CertificateManager | None = None,
    limits: ConnectionLimits | None = None,
) -> Server:
    """Uvicorn with our settings, not running yet; with a keeper it uses TLS."""
    config = uvicorn.Config(
        app,
        http=BoundedHttp if keeper is None else _over_tls(keeper),
        ws=WebSocketProtocol,
        ws_per_message_deflate=False,
        ws_max_size=MAX_FROM_BROWSER,
        ws_ping_interval=20.0,
        ws_ping_timeout=20.0,
        proxy_headers=False,
        server_header=False,
        access_log=False,
        log_config=None,
        log_level="warning",
        lifespan="on",
        backlog=ACCEPTED_AT_ONCE,
        timeout_graceful_shutdown=1,  # after ending.CUT_S: never reached, unless a request will not be cancelled
    )
    logging.getLogger("uvicorn.error").addFilter(_is_ours)
    return Server(config, on_ready, keeper, limits or ConnectionLimits())


def run(
    app: ASGIApp, listener: socket.socket, on_ready: Callable[[], None], keeper: CertificateManager | None = None
) -> None:
    """Serve until Ctrl-C, SIGTERM or SIGHUP; connections are closed, sessions too, before this returns.

    Raises:
        RuntimeError: the server did not start.
    """
    serving = server(app, on_ready, keeper)
    ending.ShutdownDeadline(end_signals())
    sys.setswitchinterval(SWITCH_S)
    raise_limit()
    gc.freeze()  # imported objects stay: exclude them from garbage collection while devices stream
    gc.enable()

    def end(*_: object) -> None:
        serving.should_exit = True

    # Handles SIGTERM until uvicorn does, and when uvicorn raises it again at its end, which is not a failure.
    for number in end_signals():
        if number != signal.SIGINT:
            signal.signal(number, end)
    try:
        with asyncio.Runner() as runner:
            runner.get_loop().set_exception_handler(report_loop_error)
            work = ending.make_executor(runner.get_loop())
            with contextlib.suppress(KeyboardInterrupt):
                runner.run(serving.serve(sockets=[listener]))
            ending.exit_process(work)
    finally:
        listener.close()
    if not serving.started:
        raise RuntimeError("The server did not start; the log above has details.")
