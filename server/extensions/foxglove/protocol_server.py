"""Our server of the Foxglove WebSocket protocol: channels, subscriptions and messages.

    to a viewer     text: serverInfo; advertise, unadvertise; status, in answer to an invalid message
                    binary: u8 opcode 1 │ u32 subscription id │ u64 log time, ns │ payload          little-endian
    from a viewer   text: subscribe {subscriptions: [{id, channelId}]}, unsubscribe {subscriptionIds}

No capability is advertised, so clients cannot publish, call or set anything. The server of Foxglove's own SDK is not
used because it accepts every client of its port, including any page in a browser, and cannot be configured otherwise;
their SDK writes the messages.

The network runs in its own thread. A stalled viewer fills its own queue and loses the oldest messages there.

Source: Foxglove WebSocket protocol v1 (foxglove/ws-protocol, docs/spec.md).
"""

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

from imuscope.server.concurrency.tasks import end_tasks

SUBPROTOCOLS = (Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1"))
DATA = struct.Struct("<BIQ")
MAX_BACKLOG = 4096  # messages queued for one viewer: two seconds at 2 kHz
MAX_UP = 64 * 1024  # a subscribe to all of a few thousand channels
MAX_SUBSCRIPTIONS = 10_000  # of one viewer
MAX_VIEWERS = 32
START_S = 30.0

Admit = Callable[[ServerConnection, Request], Response | None]


@dataclass(eq=False)
class FoxgloveClient:
    """WebSocket connection of a Foxglove client, with its subscriptions."""

    words: deque[str] = field(default_factory=deque)  # never dropped
    data: deque[bytes] = field(default_factory=lambda: deque(maxlen=MAX_BACKLOG))
    channels: dict[int, int] = field(default_factory=dict)  # by subscription
    wake_event: asyncio.Event = field(default_factory=asyncio.Event)


class FoxgloveServer:
    """Advertised channels and their subscribers. Its methods may be called from any thread.

    Args:
        name: name shown in viewers.
        changed: called from the network's thread when subscriptions have changed.
    """

    def __init__(self, name: str, changed: Callable[[], None]) -> None:
        self._name = name
        self._changed = changed
        self._lock = threading.Lock()
        self._channels: dict[int, dict[str, Any]] = {}
        self._viewers: dict[FoxgloveClient, None] = {}
        self._listeners: dict[int, list[tuple[FoxgloveClient, int]]] = {}  # by channel: client and subscription
        self._next = 1
        self._loop: asyncio.AbstractEventLoop | None = None

    def start(self, port: int, admit: Admit) -> int:
        """Listen on loopback; returns the port.

        Args:
            port: 0 for any free one.
            admit: returns a response to refuse a client.

        Raises:
            OSError: the port cannot be used.
        """
        served: Future[int] = Future()
        threading.Thread(target=lambda: asyncio.run(self._serve(port, admit, served)), daemon=True).start()
        return served.result(START_S)

    def advertise(self, topic: str, encoding: str, name: str, schema: bytes, schema_encoding: str) -> int:
        """Advertise a channel; returns its id.

        Args:
            encoding, schema_encoding: "json" and "jsonschema", or "protobuf" twice.
            name: of the schema.
        """
        text = base64.b64encode(schema).decode() if schema_encoding == "protobuf" else schema.decode()
        about = {"topic": topic, "encoding": encoding, "schemaName": name, "schema": text}
        with self._lock:
            number, self._next = self._next, self._next + 1
            self._channels[number] = {"id": number, **about, "schemaEncoding": schema_encoding}
            self._send_text(_advertise([self._channels[number]]))
        return number

    def withdraw(self, ids: Sequence[int]) -> None:
        """Remove channels."""
        with self._lock:
            for number in ids:
                del self._channels[number]
                for viewer, subscription in self._listeners.pop(number, []):
                    del viewer.channels[subscription]
            self._send_text(json.dumps({"op": "unadvertise", "channelIds": list(ids)}))

    def is_wanted(self, number: int) -> bool:
        """Whether a client has subscribed."""
        return number in self._listeners

    def send(self, number: int, time_ns: int, body: bytes) -> None:
        """Send a message of a channel to its subscribers."""
        with self._lock:
            for viewer, subscription in self._listeners.get(number, ()):
                viewer.data.append(DATA.pack(1, subscription, time_ns) + body)
                self._wake_client(viewer)

    def _send_text(self, text: str) -> None:
        for viewer in self._viewers:
            viewer.words.append(text)
            self._wake_client(viewer)

    def _wake_client(self, viewer: FoxgloveClient) -> None:
        if not viewer.wake_event.is_set() and self._loop is not None:
            self._loop.call_soon_threadsafe(viewer.wake_event.set)

    # ── the network ──────────────────────────────────────────────────────────────────────────────────────────────────

    async def _serve(self, port: int, admit: Admit, served: Future[int]) -> None:
        self._loop = asyncio.get_running_loop()
        try:
            server = await serve(
                self._serve_client,
                "127.0.0.1",
                port,
                process_request=admit,
                subprotocols=SUBPROTOCOLS,
                compression=None,
                max_size=MAX_UP,
                server_header=None,
                ping_timeout=60.0,
            )
        except OSError as error:
            served.set_exception(error)
            return
        served.set_result(next(iter(server.sockets)).getsockname()[1])
        await asyncio.get_running_loop().create_future()  # forever: the process ends with its standard input

    async def _serve_client(self, socket: ServerConnection) -> None:
        viewer = FoxgloveClient()
        with self._lock:
            is_full = len(self._viewers) >= MAX_VIEWERS
            if not is_full:
                self._viewers[viewer] = None
                info = {"op": "serverInfo", "name": self._name, "capabilities": [], "supportedEncodings": []}
                viewer.words.append(json.dumps(info))
                viewer.words.append(_advertise(list(self._channels.values())))
        if is_full:
            await socket.close(1013, f"{MAX_VIEWERS} viewers are attached already")
            return
        sending = asyncio.create_task(_send(socket, viewer), name="viewer: send")
        try:
            with contextlib.suppress(ConnectionClosed):
                async for message in socket:
                    self._on_message(viewer, message)
        finally:
            await end_tasks(sending)
            with self._lock:
                del self._viewers[viewer]
                self._unsubscribe(viewer, list(viewer.channels))
            self._changed()

    def _on_message(self, viewer: FoxgloveClient, message: str | bytes) -> None:
        try:
            request = json.loads(message) if isinstance(message, str) else {}
            with self._lock:
                if request["op"] == "subscribe":
                    for one in request["subscriptions"]:
                        self._subscribe(viewer, one["id"], one["channelId"])
                elif request["op"] == "unsubscribe":
                    self._unsubscribe(viewer, request["subscriptionIds"])
                else:
                    raise ValueError
        except (ValueError, KeyError, TypeError, RecursionError):
            words = "This server only accepts subscribe and unsubscribe."
            viewer.words.append(json.dumps({"op": "status", "level": 1, "message": words}))
            viewer.wake_event.set()
            return
        self._changed()

    def _subscribe(self, viewer: FoxgloveClient, subscription: int, channel: int) -> None:
        if type(subscription) is not int or not 0 <= subscription < 1 << 32 or subscription in viewer.channels:
            raise ValueError
        if channel in self._channels and len(viewer.channels) < MAX_SUBSCRIPTIONS:  # it may have been removed
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
            viewer.wake_event.clear()
            if not viewer.words and not viewer.data:
                await viewer.wake_event.wait()


def _advertise(channels: Sequence[Mapping[str, Any]]) -> str:
    return json.dumps({"op": "advertise", "channels": channels})
