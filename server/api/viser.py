"""The 3D scene under /viser/: viser's own page and WebSocket, through server/views/proxy.py."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Request, WebSocket
from fastapi.responses import RedirectResponse, Response

from server.api.errors import ApiError
from server.api.page import HEADERS
from server.serving import MOST_FROM_VIEWER
from server.views.proxy import TRY_LATER, VIEWER_POLICY, ViewError, fetch, relay
from server.views.viser import Viser

router = APIRouter(include_in_schema=False)

MOST_PAGE = 8 * 1024 * 1024  # viser's page has 0.8 MB

MOST_DOWN = 64 * 1024 * 1024  # a scene with an uploaded mesh, all at once
PAGE_HEADERS = {**HEADERS, "content-security-policy": "; ".join(VIEWER_POLICY), "vary": "accept-encoding"}


def viser_of(request: Request) -> Viser:
    viser: Viser = request.app.state.viser
    return viser


OneViser = Annotated[Viser, Depends(viser_of)]


@router.get("/viser")
@router.get("/viser/{key}")
async def with_slash(request: Request, key: str = "") -> RedirectResponse:
    """The page's address ends with a slash; its WebSocket's does not."""
    query = f"?{request.url.query}" if request.url.query else ""
    return RedirectResponse(f"/viser/{key}/{query}" if key else f"/viser/{query}", 308)


@router.get("/viser/")
@router.get("/viser/{key}/")
async def scene(request: Request, viser: OneViser, key: str = "") -> Response:
    """viser's page for all devices, or for one; starts viser when it does not run."""
    gzip = "gzip" in request.headers.get("accept-encoding", "")
    try:
        page = await fetch(await viser.port(key), "/", most=MOST_PAGE, gzip=gzip)
    except ViewError as error:
        raise ApiError(503, "no-view", error.message, error.hint) from None
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
        port = await viser.port(key)
    except ViewError as error:
        await socket.close(TRY_LATER, error.message[:120])
        return
    viser.looked_at(key)
    try:
        await relay(
            socket, port, speaks=lambda name: name.startswith("viser-v"), most_up=MOST_FROM_VIEWER, most_down=MOST_DOWN
        )
    finally:
        viser.left(key)
