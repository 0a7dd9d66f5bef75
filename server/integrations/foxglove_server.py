"""The Foxglove WebSocket protocol, spoken by us: who has subscribed to what, and what goes to whom.

    to a viewer     text: serverInfo; advertise, unadvertise; status, when it said something that is not understood
                    binary: u8 opcode 1 │ u32 subscription id │ u64 log time, ns │ payload          little-endian
    from a viewer   text: subscribe {subscriptions: [{id, channelId}]}, unsubscribe {subscriptionIds}

No capability is told, so nobody can publish, call or set anything. Why not the server of Foxglove's own SDK? It lets in
whoever comes to its port, each page of a browser too, and cannot be told otherwise; their SDK writes the messages.

The network is a thread of its own. A viewer that takes nothing fills its own queue and loses what is oldest there.

Source: Foxglove WebSocket protocol v1 (foxglove/ws-protocol, docs/spec.md).
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import struct
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

SUBPROTOCOLS = (Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1"))
DATA = struct.Struct("<BIQ")
BACKLOG = 4096  # messages that wait for one viewer: two seconds of 2 kHz
MOST_UP = 64 * 1024  # a subscribe to all of a few thousand channels
MOST_SUBSCRIPTIONS = 10_000  # of one viewer
MOST_VIEWERS = 32
START_S = 30.0

Admit = Callable[[ServerConnection, Request], Response | None]


@dataclass(eq=False)
class FoxgloveClient:
    """One who is connected."""

    words: deque[str] = field(default_factory=deque)  # never dropped
    data: deque[bytes] = field(default_factory=lambda: deque(maxlen=BACKLOG))
    channels: dict[int, int] = field(default_factory=dict)  # by subscription
    wake: asyncio.Event = field(default_factory=asyncio.Event)


class FoxgloveServer:
    """What is advertised, and those who listen. Its methods may be called from any thread.

    Args:
        name: what viewers show.
        changed: called when others are subscribed to than before, from the network's thread.
    """

    def __init__(self, name: str, changed: Callable[[], None]) -> None:
        self._name = name
        self._changed = changed
        self._lock = threading.Lock()
        self._channels: dict[int, dict[str, Any]] = {}
        self._viewers: dict[FoxgloveClient, None] = {}
        self._listeners: dict[int, list[tuple[FoxgloveClient, int]]] = {}  # by channel: whom, under which subscription
        self._next = 1
        self._loop: asyncio.AbstractEventLoop | None = None

    def start(self, port: int, admit: Admit) -> int:
        """Listen on loopback; returns the port.

        Args:
            port: 0 for any free one.
            admit: an answer refuses whoever comes.
        Raises:
            OSError: the port cannot be had.
        """
        served: Future[int] = Future()
        threading.Thread(target=lambda: asyncio.run(self._serve(port, admit, served)), daemon=True).start()
        return served.result(START_S)

    def advertise(self, topic: str, encoding: str, name: str, schema: bytes, schema_encoding: str) -> int:
        """Tell of a channel; its id.

        Args:
            encoding, schema_encoding: "json" and "jsonschema", or "protobuf" twice.
            name: of the schema.
        """
        text = base64.b64encode(schema).decode() if schema_encoding == "protobuf" else schema.decode()
        about = {"topic": topic, "encoding": encoding, "schemaName": name, "schema": text}
        with self._lock:
            id, self._next = self._next, self._next + 1
            self._channels[id] = {"id": id, **about, "schemaEncoding": schema_encoding}
            self._tell(_advertise([self._channels[id]]))
        return id

    def withdraw(self, ids: Sequence[int]) -> None:
        """These channels are no more."""
        with self._lock:
            for id in ids:
                del self._channels[id]
                for viewer, subscription in self._listeners.pop(id, []):
                    del viewer.channels[subscription]
            self._tell(json.dumps({"op": "unadvertise", "channelIds": list(ids)}))

    def is_wanted(self, id: int) -> bool:
        """Has anybody subscribed?"""
        return id in self._listeners

    def send(self, id: int, time_ns: int, body: bytes) -> None:
        """A message of a channel, to whoever has subscribed."""
        with self._lock:
            for viewer, subscription in self._listeners.get(id, ()):
                viewer.data.append(DATA.pack(1, subscription, time_ns) + body)
                self._wake(viewer)

    def _tell(self, text: str) -> None:
        for viewer in self._viewers:
            viewer.words.append(text)
            self._wake(viewer)

    def _wake(self, viewer: FoxgloveClient) -> None:
        if not viewer.wake.is_set() and self._loop is not None:
            self._loop.call_soon_threadsafe(viewer.wake.set)

    # ── the network ──────────────────────────────────────────────────────────────────────────────────────────────────

    async def _serve(self, port: int, admit: Admit, served: Future[int]) -> None:
        self._loop = asyncio.get_running_loop()
        try:
            server = await serve(
                self._attend,
                "127.0.0.1",
                port,
                process_request=admit,
                subprotocols=SUBPROTOCOLS,
                compression=None,
                max_size=MOST_UP,
                server_header=None,
                ping_timeout=60.0,
            )
        except OSError as error:
            served.set_exception(error)
            return
        served.set_result(next(iter(server.sockets)).getsockname()[1])
        await asyncio.get_running_loop().create_future()  # for ever: the process ends with its standard input

    async def _attend(self, socket: ServerConnection) -> None:
        viewer = FoxgloveClient()
        with self._lock:
            is_full = len(self._viewers) >= MOST_VIEWERS
            if not is_full:
                self._viewers[viewer] = None
                info = {"op": "serverInfo", "name": self._name, "capabilities": [], "supportedEncodings": []}
                viewer.words.append(json.dumps(info))
                viewer.words.append(_advertise(list(self._channels.values())))
        if is_full:
            await socket.close(1013, f"{MOST_VIEWERS} viewers are attached already")
            return
        sending = asyncio.create_task(_send(socket, viewer), name="viewer is sent")
        try:
            with contextlib.suppress(ConnectionClosed):
                async for message in socket:
                    self._hear(viewer, message)
        finally:
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)
            with self._lock:
                del self._viewers[viewer]
                self._unsubscribe(viewer, list(viewer.channels))
            self._changed()

    def _hear(self, viewer: FoxgloveClient, message: str | bytes) -> None:
        try:
            said = json.loads(message) if isinstance(message, str) else {}
            with self._lock:
                if said["op"] == "subscribe":
                    for one in said["subscriptions"]:
                        self._subscribe(viewer, one["id"], one["channelId"])
                elif said["op"] == "unsubscribe":
                    self._unsubscribe(viewer, said["subscriptionIds"])
                else:
                    raise ValueError
        except (ValueError, KeyError, TypeError, RecursionError):
            words = "This server takes subscribe and unsubscribe, and nothing else."
            viewer.words.append(json.dumps({"op": "status", "level": 1, "message": words}))
            viewer.wake.set()
            return
        self._changed()

    def _subscribe(self, viewer: FoxgloveClient, subscription: int, channel: int) -> None:
        if type(subscription) is not int or not 0 <= subscription < 1 << 32 or subscription in viewer.channels:
            raise ValueError
        if channel in self._channels and len(viewer.channels) < MOST_SUBSCRIPTIONS:  # it may be gone by now
            viewer.channels[subscription] = channel
            self._listeners.setdefault(channel, []).append((viewer, subscription))

    def _unsubscribe(self, viewer: FoxgloveClient, subscriptions: Sequence[int]) -> None:
        for subscription in subscriptions:
            channel = viewer.channels.pop(subscription, None)
            if channel is not None:
                left = [one for one in self._listeners[channel] if one != (viewer, subscription)]
                if left:
                    self._listeners[channel] = left
                else:
                    del self._listeners[channel]


async def _send(socket: ServerConnection, viewer: FoxgloveClient) -> None:
    with contextlib.suppress(ConnectionClosed):
        while True:
            while viewer.words:
                await socket.send(viewer.words.popleft())
            if viewer.data:
                await socket.send(viewer.data.popleft())
                continue
            viewer.wake.clear()
            if not viewer.words and not viewer.data:
                await viewer.wake.wait()


def _advertise(channels: Sequence[Mapping[str, Any]]) -> str:
    return json.dumps({"op": "advertise", "channels": channels})
