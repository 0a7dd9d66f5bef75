"""TLS handshake of one connection, from the first byte to its end, in bounded time.

    accepted ──> Handshake ── within handshake_s ──> the server's own HTTP, over TLS
                    │
                    └── too late, or not TLS: closed; too many: the one idle longest is closed for the new one

Without this, a silent connection would be open and uncounted for a minute. Here it counts as a connection
(server/http/connections.py) as soon as it is accepted.

Rules for editing: bytes may arrive between the end of the handshake and the first call to the HTTP protocol; they are
stored and passed on in order, as is the loss of the connection.
"""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable

from imuscope.server.http.connections import Connections


class Handshake(asyncio.Protocol):
    """A connection during its handshake; afterwards it only passes on events.

    Args:
        context: TLS context with the certificate.
        room: the connections among which it is counted.
        make: creates the protocol that takes over.
        admit: makes room for one more connection; False if that is not possible.
    """

    def __init__(
        self,
        context: ssl.SSLContext,
        room: Connections,
        make: Callable[[], asyncio.Protocol],
        admit: Callable[[Handshake], bool],
    ) -> None:
        self._context = context
        self._slots = room
        self._make = make
        self._admit = admit
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
        self._slots.add(self)
        if self._admit(self):
            self._task = asyncio.get_running_loop().create_task(self._run(), name="TLS handshake")

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            limit_s = self._slots.limits.handshake_s
            secure = await loop.start_tls(
                self.transport, self, self._context, server_side=True, ssl_handshake_timeout=limit_s
            )
        except OSError:  # not TLS, too late, or gone: it is already closed
            secure = None
        finally:
            self._slots.remove(self)
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
        self._slots.remove(self)
        if self._next is not None:
            self._next.connection_lost(exc)
        elif self._task is not None:
            self._task.cancel()
