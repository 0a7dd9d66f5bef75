"""A client of the Foxglove protocol."""

import asyncio
import contextlib
import json
import struct
from collections.abc import AsyncIterator
from typing import Any

from websockets.asyncio.client import ClientConnection

from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, connecting

SUBPROTOCOL = "foxglove.sdk.v1"


class FoxgloveTestClient:
    """A viewer: advertised channels, and messages of its subscriptions."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self._topics: dict[int, str] = {}

    async def until(self, *topics: str) -> None:
        """Read until these are advertised."""
        async with asyncio.timeout(PATIENCE_S):
            while not self.info or not set(topics) <= self.channels.keys():
                self._text(await self._socket.recv())

    def _text(self, data: str | bytes) -> None:
        if isinstance(data, bytes):
            return
        message = json.loads(data)
        if message["op"] == "serverInfo":
            self.info = message
        elif message["op"] == "advertise":
            self.channels |= {channel["topic"]: channel for channel in message["channels"]}
        elif message["op"] == "unadvertise":
            gone = set(message["channelIds"])
            self.channels = {topic: one for topic, one in self.channels.items() if one["id"] not in gone}

    async def subscribe(self, *topics: str) -> None:
        expected = []
        for topic in topics:
            number = 1000 + len(self._topics)
            self._topics[number] = topic
            expected.append({"id": number, "channelId": self.channels[topic]["id"]})
        await self._socket.send(json.dumps({"op": "subscribe", "subscriptions": expected}))

    async def messages(self, expected: int) -> list[tuple[str, float, bytes]]:
        """Receive this many messages: topic, unix s, payload."""
        results: list[tuple[str, float, bytes]] = []
        async with asyncio.timeout(PATIENCE_S):
            while len(results) < expected:
                data = await self._socket.recv()
                if isinstance(data, str):
                    self._text(data)
                    continue
                opcode, number, time_ns = struct.unpack_from("<BIQ", data)
                assert opcode == 1
                results.append((self._topics[number], time_ns / 1e9, data[13:]))
        return results


@contextlib.asynccontextmanager
async def attached(server: ServerProcess, path: str = "/foxglove", **options: Any) -> AsyncIterator[FoxgloveTestClient]:
    """A client behind the server's port; the bridge may still be starting."""
    address = server.url.replace("http", "ws") + path
    async with (
        asyncio.timeout(PATIENCE_S),
        connecting(address, subprotocols=[SUBPROTOCOL], max_size=None, **options) as socket,
    ):
        assert socket.subprotocol == SUBPROTOCOL
        yield FoxgloveTestClient(socket)


def protobuf(data: bytes) -> dict[int, bytes]:
    """The fields of a message, as bytes: the wire format of protocol buffers, as far as it is needed here."""
    fields: dict[int, bytes] = {}
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        if key & 7 == 1:
            fields[key >> 3], at = data[at : at + 8], at + 8
        elif key & 7 == 2:
            size, at = _varint(data, at)
            fields[key >> 3], at = data[at : at + size], at + size
        else:
            assert key & 7 == 0
            value, at = _varint(data, at)
            fields[key >> 3] = value.to_bytes(8, "little")
    return fields


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if not byte & 0x80:
            return value, at


def channel(*columns: dict[str, Any], **more: Any) -> dict[str, Any]:
    about = {"id": 7, "name": "Q", "title": "Rate of turn", "group": "", "kind": "vector", "doc": "", "frame": ""}
    return {**about, "columns": list(columns), **more}
