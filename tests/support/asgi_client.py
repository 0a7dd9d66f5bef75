"""Requests to an ASGI application without a network: exact headers, any method, any peer."""

from __future__ import annotations

import asyncio
import atexit
import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote_to_bytes

from starlette.types import ASGIApp

ACCEPTED = 101


@dataclass(frozen=True)
class Answer:
    """Of a request, or of a WebSocket's handshake (`ACCEPTED` when it was let in)."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    def json(self) -> Any:
        return json.loads(self.body)

    @property
    def status_code(self) -> int:
        return self.status

    @property
    def text(self) -> str:
        return self.body.decode()


def send_request(
    app: ASGIApp,
    method: str,
    target: str,
    headers: Mapping[str, str] | None = None,
    *,
    client: str = "198.51.100.7",
    body: bytes = b"",
) -> Answer:
    """One request; `method` "WS" opens a WebSocket and leaves at once.

    Args:
        target: path and query, as they stand in a request line.
        headers: as sent; Host is 192.0.2.1:8080 when they name none.
    """
    request = _send_request(app, method, target, {"host": "192.0.2.1:8080", **(headers or {})}, client, body)
    loop = _loop()
    try:
        return loop.run_until_complete(request)
    finally:
        if left := asyncio.all_tasks(loop):  # as asyncio.run, whose loop of its own took most of the time
            for task in left:
                task.cancel()
            loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))


@functools.cache
def _loop() -> asyncio.AbstractEventLoop:
    """Of all requests of this process."""
    loop = asyncio.new_event_loop()
    atexit.register(loop.close)
    return loop


async def _send_request(
    app: ASGIApp, method: str, target: str, source: Mapping[str, str], client: str, body: bytes
) -> Answer:
    path, _, query = target.partition("?")
    is_socket = method == "WS"
    scope: dict[str, Any] = {
        "type": "websocket" if is_socket else "http",
        "scheme": "ws" if is_socket else "http",
        "http_version": "1.1",
        "path": unquote_to_bytes(path).decode("utf-8", "replace"),
        "raw_path": path.encode(),
        "root_path": "",
        "query_string": query.encode(),
        "headers": [(name.lower().encode(), value.encode("latin-1")) for name, value in source.items()],
        "client": (client, 50_000),
        "server": ("192.0.2.1", 8080),
        "subprotocols": ["imuscope.v1", "foxglove.sdk.v1"],
        "extensions": {"websocket.http.response": {}},
        "state": {},
    }
    if not is_socket:
        scope["method"] = method
    incoming = [{"type": "websocket.connect"}] if is_socket else [{"type": "http.request", "body": body}]
    status, headers, parts = 0, {}, []

    async def receive() -> Any:
        return incoming.pop(0) if incoming else {"type": "websocket.disconnect" if is_socket else "http.disconnect"}

    async def send(message: Any) -> None:
        nonlocal status, headers
        kind = message["type"].removeprefix("websocket.")
        if kind.endswith("http.response.start"):
            status = message["status"]
            headers = {name.decode().lower(): value.decode("latin-1") for name, value in message["headers"]}
        elif kind.endswith("http.response.body"):
            parts.append(message.get("body", b""))
        elif kind == "accept":
            status = ACCEPTED
        elif kind == "close" and not status:
            status = 403  # as a server transforms it

    await app(scope, receive, send)
    return Answer(status, headers, b"".join(parts))


class Reached:
    """Replaces the application: a request that arrives here was authorised, with this role."""

    role = ""

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        self.role = scope["state"].get("role", "open")
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.accept"})
            return
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})
