"""Proxy between a browser and a viewer's own server on loopback, for pages and WebSockets only.

    browser ──our port, our rules (server/access/auth.py)──> here ──127.0.0.1──> the viewer's port

Only selected parts are passed on: the path of a request but none of its headers, so that no token or cookie reaches a
library; the subprotocols of a WebSocket that the viewer supports; and the messages that the client is allowed to send.
The viewer's port identifies us by a secret (server/integrations/shared_secret.py). Sizes are limited in both
directions. Each side is closed with the other. A stalled browser blocks only its own connection: messages wait in the
viewer, which keeps the newest state (viser) or drops the oldest (Foxglove), and after `STUCK_S` the browser is
disconnected.
"""

import asyncio
import contextlib
import http.client
from collections.abc import Callable
from dataclasses import dataclass

from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from imuscope.server.access.auth import refuse
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.errors import DomainError
from imuscope.server.integrations.shared_secret import SecretEndpoint
from imuscope.server.integrations.viewer_process import ViewError

OPEN_S = 10.0
STUCK_S = 20.0
SERVICE_RESTART, INTERNAL_ERROR = 1012, 1011  # codes of a closed WebSocket (IANA registry)
GOING_AWAY, ABNORMAL_CLOSURE = 1001, 1006  # closed by a viewer that ends, and connection lost

# A viewer's page may do what its own code needs, but connect to this server only.
VIEWER_POLICY = (
    "default-src 'none'",
    "script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:",
    "style-src 'self' 'unsafe-inline'",
    "img-src 'self' data: blob:",
    "font-src 'self' data:",
    "connect-src 'self' data: blob:",  # data: and blob: addresses hold its own parts, no other host
    "worker-src 'self' blob:",
    "base-uri 'none'",
    "form-action 'none'",
    "frame-ancestors 'self'",
)


@dataclass(frozen=True, slots=True)
class Page:
    """Response of a viewer's server."""

    status: int
    kind: str  # content type
    encoding: str  # content encoding, "" for none
    body: bytes


async def fetch(endpoint: SecretEndpoint, path: str, *, most: int, gzip: bool) -> Page:
    """A file of a viewer's server.

    Args:
        most: maximum size of the answer, bytes.
        gzip: whether it may be compressed.

    Raises:
        ViewError: no answer, or too large.
    """
    try:
        page = await asyncio.to_thread(_fetch, endpoint, path, most + 1, gzip)
    except (OSError, http.client.HTTPException):
        raise ViewError("The viewer does not answer.", "Reload in a moment.") from None
    if len(page.body) > most:
        raise ViewError("The viewer's response is too long.", "Check that its version is the installed one.")
    return page


def _fetch(endpoint: SecretEndpoint, path: str, most: int, gzip: bool) -> Page:
    connection = http.client.HTTPConnection("127.0.0.1", endpoint.port, timeout=OPEN_S)
    try:
        headers = {"Accept-Encoding": "gzip" if gzip else "identity", **endpoint.headers}
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        kind = answer.getheader("content-type", "application/octet-stream")
        encoding = answer.getheader("content-encoding", "")
        return Page(answer.status, kind, "" if encoding == "identity" else encoding, answer.read(most))
    finally:
        connection.close()


async def relay(
    browser: WebSocket,
    endpoint: SecretEndpoint,
    *,
    speaks: Callable[[str], bool],
    most_up: int,
    most_down: int,
    passes: Callable[[bytes | str], bool] = lambda message: True,
) -> None:
    """Accept a browser's WebSocket and relay it to the viewer until either side ends.

    Args:
        speaks: selects the browser's subprotocols that are offered to the viewer.
        most_up, most_down: maximum size of a message from the browser, and to it, bytes.
        passes: selects the browser's messages that are passed to the viewer; the others are dropped.
    """
    offered = [Subprotocol(name) for name in browser.scope.get("subprotocols", []) if speaks(name)]
    try:
        viewer = await connect(
            f"ws://127.0.0.1:{endpoint.port}/",
            additional_headers=endpoint.headers,
            subprotocols=offered or None,
            compression=None,
            max_size=most_down,
            open_timeout=OPEN_S,
            ping_interval=None,
            close_timeout=1.0,
            user_agent_header=None,
            proxy=None,
        )
    except (OSError, InvalidHandshake, TimeoutError):
        await reject(browser, ViewError("The viewer does not answer.", "Try again in a moment."))
        return
    try:
        await browser.accept(viewer.subprotocol)
        await _pump(browser, viewer, most_up, passes)
    finally:
        await viewer.close()


async def reject(browser: WebSocket, why: DomainError) -> None:
    """Refuse a WebSocket that was not accepted yet, in the common error shape."""
    await refuse(browser.scope, browser.receive, browser.send, why)


async def _pump(
    browser: WebSocket, viewer: ClientConnection, most_up: int, passes: Callable[[bytes | str], bool]
) -> None:
    up = asyncio.create_task(_up(browser, viewer, most_up, passes), name="browser to viewer")
    down = asyncio.create_task(_down(browser, viewer), name="viewer to browser")
    try:
        await asyncio.wait((up, down), return_when=asyncio.FIRST_COMPLETED)
    finally:
        await end_tasks(up, down)
    stuck = not down.cancelled() and isinstance(down.exception(), TimeoutError)
    transport = browser.scope.get("extensions", {}).get("imuscope.transport")
    if stuck and transport is not None:
        transport.abort()
    elif not up.cancelled() and isinstance(up.exception(), _TooLargeError):
        await _close(browser, 1009, "too large")
    elif viewer.close_code in (None, GOING_AWAY, ABNORMAL_CLOSURE):
        await _close(browser, SERVICE_RESTART, "the viewer has ended")
    else:
        await _close(browser, INTERNAL_ERROR, "the viewer has ended this connection")


async def _close(browser: WebSocket, code: int, reason: str) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        await browser.close(code, reason)


class _TooLargeError(Exception):
    """The browser sent a message that is too large."""


async def _up(browser: WebSocket, viewer: ClientConnection, most: int, passes: Callable[[bytes | str], bool]) -> None:
    with contextlib.suppress(ConnectionClosed):
        while True:
            message = await browser.receive()
            if message["type"] == "websocket.disconnect":
                return
            body = message.get("bytes")
            body = message["text"] if body is None else body
            if len(body) > most:
                raise _TooLargeError
            if passes(body):
                await viewer.send(body)


async def _down(browser: WebSocket, viewer: ClientConnection) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        async for message in viewer:
            async with asyncio.timeout(STUCK_S):  # on TimeoutError, `_pump` disconnects the stalled browser
                if isinstance(message, str):
                    await browser.send_text(message)
                else:
                    await browser.send_bytes(message)
