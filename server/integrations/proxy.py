"""Between a browser and a viewer's own server on loopback: pages and WebSockets, and no more than those.

    browser ──our port, our rules (server/auth.py)──> here ──127.0.0.1──> the viewer's port

What goes through is chosen, not copied: of a request its path and nothing of its headers, so no token and no cookie
reaches a library; of a WebSocket the subprotocols that its viewer speaks, and of the messages those that whoever sends
them may send. The viewer's port knows us by a secret (server/integrations/shared_secret.py). Sizes are limited both
ways. Each side is closed with the other. A browser that takes nothing holds up only its own pipe: messages wait in the
viewer, which keeps the newest state (viser) or drops the oldest (Foxglove), and after `STUCK_S` the browser is
disconnected.
"""

from __future__ import annotations

import asyncio
import contextlib
import http.client
from collections.abc import Callable
from dataclasses import dataclass

from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from server.auth import refuse
from server.integrations.shared_secret import SecretEndpoint
from server.wire import Problem

OPEN_S = 10.0
STUCK_S = 20.0
TRY_LATER, RESTARTING, FAILED = 1013, 1012, 1011  # codes of a closed WebSocket (IANA registry)
GOING, LOST = 1001, 1006  # how a viewer that ends says so, and one that cannot say it any more

# A viewer's page may do what its own code needs, but talk to nobody else than this server.
VIEWER_POLICY = (
    "default-src 'none'",
    "script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:",
    "style-src 'self' 'unsafe-inline'",
    "img-src 'self' data: blob:",
    "font-src 'self' data:",
    "connect-src 'self' data: blob:",  # its own parts are fetched from addresses that hold them: no other host
    "worker-src 'self' blob:",
    "base-uri 'none'",
    "form-action 'none'",
    "frame-ancestors 'self'",
)


@dataclass(frozen=True, slots=True)
class Page:
    """What a viewer's server answered."""

    status: int
    kind: str  # content type
    encoding: str  # content encoding, "" for none
    body: bytes


class ViewError(Exception):
    """A viewer that cannot be shown: a sentence and what to do.

    Args:
        status: of HTTP: 404 for what is not there, 503 for a viewer that does not run.
    """

    def __init__(self, message: str, hint: str = "", status: int = 503) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.status = status

    @property
    def kind(self) -> str:
        """One word for programs."""
        return "not-found" if self.status == 404 else "no-view"


async def fetch(door: SecretEndpoint, path: str, *, most: int, gzip: bool) -> Page:
    """A file of a viewer's server.

    Args:
        most: bytes that the answer may have.
        gzip: whether it may be compressed.
    Raises:
        ViewError: it does not answer, or with more than that.
    """
    try:
        page = await asyncio.to_thread(_fetch, door, path, most + 1, gzip)
    except (OSError, http.client.HTTPException):
        raise ViewError("The viewer does not answer.", "Reload in a moment.") from None
    if len(page.body) > most:
        raise ViewError("The viewer answered with more than it should.", "Is it of the installed version?")
    return page


def _fetch(door: SecretEndpoint, path: str, most: int, gzip: bool) -> Page:
    connection = http.client.HTTPConnection("127.0.0.1", door.port, timeout=OPEN_S)
    try:
        headers = {"Accept-Encoding": "gzip" if gzip else "identity", **door.headers}
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        kind = answer.getheader("content-type", "application/octet-stream")
        encoding = answer.getheader("content-encoding", "")
        return Page(answer.status, kind, "" if encoding == "identity" else encoding, answer.read(most))
    finally:
        connection.close()


async def relay(
    browser: WebSocket,
    door: SecretEndpoint,
    *,
    speaks: Callable[[str], bool],
    most_up: int,
    most_down: int,
    passes: Callable[[bytes | str], bool] = lambda message: True,
) -> None:
    """Accept a browser's WebSocket and be the pipe to a viewer's until either ends.

    Args:
        speaks: which of the browser's subprotocols are offered to the viewer.
        most_up, most_down: bytes in a message from the browser, and to it.
        passes: which of the browser's messages reach the viewer; the others are dropped.
    """
    offered = [Subprotocol(name) for name in browser.scope.get("subprotocols", []) if speaks(name)]
    try:
        viewer = await connect(
            f"ws://127.0.0.1:{door.port}/",
            additional_headers=door.headers,
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


async def reject(browser: WebSocket, why: ViewError) -> None:
    """Refuse a WebSocket that was not accepted yet, in the one shape of errors."""
    problem = Problem(why.kind, why.message, why.hint)
    await refuse(browser.scope, browser.receive, browser.send, why.status, problem)


async def _pump(
    browser: WebSocket, viewer: ClientConnection, most_up: int, passes: Callable[[bytes | str], bool]
) -> None:
    up = asyncio.create_task(_up(browser, viewer, most_up, passes), name="browser to viewer")
    down = asyncio.create_task(_down(browser, viewer), name="viewer to browser")
    try:
        await asyncio.wait((up, down), return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in (up, down):
            task.cancel()
        await asyncio.gather(up, down, return_exceptions=True)
    stuck = not down.cancelled() and isinstance(down.exception(), TimeoutError)
    transport = browser.scope.get("extensions", {}).get("imuscope.transport")
    if stuck and transport is not None:
        transport.abort()
    elif not up.cancelled() and isinstance(up.exception(), _TooLargeError):
        await _close(browser, 1009, "too large")
    elif viewer.close_code in (None, GOING, LOST):
        await _close(browser, RESTARTING, "the viewer has ended")
    else:
        await _close(browser, FAILED, "the viewer has ended this connection")


async def _close(browser: WebSocket, code: int, reason: str) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        await browser.close(code, reason)


class _TooLargeError(Exception):
    """The browser sent more in one message than it may."""


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
            async with asyncio.timeout(STUCK_S):  # what it raises tells `_pump` that the browser is stuck
                if isinstance(message, str):
                    await browser.send_text(message)
                else:
                    await browser.send_bytes(message)
