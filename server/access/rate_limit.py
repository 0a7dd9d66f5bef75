"""Rate limits per client address: high enough for any page, low enough that a flood does not affect other clients.

    any request or WebSocket      `REQUESTS_PER_S`, `REQUEST_BURST` more after a pause   beyond: 429 and Retry-After
    reading or analysing          `MAX_READING` at once, `MAX_WAITING` more are queued   beyond: 429
    any other request             `ADMITTED_PER_PASS` of the event loop begin: a hundred at once, of some
                                  milliseconds each, would otherwise block other clients for a second

A page sends some 60 requests when it is opened, and about 20 per second while a plot is dragged; many pages may share
one address. A refusal takes 0.1 ms, a response 1 ms, and reading a part of a recording tens of milliseconds on all
processors, which live devices need.

Addresses are grouped as in server/access/login_throttle.py. Loopback is limited as well, because a faulty script may
run on this machine. `/healthz` is always answered, because a supervisor ends a server that does not answer.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
import time
from collections.abc import AsyncIterator, Callable
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from imuscope.server.access.auth import refuse
from imuscope.server.access.login_throttle import client_group
from imuscope.server.concurrency.limiters import TokenBuckets
from imuscope.server.errors import DomainError

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Receive, Scope, Send

REQUESTS_PER_S = 200.0
REQUEST_BURST = 1000.0
MAX_READING, MAX_WAITING = 4, 60
ADMITTED_PER_PASS = 4
MAX_ADDRESSES = 1024  # stored; the least recently used is removed first
ALWAYS = "/healthz"
READS = re.compile(
    r"GET /api/(recordings/[^/]+|devices/[^/]+(?=/query))(/(window|statistics|query|health|amount))?"
    r"|POST /api/(analysis/[^/]+|comparison)"
)


class RateLimiter:
    """ASGI middleware, inside of server/access/auth.py: requests refused there are not counted here.

    Args:
        clock: monotonic clock, s.
    """

    def __init__(self, app: ASGIApp, clock: Callable[[], float] = time.monotonic) -> None:
        self._app = app
        self._clock = clock
        self._requests = TokenBuckets(REQUESTS_PER_S, REQUEST_BURST, MAX_ADDRESSES)
        self._readers: dict[str, ReadSlots] = {}
        self._gates: WeakKeyDictionary[asyncio.AbstractEventLoop, asyncio.Semaphore] = WeakKeyDictionary()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket") or scope["path"] == ALWAYS:
            await self._app(scope, receive, send)
            return
        group = client_group((scope.get("client") or ("", 0))[0])
        if wait := self.acquire(group):
            words = "Too many requests came from this address."
            refusal = DomainError(
                "too-fast", words, f"Send fewer requests: {REQUESTS_PER_S:.0f} a second are answered."
            )
            await refuse(scope, receive, send, refusal, math.ceil(wait))
        elif scope["type"] == "http" and READS.fullmatch(f"{scope['method']} {scope['path']}"):
            await self._read(group, scope, receive, send)
        else:
            await self._begin()
            await self._app(scope, receive, send)

    async def _begin(self) -> None:
        """Wait for a pass of the event loop in which fewer than ADMITTED_PER_PASS requests begin."""
        loop = asyncio.get_running_loop()
        gate = self._gates.setdefault(loop, asyncio.Semaphore(ADMITTED_PER_PASS))
        await gate.acquire()
        loop.call_soon(gate.release)

    def acquire(self, group: str) -> float:
        """Count a request and return 0; if the limit is reached, return the seconds to wait without counting it."""
        now = self._clock()
        wait = self._requests.wait_s(group, now)
        if not wait:
            self._requests.acquire(group, now)
        return wait

    async def _read(self, group: str, scope: Scope, receive: Receive, send: Send) -> None:
        readers = self._readers.setdefault(group, ReadSlots())
        if readers.requested >= MAX_READING + MAX_WAITING:
            words = "Too many reads are queued for this address."
            await refuse(
                scope, receive, send, DomainError("too-fast", words, "Wait for the earlier requests to finish."), 1
            )
            return
        try:
            async with readers.slot():
                await self._app(scope, receive, send)
        finally:
            if not readers.requested:
                self._readers.pop(group, None)


class ReadSlots:
    """Read slots of one address, and the queue for them."""

    def __init__(self) -> None:
        self.requested = 0
        self._turns = asyncio.Semaphore(MAX_READING)

    @contextlib.asynccontextmanager
    async def slot(self) -> AsyncIterator[None]:
        """Hold a read slot, waiting for it if necessary."""
        self.requested += 1
        try:
            async with self._turns:
                yield
        finally:
            self.requested -= 1
