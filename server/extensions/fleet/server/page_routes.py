"""Requests to robots through their fleet server, below /robots/NAME.

The page itself is that of the fleet server, never a file of a robot: a robot delivers data only, so it cannot run code
in the browser of a user who may command others. No browser shows its answers as a page (`SANDBOX`).
"""

import asyncio
import contextlib
import html
import re
from collections.abc import AsyncIterator
from urllib.parse import parse_qsl, quote, urlencode

import msgspec
from fastapi import Request, WebSocket, WebSocketDisconnect
from fastapi.responses import RedirectResponse, Response, StreamingResponse
from starlette.exceptions import HTTPException

from imuscope.server.api.dependencies import TheServices, while_connected
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.api.static_files import HEADERS as PAGE_HEADERS
from imuscope.server.api.static_files import serve
from imuscope.server.concurrency.tasks import until_one_ends
from imuscope.server.errors import DomainError, status_of
from imuscope.server.extensions.fleet.server.robot_routes import TheFleetServer, fleet_server_of
from imuscope.server.extensions.fleet.tunnel.http_tunnel_protocol import (
    MAX_BODY,
    MAX_CLIENT_MESSAGE,
    EndStream,
    OpenStream,
    ResponseHead,
    ResponsePart,
)
from imuscope.server.extensions.fleet.tunnel.http_tunnel_robot import HEADERS
from imuscope.server.extensions.fleet.tunnel.http_tunnel_server import PageStream
from imuscope.server.text.printable import printable

router = lazy_router(include_in_schema=False)

FORWARDED = frozenset({"accept", "content-type", "if-match", "if-none-match", "range"})
"""Headers of a request that are forwarded to a robot; tokens and cookies are not."""
METHODS = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE"]
SANDBOX = "default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'; sandbox"
ACTIVE = re.compile("html|xml|svg|script|css|wasm", re.IGNORECASE)
CLOSE_CODES = (1000, 1001, 1002, 1003, 1008, 1009, 1011, 1012, 1013)
"""Codes below 3000 that may be sent."""
VERSION_HINT = "Its version may be too new for this fleet server; update the fleet server."
MAX_MESSAGE = 32 * 1024 * 1024  # bytes of one message of a WebSocket


def _who(role: str, operator: str, peer: str) -> str:
    return f"{operator or ('operator' if role == 'control' else 'viewer')} at {peer or 'an unknown address'}"


def _request(connection: Request | WebSocket, path: str) -> OpenStream:
    role, peer = connection.state.role, connection.client.host if connection.client else ""
    query = [pair for pair in parse_qsl(connection.url.query, keep_blank_values=True) if pair[0] != "token"]
    return OpenStream(
        stream=0,
        boot="",
        method=connection.scope.get("method", "GET"),
        path=path,
        query=urlencode(query),
        headers=tuple((name, text) for name, text in connection.headers.items() if name in FORWARDED),
        role=role,
        who=_who(role, connection.state.operator, peer),
        peer=peer[:64],
    )


@router.get("/robots/{robot}")
async def page_of_robot(robot: str, server: TheFleetServer, request: Request) -> Response:
    """The address of a robot's page ends with a slash. Relative: a proxy may have put the fleet server below a path."""
    return RedirectResponse(f"{quote(robot)}/", headers={"cache-control": "no-store"})


@router.api_route("/robots/{robot}/api/{path:path}", methods=METHODS)
async def request_to_robot(
    robot: str, path: str, server: TheFleetServer, services: TheServices, request: Request
) -> Response:
    """Pass a request on to a robot, and its answer back."""
    outgoing = _request(request, f"/api/{path}")
    body = b""
    if int(request.headers.get("content-length", "0")) <= MAX_BODY:
        body = await request.body()
    elif outgoing.method in METHODS:
        hint = "Open the page at the robot's own address."
        raise DomainError("too-large", f"A body through the fleet may have at most {MAX_BODY} bytes.", hint)
    changes = services.access.routes.is_command(outgoing.method, outgoing.path)
    log_text = f"{outgoing.who}: {outgoing.method} {printable(outgoing.path[:200])}"
    try:
        stream = server.pages.open(
            robot, lambda number, boot: msgspec.structs.replace(outgoing, stream=number, boot=boot, body=body)
        )
        try:
            head = await while_connected(request, stream.next())
            if not isinstance(head, ResponseHead | None):
                raise DomainError("refused", "The robot's answer is not valid.", VERSION_HINT)
        except BaseException:
            stream.close()
            raise
    except DomainError as error:
        if changes:
            server.note_command(robot, "warning", f"Command of {log_text}: {error.message}")
        raise
    if head is None:
        stream.close()
        if changes:
            server.note_command(robot, "warning", f"Command of {log_text}: the viewer left before the answer.")
        return Response(status_code=204)  # the viewer disconnected
    if changes:
        server.note_command(robot, "info", f"Command of {log_text}: answered with {head.status}.")
    return StreamingResponse(_body(stream), head.status, _headers(head))


async def _body(stream: PageStream) -> AsyncIterator[bytes]:
    """The body, each part taken when the viewer has it. An answer that breaks off never looks complete."""
    try:
        while not isinstance(part := await stream.next(), EndStream):
            if not isinstance(part, ResponsePart):
                raise DomainError("refused", "The robot's answer is not valid.", VERSION_HINT)
            if part.data:
                yield part.data
                stream.acknowledge(len(part.data))
    finally:
        stream.close()


def _headers(head: ResponseHead) -> dict[str, str]:
    headers = {name: text for name, text in head.headers if name in HEADERS}
    kind = headers.get("content-type", "")
    if ACTIVE.search(kind):
        headers["content-type"] = "application/octet-stream"
        headers.setdefault("content-disposition", "attachment")
    headers.setdefault("cache-control", "no-store")
    return {**headers, "content-security-policy": SANDBOX, "x-content-type-options": "nosniff"}


@router.api_route("/robots/{robot}/{name:path}", methods=["GET", "HEAD"])
async def page_file(robot: str, name: str, server: TheFleetServer, services: TheServices, request: Request) -> Response:
    """A file of our own page. The page itself says which robot it shows."""
    if name and (answer := serve(request, services.page_files, name)) is not None:
        return answer
    page = services.page_files.get("index.html")
    if name or page is None:
        raise HTTPException(404)
    shown = page.data.replace(b"<html", f'<html data-robot="{html.escape(robot)}"'.encode(), 1)
    return Response(shown, media_type="text/html", headers={**PAGE_HEADERS, "cache-control": "no-store"})


@router.websocket("/robots/{robot}/ws")
async def live_of_robot(robot: str, socket: WebSocket, services: TheServices) -> None:
    """Pass the live WebSocket of a robot on."""
    try:
        server = await fleet_server_of(services)
        offered = tuple(str(one) for one in socket.scope.get("subprotocols", ()))[:8]
        request = msgspec.structs.replace(_request(socket, "/ws"), socket=offered)
        stream = server.pages.open(
            robot, lambda number, boot: msgspec.structs.replace(request, stream=number, boot=boot)
        )
    except DomainError as error:
        await _close(socket, error)
        return
    try:
        head = await stream.next()
        if not isinstance(head, ResponseHead):
            raise DomainError("refused", "The robot's answer is not valid.", VERSION_HINT)
        await socket.accept(head.subprotocol if head.subprotocol in offered else None)
        tasks = [
            asyncio.create_task(_to_robot(socket, stream), name="browser: to the robot"),
            asyncio.create_task(_from_robot(socket, stream), name="browser: from the robot"),
        ]
        await until_one_ends(tasks)
    except DomainError as error:
        await _close(socket, error)
    except (WebSocketDisconnect, RuntimeError, OSError):
        pass  # the browser has gone
    finally:
        stream.close()


async def _close(socket: WebSocket, error: DomainError) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        await socket.close(1008 if status_of(error.kind) < 500 else 1011, _reason(error.message))


def _reason(text: str) -> str:
    """Text as long as the reason of a close may be: 123 bytes (RFC 6455, 5.5)."""
    return printable(text).encode()[:120].decode(errors="ignore")


async def _to_robot(socket: WebSocket, stream: PageStream) -> None:
    while (message := await socket.receive())["type"] == "websocket.receive":
        text = message.get("text")
        if text is None or len(text) > MAX_CLIENT_MESSAGE:
            raise DomainError("bad-request", "A browser sends short text frames only.", "Reload the page.")
        stream.send_text(text)


async def _from_robot(socket: WebSocket, stream: PageStream) -> None:
    message = bytearray()
    while not isinstance(part := await stream.next(), EndStream):
        if not isinstance(part, ResponsePart) or len(message) > MAX_MESSAGE:
            raise DomainError("refused", "The robot's answer is not valid.", VERSION_HINT)
        message += part.data
        if part.is_last and part.is_text:
            await socket.send_text(message.decode(errors="replace"))
        elif part.is_last:
            await socket.send_bytes(bytes(message))
        stream.acknowledge(len(part.data))
        if part.is_last:
            message.clear()
    await socket.close(part.code if part.code in CLOSE_CODES or part.code >= 3000 else 1011, _reason(part.reason))
