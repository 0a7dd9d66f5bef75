"""Rerun's viewer under /rerun/: its page and files, streamed recordings, and live data.

GET /rerun/?recording=ID[&t0&t1]            the viewer on a recording; /rerun/?live[=DEVICE]: on live data
GET /rerun/NAME                             our page's own files, and the viewer's, from the installed wheel
GET /api/recordings/ID/recording.rrd        the recording, converted for a viewer while sent; with `most`, thinned
GET /api/recordings/ID/amount               share of it that a viewer in a browser gets, shown beside the viewer
WS  /rerun/live?device=ID                   <── batches of .rrd, and {"lag_ms", "sent_ms", "dropped"} twice a second
                                            ──> number of batches that the viewer has taken, in decimal

The page may connect to this server only. The viewer would ask its makers' hosts for news and report to them that it was
opened; the page's script and the content-security policy both block that.
"""

import asyncio
import contextlib
import gzip
import math
import time
from pathlib import Path
from typing import Annotated

from fastapi import Query, Request, WebSocket
from fastapi.responses import FileResponse, RedirectResponse, Response, StreamingResponse
from pydantic import BaseModel
from starlette.websockets import WebSocketDisconnect

from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import bytes_of, responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.api.recording_data import OneStore
from imuscope.server.api.static_files import HEADERS
from imuscope.server.concurrency.tasks import until_one_ends
from imuscope.server.errors import DomainError
from imuscope.server.extensions.rerun.assets import NAMES, folder_of, viewer_files
from imuscope.server.extensions.rerun.rrd.size_limit import MAX_ROWS, MAX_WHOLE_ROWS, limit_of
from imuscope.server.extensions.rerun.service import Rerun, RerunFeed, RerunViewer, recording_stream

router = lazy_router()

PAGE = Path(__file__).resolve().parent / "page"
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
SEND_S = 10.0  # a browser that does not take a batch for this long is disconnected
LAG_INTERVAL_S = 0.5
AS_MUCH = "as much as a browser can hold, not as much as it draws smoothly"  # of what a recording has


Time = Annotated[float | None, Query(description="unix seconds")]


class ViewerQuery(BaseModel):
    """Share of a recording that a viewer in a browser gets: rows of all quantities together, in the recording and
    shown; `most` rows of one quantity (0: all), which is one of `every` samples of the largest; and the longest time
    range that opens without thinning, s.
    """

    rows: int
    shown: int
    most: int
    every: int
    whole_s: float


@router.get("/rerun", include_in_schema=False)
async def with_slash(request: Request) -> RedirectResponse:
    """Redirect to the address with a slash, to which the page's relative addresses refer."""
    return RedirectResponse(f"rerun/?{request.url.query}" if request.url.query else "rerun/", 308)


@router.get("/rerun/{name}", include_in_schema=False)
@router.get("/rerun/", include_in_schema=False)
async def file(request: Request, services: TheServices, name: str = "") -> Response:
    """A file of our page, or of the viewer."""
    if name in OWN:
        path = PAGE / OWN[name]
        headers = {**PAGE_HEADERS, "cache-control": "no-cache", "content-type": KINDS[path.suffix]}
        return FileResponse(path, headers=headers)
    if name not in NAMES:
        raise DomainError("not-found", f"The viewer has no file {name:.80}.", "Open /rerun/.")
    data = services.config.data
    folder = await asyncio.to_thread(viewer_files, data)
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
    services: TheServices,
    store: OneStore,
    t0: Time = None,
    t1: Time = None,
    most: Annotated[int, Query(ge=0, le=MAX_ROWS, description="rows of a quantity; 0 for all")] = 0,
) -> Response:
    """The recording for a Rerun viewer, sent while it is converted; static data first."""
    _stretch(t0, t1)
    slots = services.parts.get(Rerun).slots
    if slots.locked():
        raise DomainError("full", "Too many recordings are being opened in Rerun.", "Try again in a moment.")
    title = (await services.catalogue.entry(recording)).title
    request_body = {"store": str(store.folder), "title": title, "t0": t0, "t1": t1, "most": most}
    headers = {"cache-control": "no-store", "x-content-type-options": "nosniff"}
    pieces = recording_stream(request_body, slots)
    return StreamingResponse(pieces, media_type="application/octet-stream", headers=headers)


@router.get("/api/recordings/{recording}/amount", tags=["recordings"], responses=responses(404, 422))
async def get_amount(
    store: OneStore,
    t0: Time = None,
    t1: Time = None,
    as_much: Annotated[bool, Query(alias="all", description=AS_MUCH)] = False,
) -> ViewerQuery:
    """Share of the recording that the embedded Rerun viewer gets: a browser cannot hold an hour of a fast device."""
    begin, end = _stretch(t0, t1)
    limit = await asyncio.to_thread(limit_of, store, begin, end, as_much=as_much)
    first, last = store.span() or (0.0, 0.0)
    span = max(0.0, min(end, last) - max(begin, first))
    whole_s = span * min(1.0, MAX_WHOLE_ROWS / max(1, limit.rows))
    return ViewerQuery(rows=limit.rows, shown=limit.shown, most=limit.most, every=limit.every, whole_s=whole_s)


def _stretch(t0: float | None, t1: float | None) -> tuple[float, float]:
    begin, end = -math.inf if t0 is None else t0, math.inf if t1 is None else t1
    if end < begin or not all(t is None or math.isfinite(t) for t in (t0, t1)):
        raise DomainError("bad-span", "The range ends before it begins.", "Unix seconds, t0 ≤ t1.")
    return begin, end


@router.websocket("/rerun/live")
async def live(socket: WebSocket, services: TheServices, device: str = "") -> None:
    """Send batches to one viewer until it disconnects."""
    await socket.accept()
    try:
        async with services.parts.get(Rerun).open_viewer(device) as (feed, viewer):
            tasks = [
                asyncio.create_task(_send(socket, feed, viewer), name="rerun viewer: send"),
                asyncio.create_task(_receive(socket, viewer), name="rerun viewer: receive"),
            ]
            await until_one_ends(tasks)
    except DomainError as error:
        with contextlib.suppress(RuntimeError):
            await socket.close(TRY_LATER, error.message[:120])
    except (WebSocketDisconnect, RuntimeError, OSError):
        pass


async def _send(socket: WebSocket, feed: RerunFeed, viewer: RerunViewer) -> None:
    loop = asyncio.get_running_loop()
    next_report_s = 0.0
    while True:
        newest, batch = await viewer.take()
        async with asyncio.timeout(SEND_S):
            await socket.send_bytes(batch)
            if newest and loop.time() >= next_report_s:
                next_report_s = loop.time() + LAG_INTERVAL_S
                age = {"lag_ms": feed.lag_ms(newest), "sent_ms": 1000 * time.time()}
                await socket.send_json({"kind": "lag", **age, "dropped": viewer.dropped})


async def _receive(socket: WebSocket, viewer: RerunViewer) -> None:
    """Count the batches that the browser's viewer has taken, until it disconnects."""
    while (message := await socket.receive())["type"] != "websocket.disconnect":
        text = message.get("text") or ""
        if not (text.isascii() and text.isdigit() and len(text) < 16):
            return
        viewer.acknowledge(int(text))
