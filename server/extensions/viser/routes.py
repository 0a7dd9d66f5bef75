"""The 3D scene under /viser/: viser's own page and WebSocket, through server/integrations/proxy.py.

GET /api/views/scene?device=ID      begins a scene (without a device: all devices): {"address": "/viser/ID/"}
/viser/…                            that page and its WebSocket
/ws/scene/RECORDING                 a page that plays a recording sends its position and gets a scene of its own that
                                    follows it:         <── {"address": "/viser/replay-…/"}
                                                        ──> {"t": unix s, "rate": recorded seconds per second}
"""

import asyncio
import json
from typing import Annotated

import msgspec
from fastapi import Query, Request, WebSocket
from fastapi.responses import RedirectResponse, Response
from pydantic import BaseModel, Field
from starlette.websockets import WebSocketDisconnect

from imuscope.recordings.errors import RecordingError
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.api.static_files import HEADERS
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.errors import DomainError
from imuscope.server.extensions.viser.replay_sync import ReplayFollower
from imuscope.server.extensions.viser.service import Viser
from imuscope.server.http.server import MAX_FROM_VIEWER
from imuscope.server.integrations.proxy import VIEWER_POLICY, fetch, reject, relay
from imuscope.server.integrations.viewer_process import FRAMES_PER_S

router = lazy_router()

MAX_PAGE = 8 * 1024 * 1024  # viser's page has 0.8 MB

MAX_DOWN = 64 * 1024 * 1024  # a scene with an uploaded mesh, in one message
PAGE_HEADERS = {**HEADERS, "content-security-policy": "; ".join(VIEWER_POLICY), "vary": "accept-encoding"}


class SceneAddress(BaseModel):
    """Path of a 3D scene that was opened for this client."""

    address: str = Field(description="path on this server")


@router.get("/api/views/scene", tags=["views"], responses=responses(404, 422, 503))
async def begin_scene(
    services: TheServices, device: Annotated[str, Query(description="id of a device; all devices if omitted")] = ""
) -> SceneAddress:
    """Begin a 3D scene; returns its address as soon as it can be opened."""
    await services.parts.get(Viser).endpoint(device)
    return SceneAddress(address=f"/viser/{device}/" if device else "/viser/")


@router.get("/viser", include_in_schema=False)
@router.get("/viser/{key}", include_in_schema=False)
async def with_slash(request: Request, key: str = "") -> RedirectResponse:
    """Redirect to the page's address with a slash; the WebSocket's address has none."""
    query = f"?{request.url.query}" if request.url.query else ""
    return RedirectResponse(f"{key or 'viser'}/{query}", 308)


@router.get("/viser/", include_in_schema=False)
@router.get("/viser/{key}/", include_in_schema=False)
async def scene(request: Request, services: TheServices, key: str = "") -> Response:
    """Viser's page for all devices, or for one; starts viser if it is not running."""
    gzip = "gzip" in request.headers.get("accept-encoding", "")
    page = await fetch(await services.parts.get(Viser).endpoint(key), "/", most=MAX_PAGE, gzip=gzip)
    headers = {**PAGE_HEADERS, "content-type": page.kind, "cache-control": "no-cache"}
    if page.encoding:
        headers["content-encoding"] = page.encoding
    return Response(page.body, page.status, headers)


@router.websocket("/viser")
@router.websocket("/viser/{key}")
async def live_scene(socket: WebSocket, services: TheServices, key: str = "") -> None:
    """Relay viser's WebSocket until either side disconnects."""
    viser = services.parts.get(Viser)
    try:
        endpoint = await viser.endpoint(key)
    except DomainError as error:
        await reject(socket, error)
        return
    leave = viser.add_viewer(key)
    try:
        await relay(
            socket,
            endpoint,
            speaks=lambda name: name.startswith("viser-v"),
            most_up=MAX_FROM_VIEWER,
            most_down=MAX_DOWN,
            passes=is_viser_message if socket.state.role == "control" else is_view_message,
        )
    finally:
        leave()


@router.websocket("/ws/scene/{recording}")
async def recorded_scene(socket: WebSocket, recording: str, services: TheServices) -> None:
    """A scene that follows a page's player until the page disconnects."""
    viser = services.parts.get(Viser)
    try:
        store = await services.columns.opened(recording)
    except (KeyError, FileNotFoundError, RecordingError):
        await reject(socket, DomainError("not-found", "This recording cannot be opened.", "Its page gives the reason."))
        return
    await socket.accept()
    follower = ReplayFollower(store)
    key = viser.begin(follower)
    tasks = (
        asyncio.create_task(_follow(viser, key), name="scene follows a recording"),
        asyncio.create_task(_receive_positions(socket, follower), name="scene: receive playback positions"),
    )
    try:
        await socket.send_json({"address": f"/viser/{key}/"})
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    except (WebSocketDisconnect, RuntimeError, OSError):
        pass
    finally:
        await end_tasks(*tasks)
        await viser.end(key)


class _TypedMessage(msgspec.Struct):
    """Kind of a message from viser's browser."""

    type: str


def is_viser_message(message: bytes | str) -> bool:
    """Whether this is a message of viser's client. Viser closes the connection on any other."""
    return _type_of(message) != ""


def is_view_message(message: bytes | str) -> bool:
    """Whether a view-only client may send this to viser: only its own camera position. The panel and the mesh of a
    scene are shared by all its viewers, so changing them needs control.
    """
    return _type_of(message) == "ViewerCameraMessage"


def _type_of(message: bytes | str) -> str:
    try:
        return _DECODER.decode(message).type if isinstance(message, bytes) else ""
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return ""


_DECODER = msgspec.msgpack.Decoder(_TypedMessage)


async def _follow(viser: Viser, key: str) -> None:
    while True:
        viser.show(key)
        await asyncio.sleep(1 / FRAMES_PER_S)


async def _receive_positions(socket: WebSocket, follower: ReplayFollower) -> None:
    """Read positions of the page, until it disconnects or sends something else."""
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return
        try:
            position = json.loads(message.get("text") or "")
            t, rate = float(position["t"]), float(position["rate"])
        except (ValueError, KeyError, TypeError):
            return
        if not (abs(t) < 1e12 and abs(rate) < 1e6):  # nor NaN
            return
        follower.move(t, rate)
