"""Exports of recordings: begin one, see how far it is, fetch its file, cancel it."""

from __future__ import annotations

import math
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response
from fastapi.responses import FileResponse

from recordings.mcap_writer import RecordingError
from server import wire
from server.api.errors import ApiError, bytes_of, responses
from server.api.recordings import unknown
from server.error_kinds import status_of
from server.library.api_models import Export, ExportPart, ExportSizes
from server.library.export_jobs import Exports, ExportsError

router = APIRouter(prefix="/api/recordings", tags=["exports"])

MOST_CHANNELS = 10_000


def exports_of(request: Request) -> Exports:
    exports: Exports = request.app.state.exports
    return exports


TheExports = Annotated[Exports, Depends(exports_of)]


@router.post("/{recording}/exports", status_code=202, responses=responses(404, 409, 422))
async def add_export(recording: str, body: Export, exports: TheExports) -> wire.ExportJob:
    """Begin an export; the op `exports` tells how it goes."""
    _check(body)
    try:
        return exports.add(recording, body)
    except KeyError:
        raise unknown(recording) from None
    except ExportsError as error:
        raise ApiError(status_of(error.kind), error.kind, error.message, error.hint) from None


@router.post("/{recording}/export-sizes", responses=responses(404, 422))
async def measure_exports(recording: str, body: ExportPart, exports: TheExports) -> ExportSizes:
    """About how large exports would be, found by writing a sample of each."""
    _check(body)
    try:
        return await exports.sizes(recording, body)
    except (KeyError, FileNotFoundError):
        raise unknown(recording) from None
    except RecordingError as error:
        raise ApiError(422, "cannot-open", error.message, error.hint) from None


def _check(body: ExportPart) -> None:
    """Refuse a stretch that is none, and too many channels."""
    for name, value in (("t0", body.t0), ("t1", body.t1)):
        if value is not None and not math.isfinite(value):
            raise ApiError(422, "bad-span", f"{name} is no time.", "Unix seconds, or null for all.")
    if body.t0 is not None and body.t1 is not None and body.t1 < body.t0:
        raise ApiError(422, "bad-span", "The stretch ends before it begins.", "Unix seconds, t0 ≤ t1.")
    if len(body.channels or ()) > MOST_CHANNELS:
        raise ApiError(422, "bad-request", f"At most {MOST_CHANNELS} channels can be named.", "null for all.")


@router.get("/exports")
async def list_exports(exports: TheExports) -> list[wire.ExportJob]:
    """Newest first."""
    return exports.jobs


@router.get(
    "/exports/{job}/file",
    responses={**bytes_of("application/octet-stream"), **responses(404, 409, 422)},
    response_class=FileResponse,
)
async def fetch_export(job: int, exports: TheExports) -> FileResponse:
    """What it made; a zip where it is several files."""
    try:
        path = exports.file(job)
    except KeyError:
        raise _none(job) from None
    except ExportsError as error:
        raise ApiError(status_of(error.kind), error.kind, error.message, error.hint) from None
    return FileResponse(
        path,
        media_type="application/octet-stream",
        filename=path.name,
        headers={"cache-control": "no-store", "x-content-type-options": "nosniff"},
    )


@router.delete("/exports/{job}", status_code=204, responses=responses(404, 422))
async def drop_export(job: int, exports: TheExports) -> Response:
    """Cancel it, or forget it and its file."""
    try:
        await exports.drop(job)
    except KeyError:
        raise _none(job) from None
    return Response(status_code=204)


def _none(job: int) -> ApiError:
    return ApiError(404, "not-found", f"There is no export {job}.", "It may be over; begin it again.")
