"""Clients for tests and benchmarks: good, slow, stalled and flooding ones.

    Good        takes everything at once; knows what was lost and how late each message was
    slow        takes so many bytes a second
    stalled     takes nothing, and comes back whenever it is thrown out
    flooding    asks as fast as its socket lets it, and takes the answers; comes back when it is thrown out

All are coroutines that go on until they are cancelled.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import struct
import time
from array import array
from collections import defaultdict
from collections.abc import AsyncIterator
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

from imuscope.server.wire import FLAG_HISTORY, HEADER, SUBPROTOCOL
from tests.support.timeouts import connecting

TCP_ESTABLISHED = 1
ARRIVAL = struct.Struct("<d")  # the first own column of every frame: when its first sample arrived


class Good:
    """Samples and losses seen by one client.

    Attributes:
        subscribed: set once the server has answered the subscription: from here on nothing may be missing.
    """

    def __init__(self) -> None:
        self.samples: dict[int, int] = defaultdict(int)
        self.lost = 0
        self.bytes = 0
        self.messages = 0
        self.ages = array("f")
        self.channels: dict[int, dict[str, Any]] = {}
        self.subscribed = asyncio.Event()
        self._next: dict[int, int] = {}

    async def run(self, url: str) -> None:
        """Connect and take everything."""
        async with _connected(url) as connection:
            await _subscribe(connection)
            async for data in connection:
                if isinstance(data, bytes):
                    self.take(data, time.time())
                    continue
                if '"op":"channels"' in data:
                    self.channels.update({one["id"]: one for one in json.loads(data)["channels"]})
                self.receive(data, time.time())
                if '"op":"history_end"' in data:
                    self.subscribed.set()

    def receive(self, text: str, now: float) -> None:
        """Take one text message."""

    def take(self, data: bytes, now: float) -> None:
        """Account for one binary message of one or more sample frames."""
        at, oldest = 0, now
        while at < len(data):
            _, flags, _, channel, n, dropped, sequence, size, _, _ = HEADER.unpack_from(data, at)
            if not flags & FLAG_HISTORY:
                missing = max(0, sequence - self._next.get(channel, sequence))
                self.lost += max(missing, dropped)
                self.samples[channel] += n
                oldest = min(oldest, ARRIVAL.unpack_from(data, at + HEADER.size)[0])
            self._next[channel] = max(sequence + n, self._next.get(channel, 0))
            at += size
        self.messages += 1
        self.bytes += len(data)
        self.ages.append(now - oldest)

    def begin(self) -> None:
        """Count from here on."""
        self.samples.clear()
        self.lost = self.bytes = self.messages = 0
        self.ages = array("f")


async def slow(url: str, bytes_per_s: float) -> None:
    """Take so many bytes a second, a message at least every other second, so that it counts as alive."""
    while True:
        async with _connected(url, narrow=True) as connection:
            with contextlib.suppress(ConnectionClosed):
                await _subscribe(connection)
                while True:
                    data = await connection.recv()
                    await asyncio.sleep(min(2.0, len(data) / bytes_per_s))


async def stalled(url: str, times: list[float]) -> None:
    """Read nothing; reconnect after each disconnection by the server, which is noted in `times`."""
    while True:
        async with _connected(url, narrow=True) as connection:
            with contextlib.suppress(ConnectionClosed):
                await _subscribe(connection)
            began = time.monotonic()
            while not _hung_up(connection):
                await asyncio.sleep(0.05)
            times.append(time.monotonic() - began)


async def flooding(url: str, counted: list[int]) -> None:
    """Flood for ever: what it sends stands before its answers to the server's own pings, so it is cut off at times."""
    while True:
        with contextlib.suppress(ConnectionClosed):
            await _flood(url, counted)


async def _flood(url: str, counted: list[int]) -> None:
    """Send requests continuously: subscriptions with full history, times, invalid text. Half of them are answered with
    a text and counted in counted[0].
    """
    questions = (
        json.dumps({"op": "ping", "t": 1.0}),
        json.dumps({"op": "subscribe", "history": 600, "channels": None}),
        json.dumps({"op": "subscribe", "history": 0, "channels": []}),
        '{"op": "nonsense"}',
    )
    async with _connected(url) as connection:

        async def receive() -> None:
            async for data in connection:
                counted[0] += isinstance(data, str) and ('"op":"pong"' in data or '"op":"error"' in data)

        receiving = asyncio.create_task(receive())
        try:
            while True:
                for question in questions:
                    await connection.send(question)
                await asyncio.sleep(0)  # a socket accepts megabytes at once, which would block the measurement
        finally:
            receiving.cancel()
            await asyncio.gather(receiving, return_exceptions=True)


def _hung_up(connection: ClientConnection) -> bool:
    """Whether the other end has closed, according to the kernel, because a client that reads nothing
    is not notified.
    """
    plain = connection.transport.get_extra_info("socket")
    try:
        return bool(plain.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 1)[0] != TCP_ESTABLISHED)
    except OSError:
        return True


@contextlib.asynccontextmanager
async def _connected(url: str, *, narrow: bool = False) -> AsyncIterator[ClientConnection]:
    """A WebSocket like a page's, left without a word. `narrow`: with as little memory between here and the server as
    the system allows.
    """
    options: dict[str, Any] = {"subprotocols": [SUBPROTOCOL], "compression": None, "max_size": None, "origin": url}
    options |= {"ping_interval": None}
    if narrow:
        parts = urlsplit(url)
        plain = socket.socket()
        plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        plain.connect((parts.hostname, parts.port))
        plain.setblocking(False)
        options |= {"sock": plain, "max_queue": 1}
    connection = await connecting(url.replace("http", "ws", 1) + "/ws", **options)
    try:
        yield connection
    finally:
        connection.transport.abort()


async def _subscribe(connection: ClientConnection) -> None:
    await connection.send(json.dumps({"op": "subscribe", "history": 0, "channels": None}))
