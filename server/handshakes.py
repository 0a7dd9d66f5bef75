"""TLS, one connection at a time: from the first byte to the end of the handshake, in bounded time.

    accepted ──> Handshake ── within HANDSHAKE_S ──> the server's own HTTP, over TLS
                    │
                    └── too late, or no TLS: closed; too many: the one that waits longest is closed for the newcomer

Without this a connection that never says anything is known to nobody but the event loop, for a minute: it is counted
among the connections (server/connections.py) from the moment it is accepted.

Rules for editing: between the end of the handshake and the first call to the HTTP protocol bytes may come already; they
are kept and handed on in order, also the news that the connection was lost.
"""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable

from server.connections import Connections

HANDSHAKE_S = 5.0  # precedent: nginx has 60 s for it, and a page of ours is read beside its robot


class Handshake(asyncio.Protocol):
    """A connection whose handshake is not over; afterwards only who hands news on.

    Args:
        context: holds the certificate.
        room: where it is counted meanwhile.
        make: the protocol that takes over.
        admit: makes room for one more; False where there is none.
    """

    def __init__(
        self,
        context: ssl.SSLContext,
        room: Connections,
        make: Callable[[], asyncio.Protocol],
        admit: Callable[[Handshake], bool],
    ) -> None:
        self._context = context
        self._room = room
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
        self._room.began(self)
        if self._admit(self):
            self._task = asyncio.get_running_loop().create_task(self._shake(), name="TLS handshake")

    async def _shake(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            secure = await loop.start_tls(
                self.transport, self, self._context, server_side=True, ssl_handshake_timeout=HANDSHAKE_S
            )
        except OSError:  # no TLS, too late, or gone: it is closed already
            secure = None
        finally:
            self._room.gone(self)
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
        self._room.gone(self)
        if self._next is not None:
            self._next.connection_lost(exc)
        elif self._task is not None:
            self._task.cancel()
