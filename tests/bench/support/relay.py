"""Reference for the fan-out benchmark: a WebSocket server that relays messages from `/send` to all others.

It prints its port. uvicorn and `websockets` as in the product, and nothing above them.
"""

from __future__ import annotations

import asyncio
import socket
from typing import Any

import uvicorn

listeners: set[Any] = set()


async def relay(scope: dict[str, Any], receive: Any, send: Any) -> None:
    """The ASGI application."""
    if scope["type"] != "websocket":
        return
    await receive()
    await send({"type": "websocket.accept"})
    if scope["path"] != "/send":
        listeners.add(send)
    while (event := await receive())["type"] == "websocket.receive":
        message = {"type": "websocket.send", "bytes": event["bytes"]}
        await asyncio.gather(*(listener(message) for listener in listeners))
    listeners.discard(send)


def main() -> None:
    """The command line."""
    door = socket.create_server(("127.0.0.1", 0))
    print(door.getsockname()[1], flush=True)
    config = uvicorn.Config(relay, log_level="warning", ws_per_message_deflate=False, lifespan="off")
    uvicorn.Server(config).run(sockets=[door])


if __name__ == "__main__":
    main()
