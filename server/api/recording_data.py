"""An opened recording: what is in it, any stretch of it for the page and for programs, the frames around a moment.

The same question about what is live is `GET /api/devices/{device}/query`.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import JSONResponse, Response, StreamingResponse

from recordings.column_store import Base, ColumnStore
from recordings.health_history import HealthHistory, fared
from recordings.mcap_writer import RecordingError
from server import wire
from server.api.errors import ApiError, bytes_of, responses
from server.library.api_models import OpeningState, RecordedSettings, RecordingDetail
from server.library.catalogue import Catalogue
from server.library.column_cache import ColumnCache, DecodeJob
from server.library.range_query import (
    ColumnStatistics,
    QueryResult,
    arrow_of,
    frame_of,
    held,
    json_of,
    kept,
    ordered,
    recorded,
    statistics_in,
)
from server.library.recorded_settings import settings_of
from server.library.recording_detail import as_json, channels_of, detail
from server.streaming.hub import Hub

router = APIRouter(tags=["recordings"])

MOST_WIDTH = 8000
MOST_SECONDS = 7200
MOST_TIME = 9e9  # unix s; beyond the year 2255 they are no int64 of ns
MOST_ROWS = 5_000_000  # that one answer gives as they are; a longer stretch is asked for in pieces
SAMPLES = "application/octet-stream"
ARROW = "application/vnd.apache.arrow.stream"

TABLE = {
    200: {"content": {ARROW: {"schema": {"type": "string", "format": "binary"}}, "application/json": {"schema": {}}}},
    **responses(404, 422),
}

Recording = Annotated[str, "id of a recording"]
Time = Annotated[float | None, Query(description="unix seconds")]
Width = Annotated[int, Query(ge=0, le=MOST_WIDTH, description="buckets wanted; 0 for every row")]
Format = Annotated[Literal["arrow", "json"], Query()]
Partial = Annotated[bool, Query(description="while it is decoded for the first time: of what is there so far")]


def shelf_of(request: Request) -> ColumnCache:
    shelf: ColumnCache = request.app.state.shelf
    return shelf


OneShelf = Annotated[ColumnCache, Depends(shelf_of)]


def unknown(recording: str) -> ApiError:
    """There is no such recording."""
    return ApiError(
        404, "not-found", f"There is no recording {recording:.80}.", "It may have been deleted; choose one of the list."
    )


async def columns_of(recording: str, shelf: OneShelf) -> ColumnStore:
    """The columns of a recording, waited for."""
    try:
        return await shelf.opened(recording)
    except (KeyError, FileNotFoundError):
        raise unknown(recording) from None
    except RecordingError as error:
        raise ApiError(422, "cannot-open", error.message, error.hint) from None


async def columns_so_far(recording: str, shelf: OneShelf, partial: Partial = False) -> ColumnStore:
    """The same, or where that is asked for as much of them as is decoded."""
    if not partial:
        return await columns_of(recording, shelf)
    try:
        return await shelf.so_far(recording)
    except (KeyError, FileNotFoundError):
        raise unknown(recording) from None
    except RecordingError as error:
        raise ApiError(422, "cannot-open", error.message, error.hint) from None


OneStore = Annotated[ColumnStore, Depends(columns_of)]
SoFar = Annotated[ColumnStore, Depends(columns_so_far)]


@router.get(
    "/api/recordings/{recording}",
    responses={200: {"model": RecordingDetail}, 202: {"model": OpeningState}, **responses(404, 422)},
)
async def get_recording(recording: str, request: Request, shelf: OneShelf, partial: Partial = False) -> Response:
    """Everything but the samples (RecordingDetail); 202 and an OpeningState while it is decoded for the first time, or
    with `partial` as soon as there is something the RecordingDetail of that, whose `progress` is less than 1."""
    try:
        found = shelf.open(recording)
    except (KeyError, FileNotFoundError):
        raise unknown(recording) from None
    if isinstance(found, DecodeJob):
        if found.error is not None:
            raise ApiError(422, "cannot-open", found.error.message, found.error.hint)
        if not partial or found.partial is None:
            state = OpeningState(recording, found.progress, "Decoding it for the first time.")
            return JSONResponse(asdict(state), 202, headers={"cache-control": "no-store"})
    library: Catalogue = request.app.state.library
    store = found if isinstance(found, ColumnStore) else found.partial
    assert store is not None
    told = await asyncio.to_thread(lambda: detail(library.info(recording), store, library.markers(recording)))
    return JSONResponse(as_json(told), headers={"cache-control": "no-store"})


@router.get(
    "/api/recordings/{recording}/window",
    responses={**bytes_of(SAMPLES), **responses(404, 422)},
    response_class=Response,
)
def get_window(  # a thread of its own: what is not in memory is read from the disk, and live devices do not wait
    store: SoFar,
    t0: float,
    t1: float,
    width: Annotated[int, Query(ge=1, le=MOST_WIDTH)] = 1000,
    base: Base = "device",
    channels: Annotated[str, Query(description="ids, separated by commas; empty for all")] = "",
) -> Response:
    """Sample frames of the wire; a bucket is two rows (least, greatest). `X-Exact: 1` when no channel is summarised."""
    t0, t1 = _span(t0, t1)
    infos = channels_of(store)
    wanted = [_number(word, infos) for word in channels.split(",") if word] or list(infos)
    answers = [recorded(store, infos[number], t0, t1, width, base=base) for number in wanted]
    exact = "1" if all(_is_whole(answer) for answer in answers) else "0"
    body = b"".join(frame_of(answer) for answer in answers)
    return Response(body, media_type=SAMPLES, headers={"x-exact": exact, "cache-control": "no-store"})


@router.get("/api/recordings/{recording}/statistics", responses=responses(404, 422))
def get_statistics(  # in a thread, as the window is
    store: SoFar,
    t0: float,
    t1: float,
    base: Base = "device",
    channels: Annotated[str, Query(description="ids, separated by commas; empty for all")] = "",
) -> dict[int, list[ColumnStatistics]]:
    """Number, mean, σ and extremes of every column of channels over a stretch, however long: channel → its columns."""
    t0, t1 = _span(t0, t1)
    infos = channels_of(store)
    wanted = [_number(word, infos) for word in channels.split(",") if word] or list(infos)
    return {number: statistics_in(store, infos[number], t0, t1, base=base) for number in wanted}


@router.get("/api/recordings/{recording}/fared", responses=responses(404, 422))
def get_fared(
    store: SoFar,
    device: str,
    t0: Annotated[float, Query(description="unix seconds")],
    t1: Annotated[float, Query(description="unix seconds")],
) -> HealthHistory:
    """How a device fared, second by second: bytes, samples of each message, how late they came, its clock."""
    t0, t1 = _span(t0, t1)
    known = {told["id"]: told.get("parent", "") for told in store.manifest["devices"]}
    if device not in known:
        there = ", ".join(known)
        raise ApiError(404, "not-found", f"There is no device {device:.40} in it.", f"There are: {there:.400}.")
    if t1 - t0 > MOST_SECONDS:
        raise ApiError(422, "too-many", f"At most {MOST_SECONDS} seconds come at once.", "Ask for a shorter stretch.")
    names = store.manifest.get("fared", {})
    return fared(store.folder, names, device, known[device] or device, math.floor(t0), math.floor(t1))


@router.get("/api/recordings/{recording}/settings", responses=responses(404, 422))
def get_settings(store: SoFar, device: Annotated[str, Query(description="id of a device in it")]) -> RecordedSettings:
    """What a device was set to when it was recorded, in the words of Configure; nothing where that was not recorded."""
    return settings_of(store.manifest["snapshots"].get(device, {}))


@router.get("/api/recordings/{recording}/query", responses=TABLE, response_class=Response)
def query_recording(
    store: OneStore,
    request: Request,
    channel: Annotated[str, Query(description="id, or name")],
    t0: Time = None,
    t1: Time = None,
    width: Width = 0,
    columns: Annotated[str, Query(description="names, separated by commas; empty for all")] = "",
    base: Base = "device",
    format: Format = "arrow",
    device: Annotated[str, Query(description="where several devices have a channel of that name")] = "",
) -> Response:
    """One channel as a table: Arrow or JSON, rows as they are or in buckets."""
    infos = channels_of(store)
    info = infos[_number(channel, infos, device)]
    whole = store.span(info.id, base) or (0.0, 0.0)
    t0, t1 = _span(whole[0] if t0 is None else t0, whole[1] if t1 is None else t1)
    if not width and store.row_at(info.id, t1, base) - store.row_at(info.id, t0, base) > MOST_ROWS:
        hint = f"Ask for a shorter stretch, or give `width`; at most {MOST_ROWS} rows come at once."
        raise ApiError(422, "too-many", "The stretch has too many rows for one answer.", hint)
    _only_one(request)
    answer = recorded(store, info, t0, t1, width, columns=_positions(info, columns), base=base)
    return _table(ordered(answer) if base == "device" else answer, format)


@router.get("/api/devices/{device}/query", tags=["devices"], responses=TABLE, response_class=Response)
async def query_device(
    device: str,
    request: Request,
    channel: Annotated[str, Query(description="id, or name")],
    t0: Time = None,
    t1: Time = None,
    width: Width = 0,
    columns: Annotated[str, Query(description="names, separated by commas; empty for all")] = "",
    base: Base = "device",
    format: Format = "arrow",
) -> Response:
    """What the server remembers of a live channel, as a table: the same question as of a recording."""
    hub: Hub = request.app.state.hub
    own = {number: one.info for number, one in hub.channels.items() if one.info.device == device}
    if not own:
        raise ApiError(
            404,
            "not-found",
            f"There is no device {device:.40} with channels.",
            "It may have been removed; choose one of the list.",
        )
    number = _number(channel, own)
    t0, t1 = _span(0.0 if t0 is None else t0, hub.now() + 60 if t1 is None else t1)
    positions = _positions(own[number], columns)
    _only_one(request)
    whole = kept(hub.channels[number], t0, base)
    answer = await asyncio.to_thread(held, own[number], whole, t0, t1, width, columns=positions, base=base)
    return _table(await asyncio.to_thread(ordered, answer) if base == "device" else answer, format)


def _span(t0: float, t1: float) -> tuple[float, float]:
    if not (abs(t0) < MOST_TIME and abs(t1) < MOST_TIME) or t1 < t0:  # nor NaN
        raise ApiError(422, "bad-span", f"From {t0:g} to {t1:g} is no stretch of time.", "Unix seconds, t0 ≤ t1.")
    return t0, t1


def _number(word: str, infos: Mapping[int, wire.ChannelInfo], device: str = "") -> int:
    """The channel of an id or a name; of several of one name the newest."""
    if word.isdecimal() and int(word) in infos:
        return int(word)
    named = [number for number, info in infos.items() if info.name == word and device in ("", info.device)]
    if named:
        return max(named)
    there = ", ".join(sorted({info.name for info in infos.values()}))
    raise ApiError(404, "not-found", f"There is no channel {word:.60}.", f"There are: {there:.400}.")


def _only_one(request: Request) -> None:
    if len(request.query_params.getlist("channel")) > 1:
        hint = "Ask for each, or export several as one table (csv-aligned)."
        raise ApiError(422, "too-many", "One channel comes at a time, and several were named.", hint)


def _positions(info: wire.ChannelInfo, words: str) -> list[int] | None:
    names = [column.name for column in info.columns]
    wanted = [word for word in words.split(",") if word]
    for word in wanted:
        if word not in names:
            there = ", ".join(names)
            raise ApiError(404, "not-found", f"{info.name} has no column {word:.60}.", f"It has: {there:.400}.")
    return [names.index(word) for word in wanted] or None


def _is_whole(answer: QueryResult) -> bool:
    return answer.exact


def _table(answer: QueryResult, format: Literal["arrow", "json"]) -> Response:
    """Piece by piece, made in threads: neither the memory nor the loop notices how much is asked for."""
    pieces, kind = (arrow_of(answer), ARROW) if format == "arrow" else (json_of(answer), "application/json")
    return StreamingResponse(pieces, media_type=kind, headers={"cache-control": "no-store"})
