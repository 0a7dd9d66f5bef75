"""How much may be asked from one address? So much that no page ever notices, and that no flood reaches the others.

    any request or WebSocket      `PER_S` a second, `AT_ONCE` more after a pause        beyond: 429 and Retry-After
    one that reads a recording    `READING` at once, `WAITING` wait for their turn      beyond: 429
    any other                     `IN_A_PASS` begin in a pass of the event loop: a hundred that come at once, of which
                                  each takes some milliseconds, hold up nobody else for a second

A page asks for some 60 things when it is opened, and about 20 a second while somebody drags a plot; behind one address
may be a house full of them. What is refused costs a tenth of a millisecond; an answer costs one, and a stretch of a
recording tens of them, on all processors that there are, which live devices need.

An address is what server/login_throttle.py says. Loopback counts like any other: a script that runs wild runs on this
machine as well. `/healthz` is always answered: who asks there ends a server that does not.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
import time
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable
from weakref import WeakKeyDictionary

from starlette.types import ASGIApp, Receive, Scope, Send

from server.auth import refuse
from server.login_throttle import client_group
from server.wire import Problem

PER_S = 200.0
AT_ONCE = 1000.0
READING, WAITING = 4, 60
IN_A_PASS = 4
ADDRESSES = 1024  # remembered; the one that asked longest ago is forgotten first
ALWAYS = "/healthz"
READS = re.compile(r"/api/(recordings/[^/]+|devices/[^/]+(?=/query))(/(window|query|fared|amount))?\Z")


class RateLimiter:
    """ASGI middleware, inside of server/auth.py: who may not come in is not counted here.

    Args:
        clock: seconds, never running backwards.
    """

    def __init__(self, app: ASGIApp, clock: Callable[[], float] = time.monotonic) -> None:
        self._app = app
        self._clock = clock
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()  # how many are left, and when that was so
        self._readers: dict[str, ReadSlots] = {}
        self._gates: WeakKeyDictionary[asyncio.AbstractEventLoop, asyncio.Semaphore] = WeakKeyDictionary()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket") or scope["path"] == ALWAYS:
            await self._app(scope, receive, send)
            return
        group = client_group((scope.get("client") or ("", 0))[0])
        if wait := self.take(group):
            words = "Too many requests came from this address."
            problem = Problem("too-fast", words, f"Ask more slowly: {PER_S:.0f} a second are answered.")
            await refuse(scope, receive, send, 429, problem, math.ceil(wait))
        elif scope["type"] == "http" and scope["method"] == "GET" and READS.match(scope["path"]):
            await self._read(group, scope, receive, send)
        else:
            await self._begin()
            await self._app(scope, receive, send)

    async def _begin(self) -> None:
        """Wait for a pass of the loop in which not too many others begin."""
        loop = asyncio.get_running_loop()
        gate = self._gates.setdefault(loop, asyncio.Semaphore(IN_A_PASS))
        await gate.acquire()
        loop.call_soon(gate.release)

    def take(self, group: str) -> float:
        """Count a request; 0, or in how many seconds one will be answered again: then it is not counted."""
        now = self._clock()
        left, then = self._left.get(group, (AT_ONCE, now))
        left = min(AT_ONCE, left + (now - then) * PER_S)
        wait = 0.0 if left >= 1 else (1 - left) / PER_S
        self._left[group] = (left if wait else left - 1, now)
        self._left.move_to_end(group)
        while len(self._left) > ADDRESSES:
            self._left.popitem(last=False)
        return wait

    async def _read(self, group: str, scope: Scope, receive: Receive, send: Send) -> None:
        readers = self._readers.setdefault(group, ReadSlots())
        if readers.asked >= READING + WAITING:
            problem = Problem("too-fast", "Too many readings wait for this address.", "Wait for those that were asked.")
            await refuse(scope, receive, send, 429, problem, 1)
            return
        try:
            async with readers.turn():
                await self._app(scope, receive, send)
        finally:
            if not readers.asked:
                self._readers.pop(group, None)


class ReadSlots:
    """Who reads for one address, and who waits for it."""

    def __init__(self) -> None:
        self.asked = 0
        self._turns = asyncio.Semaphore(READING)

    @contextlib.asynccontextmanager
    async def turn(self) -> AsyncIterator[None]:
        """One of those who read, from when it is its turn."""
        self.asked += 1
        try:
            async with self._turns:
                yield
        finally:
            self.asked -= 1
