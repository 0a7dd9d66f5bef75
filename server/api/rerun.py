"""Rerun's viewer under /rerun/: its page, its files, recordings streamed into it, and what devices send now.

GET /rerun/?recording=ID[&t0&t1]            the viewer on a recording; /rerun/?live[=DEVICE]: on what is sent now
GET /rerun/NAME                             our page's own files, and the viewer's, out of the installed wheel
GET /api/recordings/ID/recording.rrd        the recording as it is made for a viewer; with `most`, thinned
GET /api/recordings/ID/amount               how much of it a viewer in a browser gets, to be said beside it
WS  /rerun/live?device=ID                   <── batches of .rrd, and {"lag_ms", "dropped"} twice a second
                                            ──> how many batches the viewer has taken, in decimal

The page may talk to this server and nobody else. The viewer would ask its makers' hosts for news, and tell them that it
was opened: the page's script refuses that, and the policy behind it, too.
"""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import math
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Request, WebSocket
from fastapi.responses import FileResponse, RedirectResponse, Response, StreamingResponse
from pydantic import BaseModel
from starlette.websockets import WebSocketDisconnect

from recordings.rrd.size_limit import MOST, WHOLE, amount_of
from server.api.errors import ApiError, bytes_of, responses
from server.api.recording_data import OneStore
from server.api.static_files import HEADERS
from server.integrations.proxy import ViewError
from server.integrations.rerun import Rerun, RerunFeed, RerunViewer, recording_stream
from server.integrations.rerun_assets import NAMES, folder_of, viewer_files

router = APIRouter()

PAGE = Path(__file__).resolve().parents[1] / "integrations" / "rerun_page"
OWN = {"": "index.html", "start.js": "start.js", "style.css": "style.css"}
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
}
POLICY = (
    "default-src 'none'",
    "script-src 'self' 'wasm-unsafe-eval'",
    "style-src 'self'",
    "img-src 'self' data: blob:",
    "font-src 'self' data:",
    "connect-src 'self'",
    "worker-src 'self' blob:",
    "base-uri 'none'",
    "form-action 'none'",
    "frame-ancestors 'self'",
)
PAGE_HEADERS = {**HEADERS, "content-security-policy": "; ".join(POLICY)}
TRY_LATER = 1013  # code of a closed WebSocket (IANA registry)
SEND_S = 10.0  # a browser that does not take a batch for so long is gone
TELL_S = 0.5


def rerun_of(request: Request) -> Rerun:
    rerun: Rerun = request.app.state.rerun
    return rerun


OneRerun = Annotated[Rerun, Depends(rerun_of)]
Time = Annotated[float | None, Query(description="unix seconds")]


class ViewerQuery(BaseModel):
    """What of a stretch a viewer in a browser gets: rows of all quantities together, in it and shown; `most` of one
    quantity (0: all), which is one of `every` samples where it has the most; and how long a stretch opens whole, s."""

    rows: int
    shown: int
    most: int
    every: int
    whole_s: float


@router.get("/rerun", include_in_schema=False)
async def with_slash(request: Request) -> RedirectResponse:
    """The page's own files lie beside it."""
    return RedirectResponse(f"/rerun/?{request.url.query}" if request.url.query else "/rerun/", 308)


@router.get("/rerun/{name}", include_in_schema=False)
@router.get("/rerun/", include_in_schema=False)
async def file(request: Request, name: str = "") -> Response:
    """A file of our page, or of the viewer."""
    if name in OWN:
        path = PAGE / OWN[name]
        headers = {**PAGE_HEADERS, "cache-control": "no-cache", "content-type": KINDS[path.suffix]}
        return FileResponse(path, headers=headers)
    if name not in NAMES:
        raise ApiError(404, "not-found", f"The viewer has no file {name:.80}.", "Open /rerun/.")
    data = request.app.state.data
    try:
        folder = await asyncio.to_thread(viewer_files, data)
    except ViewError as error:
        raise ApiError(error.status, error.kind, error.message, error.hint) from None
    kind = "application/wasm" if name.endswith(".wasm") else KINDS[".js"]
    etag = f'"{folder_of(data).name}"'
    headers = {**PAGE_HEADERS, "cache-control": "no-cache", "etag": etag, "vary": "accept-encoding"}
    if etag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    packed = await asyncio.to_thread((folder / f"{name}.gz").read_bytes)
    if "gzip" in request.headers.get("accept-encoding", ""):
        return Response(packed, media_type=kind, headers={**headers, "content-encoding": "gzip"})
    return Response(await asyncio.to_thread(gzip.decompress, packed), media_type=kind, headers=headers)


@router.get(
    "/api/recordings/{recording}/recording.rrd",
    tags=["recordings"],
    responses={**bytes_of("application/octet-stream"), **responses(404, 409, 422)},
    response_class=Response,
)
async def get_rrd(
    recording: str,
    request: Request,
    store: OneStore,
    rerun: OneRerun,
    t0: Time = None,
    t1: Time = None,
    most: Annotated[int, Query(ge=0, le=MOST, description="rows of a quantity; 0 for all")] = 0,
) -> Response:
    """The recording for a Rerun viewer, sent while it is made; what is static first."""
    _stretch(t0, t1)
    if rerun.slots.locked():
        raise ApiError(409, "full", "Several recordings are being opened in Rerun already.", "Try again in a moment.")
    title = request.app.state.library.info(recording).title
    wish = {"store": str(store.folder), "title": title, "t0": t0, "t1": t1, "most": most}
    headers = {"cache-control": "no-store", "x-content-type-options": "nosniff"}
    pieces = recording_stream(wish, rerun.slots)
    return StreamingResponse(pieces, media_type="application/octet-stream", headers=headers)


@router.get("/api/recordings/{recording}/amount", tags=["recordings"], responses=responses(404, 422))
async def get_amount(
    store: OneStore,
    t0: Time = None,
    t1: Time = None,
    all: Annotated[bool, Query(description="as much as a browser can hold, not what it draws at once")] = False,
) -> ViewerQuery:
    """How much of it the embedded Rerun viewer gets: an hour of a fast device is more than a browser holds."""
    begin, end = _stretch(t0, t1)
    found = await asyncio.to_thread(amount_of, store, begin, end, as_much=all)
    first, last = store.span() or (0.0, 0.0)
    span = max(0.0, min(end, last) - max(begin, first))
    whole_s = span * min(1.0, WHOLE / max(1, found.rows))
    return ViewerQuery(rows=found.rows, shown=found.shown, most=found.most, every=found.every, whole_s=whole_s)


def _stretch(t0: float | None, t1: float | None) -> tuple[float, float]:
    begin, end = -math.inf if t0 is None else t0, math.inf if t1 is None else t1
    if end < begin or not all(t is None or math.isfinite(t) for t in (t0, t1)):
        raise ApiError(422, "bad-span", "The stretch ends before it begins.", "Unix seconds, t0 ≤ t1.")
    return begin, end


@router.websocket("/rerun/live")
async def live(socket: WebSocket, device: str = "") -> None:
    """Batches for one viewer, for as long as it is there."""
    rerun: Rerun = socket.app.state.rerun
    await socket.accept()
    try:
        async with rerun.look(device) as (feed, viewer):
            tasks = [
                asyncio.create_task(_send(socket, feed, viewer), name="rerun viewer is sent"),
                asyncio.create_task(_listen(socket, viewer), name="rerun viewer is heard"),
            ]
            try:
                done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
                for task in done:
                    task.result()
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
    except ViewError as error:
        with contextlib.suppress(RuntimeError):
            await socket.close(TRY_LATER, error.message[:120])
    except (WebSocketDisconnect, RuntimeError, OSError):
        pass


async def _send(socket: WebSocket, feed: RerunFeed, viewer: RerunViewer) -> None:
    loop = asyncio.get_running_loop()
    tell = 0.0
    while True:
        newest, batch = await viewer.take()
        async with asyncio.timeout(SEND_S):
            await socket.send_bytes(batch)
            if newest and loop.time() >= tell:
                tell = loop.time() + TELL_S
                await socket.send_json({"kind": "lag", "lag_ms": feed.lag_ms(newest), "dropped": viewer.dropped})


async def _listen(socket: WebSocket, viewer: RerunViewer) -> None:
    """How many batches the browser's viewer has taken, until it goes."""
    while (message := await socket.receive())["type"] != "websocket.disconnect":
        text = message.get("text") or ""
        if not (text.isascii() and text.isdigit() and len(text) < 16):
            return
        viewer.acknowledge(int(text))
