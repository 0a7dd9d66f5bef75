"""Routes of an opened recording: its contents, and any time range of it for the page and for programs.

`GET /api/devices/{device}/query` is the same query on live data.
"""

import asyncio
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Any, Literal

from fastapi import Depends, Query, Request
from fastapi.responses import JSONResponse, Response, StreamingResponse
from pydantic import BaseModel, Field

from imuscope.recordings.columns.health_history import HealthHistory, health_history
from imuscope.recordings.columns.store import Base, ColumnStore
from imuscope.recordings.columns.units import Units
from imuscope.server import wire
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import bytes_of, recording_errors, responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.errors import DomainError
from imuscope.server.library.api_models import OpeningState, RecordedSettings, RecordingDetail
from imuscope.server.library.column_cache import DecodeJob
from imuscope.server.library.range_query import (
    ColumnStatistics,
    QueryResult,
    arrow_of,
    frame_of,
    json_of,
    ordered,
    query_columns,
    recorded,
    statistics_in,
    stored_values,
)
from imuscope.server.library.recorded_settings import settings_of
from imuscope.server.library.recording_detail import channels_of, detail
from imuscope.server.wire.codec import to_json_safe

router = lazy_router(tags=["recordings"])

MAX_WIDTH = 8000
MAX_SECONDS = 7200
MAX_TIME = 9e9  # unix s; in ns, times beyond the year 2255 do not fit an int64
MAX_ROWS = 5_000_000  # in one response without buckets; longer ranges are requested in pieces
SAMPLES = "application/octet-stream"
ARROW = "application/vnd.apache.arrow.stream"


class ChannelTable(BaseModel):
    """One channel as JSON, column by column; a bucket is two rows (min, max)."""

    channel: str
    device: str
    frame: str
    exact: bool = Field(description="true: every row; false: summarised in buckets")
    units: dict[str, str] = Field(description="for the columns that have a unit")
    columns: dict[str, list[Any]] = Field(description="NaN is null; integers that JavaScript cannot represent are text")


TABLE: dict[int | str, dict[str, Any]] = {
    200: {"model": ChannelTable, **bytes_of(ARROW)[200]},
    **responses(404, 422),
}

Time = Annotated[float | None, Query(description="unix seconds")]
Width = Annotated[int, Query(ge=0, le=MAX_WIDTH, description="buckets wanted; 0 for every row")]
Format = Annotated[Literal["arrow", "json"], Query(alias="format")]
Partial = Annotated[bool, Query(description="while it is decoded for the first time: use the part decoded so far")]


async def columns_of(recording: str, services: TheServices) -> ColumnStore:
    """The columns of a recording; waits until it is decoded."""
    with recording_errors(recording):
        return await services.columns.opened(recording)


async def decoded_columns(recording: str, services: TheServices, partial: Partial = False) -> ColumnStore:
    """The columns of a recording; with `partial`, the part decoded so far."""
    if not partial:
        return await columns_of(recording, services)
    with recording_errors(recording):
        return await services.columns.partial_or_wait(recording)


OneStore = Annotated[ColumnStore, Depends(columns_of)]
SoFar = Annotated[ColumnStore, Depends(decoded_columns)]


@router.get(
    "/api/recordings/{recording}",
    responses={200: {"model": RecordingDetail}, 202: {"model": OpeningState}, **responses(404, 422)},
)
async def get_recording(recording: str, request: Request, services: TheServices, partial: Partial = False) -> Response:
    """Details of a recording without its samples (RecordingDetail). 202 with an OpeningState while it is decoded for
    the first time; with `partial`, the RecordingDetail of the part decoded so far, with `progress` below 1.
    """
    with recording_errors(recording):
        columns = services.columns.open(recording)
    if isinstance(columns, DecodeJob):
        if columns.error is not None:
            raise DomainError("cannot-open", columns.error.message, columns.error.hint)
        if not partial or columns.partial is None:
            state = OpeningState(recording, columns.progress, "Decoding the recording for the first time.")
            return JSONResponse(asdict(state), 202, headers={"cache-control": "no-store"})
    store = columns if isinstance(columns, ColumnStore) else columns.partial
    assert store is not None
    catalogue = services.catalogue
    with recording_errors(recording):
        await catalogue.entry(recording)
    body = await asyncio.to_thread(lambda: detail(catalogue.info(recording), store, catalogue.markers(recording)))
    return JSONResponse(to_json_safe(body), headers={"cache-control": "no-store"})


@router.get(
    "/api/recordings/{recording}/window",
    responses={**bytes_of(SAMPLES), **responses(404, 422)},
    response_class=Response,
)
def get_window(  # not async, so in a thread: it may read from the disk, and live devices must not wait
    store: SoFar,
    t0: float,
    t1: float,
    width: Annotated[int, Query(ge=1, le=MAX_WIDTH)] = 1000,
    base: Base = "device",
    channels: Annotated[str, Query(description="ids, separated by commas; empty for all")] = "",
) -> Response:
    """Sample frames of the wire; a bucket is two rows (min, max). `X-Exact: 1` when no channel is summarised."""
    t0, t1 = _span(t0, t1)
    infos = channels_of(store)
    numbers = [_number(word, infos) for word in channels.split(",") if word] or list(infos)
    answers = [recorded(store, infos[number], t0, t1, width, base=base) for number in numbers]
    exact = "1" if all(answer.exact for answer in answers) else "0"
    body = b"".join(frame_of(answer) for answer in answers)
    return Response(body, media_type=SAMPLES, headers={"x-exact": exact, "cache-control": "no-store"})


@router.get("/api/recordings/{recording}/statistics", responses=responses(404, 422))
def get_statistics(  # in a thread, like the window
    store: SoFar,
    t0: float,
    t1: float,
    base: Base = "device",
    channels: Annotated[str, Query(description="ids, separated by commas; empty for all")] = "",
) -> dict[int, list[ColumnStatistics]]:
    """Count, mean, σ, min and max of every column of channels over a time range of any length, by channel."""
    t0, t1 = _span(t0, t1)
    infos = channels_of(store)
    numbers = [_number(word, infos) for word in channels.split(",") if word] or list(infos)
    return {number: statistics_in(store, infos[number], t0, t1, base=base) for number in numbers}


@router.get("/api/recordings/{recording}/health", responses=responses(404, 422))
def get_health_history(
    store: SoFar,
    device: str,
    t0: Annotated[float, Query(description="unix seconds")],
    t1: Annotated[float, Query(description="unix seconds")],
) -> HealthHistory:
    """Per-second figures of a device: bytes, samples of each message, arrival delay, clock."""
    t0, t1 = _span(t0, t1)
    known = {body["id"]: body.get("parent", "") for body in store.manifest["devices"]}
    if device not in known:
        there = ", ".join(known)
        raise DomainError("not-found", f"The recording has no device {device:.40}.", f"It has: {there:.400}.")
    if t1 - t0 > MAX_SECONDS:
        raise DomainError(
            "too-many", f"At most {MAX_SECONDS} seconds can be requested at once.", "Request a shorter range."
        )
    names = store.manifest.get("health") or store.manifest.get("fared", {})  # "fared": older stores
    return health_history(store.folder, names, device, known[device] or device, math.floor(t0), math.floor(t1))


@router.get("/api/recordings/{recording}/settings", responses=responses(404, 422))
def get_settings(store: SoFar, device: Annotated[str, Query(description="id of a device in it")]) -> RecordedSettings:
    """Settings of a device at the time of recording, worded as in Configure; empty if none were recorded."""
    return settings_of(store.manifest["snapshots"].get(device, {}))


@router.get("/api/recordings/{recording}/query", responses=TABLE, response_class=Response)
def query_recording(
    store: OneStore,
    request: Request,
    channel: Annotated[str, Query(description="id or name")],
    t0: Time = None,
    t1: Time = None,
    width: Width = 0,
    columns: Annotated[str, Query(description="names, separated by commas; empty for all")] = "",
    base: Base = "device",
    answer_format: Format = "arrow",
    device: Annotated[str, Query(description="needed if several devices have a channel of that name")] = "",
    units: Annotated[Units, Query(description="of the page, SI, or as the device sent them")] = "shown",
) -> Response:
    """One channel as a table: Arrow or JSON, every row or summarised in buckets."""
    store = store.in_units(units)
    infos = channels_of(store)
    info = infos[_number(channel, infos, device)]
    whole = store.span(info.id, base) or (0.0, 0.0)
    t0, t1 = _span(whole[0] if t0 is None else t0, whole[1] if t1 is None else t1)
    if not width and store.row_at(info.id, t1, base) - store.row_at(info.id, t0, base) > MAX_ROWS:
        hint = f"Request a shorter range, or give `width`; at most {MAX_ROWS} rows are sent at once."
        raise DomainError("too-many", "The range has too many rows for one response.", hint)
    _only_one(request)
    answer = recorded(store, info, t0, t1, width, columns=_positions(info, columns), base=base)
    return _table(ordered(answer) if base == "device" else answer, answer_format)


@router.get("/api/devices/{device}/query", tags=["devices"], responses=TABLE, response_class=Response)
async def query_device(
    device: str,
    request: Request,
    services: TheServices,
    channel: Annotated[str, Query(description="id or name")],
    t0: Time = None,
    t1: Time = None,
    width: Width = 0,
    columns: Annotated[str, Query(description="names, separated by commas; empty for all")] = "",
    base: Base = "device",
    answer_format: Format = "arrow",
) -> Response:
    """Samples of a live channel in memory, as a table, with the parameters of the query on a recording."""
    telemetry = services.telemetry
    own = telemetry.store.of_device(device)
    if not own:
        raise DomainError(
            "not-found",
            f"Device {device:.40} not found, or without channels.",
            "It may have been removed; choose one of the list.",
        )
    number = _number(channel, own)
    t0, t1 = _span(0.0 if t0 is None else t0, telemetry.bus.now() + 60 if t1 is None else t1)
    positions = _positions(own[number], columns)
    _only_one(request)
    whole = stored_values(telemetry.store.of(number), t0, base)
    answer = await asyncio.to_thread(query_columns, own[number], whole, t0, t1, width, columns=positions, base=base)
    return _table(await asyncio.to_thread(ordered, answer) if base == "device" else answer, answer_format)


def _span(t0: float, t1: float) -> tuple[float, float]:
    if not (abs(t0) < MAX_TIME and abs(t1) < MAX_TIME) or t1 < t0:  # nor NaN
        raise DomainError("bad-span", f"From {t0:g} to {t1:g} is not a valid time range.", "Unix seconds, t0 ≤ t1.")
    return t0, t1


def _number(word: str, infos: Mapping[int, wire.ChannelInfo], device: str = "") -> int:
    """The channel with an id or a name; of several with one name, the newest."""
    if word.isdecimal() and int(word) in infos:
        return int(word)
    named = [number for number, info in infos.items() if info.name == word and device in ("", info.device)]
    if named:
        return max(named)
    there = ", ".join(sorted({info.name for info in infos.values()}))
    raise DomainError("not-found", f"Channel {word:.60} not found.", f"Available: {there:.400}.")


def _only_one(request: Request) -> None:
    if len(request.query_params.getlist("channel")) > 1:
        hint = "Request each in turn, or export several as one table (csv-aligned)."
        raise DomainError("too-many", "Only one channel can be requested at a time.", hint)


def _positions(info: wire.ChannelInfo, words: str) -> list[int] | None:
    names = [column.name for column in info.columns]
    column_names = [word for word in words.split(",") if word]
    for word in column_names:
        if word not in names:
            there = ", ".join(names)
            raise DomainError("not-found", f"{info.name} has no column {word:.60}.", f"It has: {there:.400}.")
    return [names.index(word) for word in column_names] or None


def _table(answer: QueryResult, answer_format: Literal["arrow", "json"]) -> Response:
    """Stream the table in pieces made in threads, so a large answer neither fills the memory nor blocks the loop."""
    pieces, kind = (arrow_of(answer), ARROW) if answer_format == "arrow" else (json_of(answer), "application/json")
    return StreamingResponse(pieces, media_type=kind, headers={"cache-control": "no-store"})
