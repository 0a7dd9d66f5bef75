"""The connections of a server, and the choice of the one that is closed when the server is full.

    HTTP         if the server is full, the connection that has been idle longest is closed for the new one: a client
                 that opens many idle connections loses them, and new requests are served
    handshake    of TLS (`Handshake`): counted and closed like HTTP
    WebSocket    at most half of the room: they stay open for hours, and are not closed for others

A connection is active when a part of a request arrives, or a part of an answer has been sent.
"""

from __future__ import annotations

import asyncio
import logging
import resource
import ssl
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

log = logging.getLogger("imuscope.serving")


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """Limits of connections. Tests pass smaller ones.

    Args:
        head_s: for the head of a request; precedents: nginx 60, lighttpd 30, for slower networks.
        handshake_s: for the handshake of TLS; precedent: nginx 60 s; our page is used near the robot.
        most: number of connections.
    """

    head_s: float = 10.0
    handshake_s: float = 5.0
    most: int = 1000

    @property
    def connections(self) -> int:
        """Maximum number of connections of browsers and programs: half of the descriptors at most."""
        return min(self.most, resource.getrlimit(resource.RLIMIT_NOFILE)[0] // 2)


class Connections(ServerState):
    """The connections of one server, and those of HTTP and pending handshakes by time of last activity."""

    def __init__(self, limits: ConnectionLimits) -> None:
        super().__init__()
        self.limits = limits
        self.handshakes: set[Handshake] = set()
        self._moved: dict[Any, None] = {}  # in order of last activity, newest last

    @property
    def websockets(self) -> int:
        """Number of open WebSockets."""
        return len(self.connections) + len(self.handshakes) - len(self._moved)

    def moved(self, one: H11Protocol | Handshake) -> None:
        """Note activity of a connection."""
        self._moved.pop(one, None)
        self._moved[one] = None

    def remove(self, one: H11Protocol | Handshake) -> None:
        """Remove a connection that is closed, upgraded to WebSocket, or past its handshake."""
        self.handshakes.discard(one)
        self._moved.pop(one, None)

    def admit(self, one: H11Protocol | Handshake) -> bool:
        """Make room for one more connection, by closing an idle one if necessary. Without one, close it: False."""
        most = self.limits.connections
        if len(self.connections) + len(self.handshakes) <= most:
            return True
        idle = next(iter(self._moved), one)
        self.remove(idle)
        peer = (idle.client or ("", 0))[0]
        text = f"Closed an idle connection of {peer}: {most} are open, the maximum."
        log.warning("%s", text, extra={"event": "full", "data": {"peer": peer}, "often": ("full", peer)})
        idle.transport.abort()
        return idle is not one


class Handshake(asyncio.Protocol):
    """TLS handshake of one connection, from the first byte to its end, in bounded time; then it only passes on events.

        accepted ──> Handshake ── within handshake_s ──> the server's own HTTP, over TLS
                        └── too late, or not TLS: closed; too many: the one idle longest is closed for the new one

    Without this, a silent connection would be open and uncounted for a minute. Bytes may arrive between the end of the
    handshake and the first call to the HTTP protocol; they are stored and passed on in order, as is the loss of the
    connection.

    Args:
        context: TLS context with the certificate.
        room: the connections among which it is counted.
        make: creates the protocol that takes over.
    """

    def __init__(self, context: ssl.SSLContext, room: Connections, make: Callable[[], asyncio.Protocol]) -> None:
        self._context = context
        self._room = room
        self._make = make
        self._early = b""
        self._lost = False
        self._next: asyncio.Protocol | None = None
        self._task: asyncio.Task[None] | None = None
        self.transport: asyncio.Transport
        self.client: tuple[str, int] | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        peer = transport.get_extra_info("peername")
        self.client = (str(peer[0]), int(peer[1])) if isinstance(peer, tuple) else None
        transport.pause_reading()
        self._room.handshakes.add(self)
        self._room.moved(self)
        if self._room.admit(self):
            self._task = asyncio.get_running_loop().create_task(self._run(), name="TLS handshake")

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            limit_s = self._room.limits.handshake_s
            secure = await loop.start_tls(
                self.transport, self, self._context, server_side=True, ssl_handshake_timeout=limit_s
            )
        except OSError:  # not TLS, too late, or gone: it is already closed
            secure = None
        finally:
            self._room.remove(self)
        if secure is None or self._lost:
            return
        self._next = self._make()
        secure.set_protocol(self._next)
        self._next.connection_made(secure)
        if self._early and not secure.is_closing():
            self._next.data_received(self._early)

    def data_received(self, data: bytes) -> None:
        self._early += data

    def connection_lost(self, exc: Exception | None) -> None:
        self._lost = True
        self._room.remove(self)
        if self._next is not None:
            self._next.connection_lost(exc)
        elif self._task is not None:
            self._task.cancel()
