"""The 3D scene under /viser/: viser's own page and WebSocket, through server/integrations/proxy.py.

GET /api/views/scene?device=ID      begins a scene (all devices without one): {"address": "/viser/ID/"}
/viser/…                            that page and its WebSocket
/ws/scene/RECORDING                 a page that plays a recording says where it reads, and is told of a scene of its
                                    own that follows:   <── {"address": "/viser/replay-…/"}
                                                        ──> {"t": unix s, "rate": recorded seconds in a second}
"""

from __future__ import annotations

import asyncio
import json
from typing import Annotated

import msgspec
from fastapi import APIRouter, Depends, Query, Request, WebSocket
from fastapi.responses import RedirectResponse, Response
from starlette.websockets import WebSocketDisconnect

from recordings.mcap_writer import RecordingError
from server.api.errors import ApiError, responses
from server.api.static_files import HEADERS
from server.http_server import MOST_FROM_VIEWER
from server.integrations.proxy import VIEWER_POLICY, ViewError, fetch, reject, relay
from server.integrations.replay_sync import ReplayFollower
from server.integrations.viewer_process import PER_S
from server.integrations.viser import Viser

router = APIRouter()

MOST_PAGE = 8 * 1024 * 1024  # viser's page has 0.8 MB

MOST_DOWN = 64 * 1024 * 1024  # a scene with an uploaded mesh, all at once
PAGE_HEADERS = {**HEADERS, "content-security-policy": "; ".join(VIEWER_POLICY), "vary": "accept-encoding"}


def viser_of(request: Request) -> Viser:
    viser: Viser = request.app.state.viser
    return viser


OneViser = Annotated[Viser, Depends(viser_of)]


@router.get("/api/views/scene", tags=["views"], responses=responses(404, 422, 503))
async def begin_scene(
    viser: OneViser, device: Annotated[str, Query(description="id of a device; all when left out")] = ""
) -> dict[str, str]:
    """Begin a 3D scene; its address, as soon as it can be opened."""
    try:
        await viser.door(device)
    except ViewError as error:
        raise ApiError(error.status, error.kind, error.message, error.hint) from None
    return {"address": f"/viser/{device}/" if device else "/viser/"}


@router.get("/viser", include_in_schema=False)
@router.get("/viser/{key}", include_in_schema=False)
async def with_slash(request: Request, key: str = "") -> RedirectResponse:
    """The page's address ends with a slash; its WebSocket's does not."""
    query = f"?{request.url.query}" if request.url.query else ""
    return RedirectResponse(f"/viser/{key}/{query}" if key else f"/viser/{query}", 308)


@router.get("/viser/", include_in_schema=False)
@router.get("/viser/{key}/", include_in_schema=False)
async def scene(request: Request, viser: OneViser, key: str = "") -> Response:
    """viser's page for all devices, or for one; starts viser when it does not run."""
    gzip = "gzip" in request.headers.get("accept-encoding", "")
    try:
        page = await fetch(await viser.door(key), "/", most=MOST_PAGE, gzip=gzip)
    except ViewError as error:
        raise ApiError(error.status, error.kind, error.message, error.hint) from None
    headers = {**PAGE_HEADERS, "content-type": page.kind, "cache-control": "no-cache"}
    if page.encoding:
        headers["content-encoding"] = page.encoding
    return Response(page.body, page.status, headers)


@router.websocket("/viser")
@router.websocket("/viser/{key}")
async def live_scene(socket: WebSocket, key: str = "") -> None:
    """viser's WebSocket, for as long as both sides want."""
    viser: Viser = socket.app.state.viser
    try:
        door = await viser.door(key)
    except ViewError as error:
        await reject(socket, error)
        return
    viser.looked_at(key)
    try:
        await relay(
            socket,
            door,
            speaks=lambda name: name.startswith("viser-v"),
            most_up=MOST_FROM_VIEWER,
            most_down=MOST_DOWN,
            passes=is_said if socket.state.role == "control" else is_view_message,
        )
    finally:
        viser.left(key)


@router.websocket("/ws/scene/{recording}")
async def recorded_scene(socket: WebSocket, recording: str) -> None:
    """A scene that follows a page's player, for as long as the page holds this."""
    viser: Viser = socket.app.state.viser
    try:
        store = await socket.app.state.shelf.opened(recording)
    except (KeyError, FileNotFoundError, RecordingError):
        await reject(socket, ViewError("This recording cannot be opened.", "Its page says why.", 404))
        return
    await socket.accept()
    replayed = ReplayFollower(store)
    key = viser.begin(replayed)
    tasks = (
        asyncio.create_task(_follow(viser, key), name="scene follows a recording"),
        asyncio.create_task(_heads(socket, replayed), name="page says where it reads"),
    )
    try:
        await socket.send_json({"address": f"/viser/{key}/"})
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    except (WebSocketDisconnect, RuntimeError, OSError):
        pass
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await viser.end(key)


class _Said(msgspec.Struct):
    """Of a message of viser's browser, what sort it is."""

    type: str


def is_said(message: bytes | str) -> bool:
    """Is this a message of viser's browser at all? On one that is none viser would end the connection."""
    return _sort_of(message) != ""


def is_view_message(message: bytes | str) -> bool:
    """May who only looks send this to viser? Where they look from, which is their own; a scene's panel and its mesh are
    everybody's: to choose there needs control."""
    return _sort_of(message) == "ViewerCameraMessage"


def _sort_of(message: bytes | str) -> str:
    try:
        return _SAID.decode(message).type if isinstance(message, bytes) else ""
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return ""


_SAID = msgspec.msgpack.Decoder(_Said)


async def _follow(viser: Viser, key: str) -> None:
    while True:
        viser.show(key)
        await asyncio.sleep(1 / PER_S)


async def _heads(socket: WebSocket, replayed: ReplayFollower) -> None:
    """Where the page reads, until it goes or says something else."""
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return
        try:
            said = json.loads(message.get("text") or "")
            t, rate = float(said["t"]), float(said["rate"])
        except (ValueError, KeyError, TypeError):
            return
        if not (abs(t) < 1e12 and abs(rate) < 1e6):  # nor NaN
            return
        replayed.move(t, rate)
