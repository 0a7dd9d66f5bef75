"""Headless client of a 3D scene: speaks viser's WebSocket as its page does, for tests and benches.

from viser   u64 size │ u64 compressed size │ zstd of MessagePack {"messages": […]} │ padding │ buffers
to viser     MessagePack of one message; after the first camera one counts as a viewer
"""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from importlib.metadata import version
from typing import Any

import msgspec
import zstandard
from websockets.asyncio.client import ClientConnection

from tests.support.timeouts import connecting

CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [1.0, 1.0, 1.0],
    "fov": 1.0,
    "near": 0.1,
    "far": 100.0,
    "image_height": 100,
    "image_width": 100,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


def subprotocol() -> str:
    """Requests of the page of the installed viser."""
    return "viser-v" + version("viser")


@contextlib.asynccontextmanager
async def viewing(url: str, path: str = "/viser", **options: Any) -> AsyncIterator[ClientConnection]:
    """A viewer of a scene of the server at `url`."""
    address = url.replace("http", "ws", 1) + path
    async with connecting(address, subprotocols=[subprotocol()], max_size=None, **options) as socket:  # type: ignore[list-item]
        await socket.send(msgspec.msgpack.encode(CAMERA))
        yield socket


def messages(data: str | bytes) -> list[dict[str, Any]]:
    """Contents of one WebSocket message of viser."""
    assert isinstance(data, bytes)
    size = int.from_bytes(data[8:16], "little")
    decoded = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(data[16 : 16 + size]))
    return list(decoded["messages"])


def turns(data: str | bytes) -> list[list[float]]:
    """Orientations (wxyz) of bodies in one WebSocket message."""
    return [
        one["wxyz"]
        for one in messages(data)
        if one["type"] == "SetOrientationMessage" and one["name"].endswith("/body")
    ]
