"""Routes of exports of recordings: begin, progress, download, cancel."""

import math

from fastapi import Request, Response
from fastapi.responses import FileResponse

from imuscope.server import wire
from imuscope.server.api.dependencies import TheServices, user_of
from imuscope.server.api.errors import bytes_of, check_length, recording_errors, responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.errors import DomainError
from imuscope.server.library.api_models import (
    ExportJobRequest,
    ExportSelection,
    ExportSizes,
    KeepRequest,
    RecordingInfo,
)
from imuscope.server.library.export_jobs import LAST_DATE

router = lazy_router(prefix="/api/recordings", tags=["exports"])

MAX_CHANNELS, MAX_TITLE = 10_000, 200


@router.post("/{recording}/exports", status_code=202, responses=responses(404, 409, 422))
async def add_export(recording: str, body: ExportJobRequest, services: TheServices) -> wire.ExportJob:
    """Begin an export; its progress is sent with the op `exports`."""
    _check(body)
    with recording_errors(recording):
        await services.catalogue.entry(recording)
        return services.exports.add(recording, body)


@router.post("/{recording}/keep", status_code=201, responses=responses(404, 409, 422))
async def keep_range(request: Request, recording: str, body: KeepRequest, services: TheServices) -> RecordingInfo:
    """Make a recording of a range of another one, with its bytes and a note of its origin."""
    check_range(body.t0, body.t1)
    check_length(body.title, MAX_TITLE, "The title")
    if not 0 <= body.t0 < LAST_DATE:
        raise DomainError("bad-span", "The range begins before 1970, or too late.", "Unix seconds, t0 ≤ t1.")
    with recording_errors(recording):
        await services.catalogue.entry(recording)
        entry = await services.exports.keep(recording, body, user_of(request))
    services.catalogue.changed()
    return services.catalogue.to_api(entry)


@router.post("/{recording}/export-sizes", responses=responses(404, 422))
async def measure_exports(recording: str, body: ExportSelection, services: TheServices) -> ExportSizes:
    """Estimated sizes of exports, from writing a sample of each."""
    _check(body)
    with recording_errors(recording):
        return await services.exports.sizes(recording, body)


def _check(body: ExportSelection) -> None:
    """Reject an invalid time range and too many channels."""
    check_range(body.t0, body.t1)
    if len(body.channels or ()) > MAX_CHANNELS:
        raise DomainError("bad-request", f"At most {MAX_CHANNELS} channels can be named.", "null for all.")


def check_range(t0: float | None, t1: float | None) -> None:
    """Reject an invalid time range."""
    for name, value in (("t0", t0), ("t1", t1)):
        check_time(name, value)
    if t0 is not None and t1 is not None and t1 < t0:
        raise DomainError("bad-span", "The range ends before it begins.", "Unix seconds, t0 ≤ t1.")


def check_time(name: str, value: float | None) -> None:
    """Reject a number that is not a time."""
    if value is not None and not math.isfinite(value):
        raise DomainError("bad-span", f"{name} is not a time.", "Unix seconds, or null for all.")


@router.get("/exports")
async def list_exports(services: TheServices) -> list[wire.ExportJob]:
    """Newest first."""
    return services.exports.jobs


@router.get(
    "/exports/{job}/file",
    responses={**bytes_of("application/octet-stream"), **responses(404, 409, 422)},
    response_class=FileResponse,
)
async def fetch_export(job: int, services: TheServices) -> FileResponse:
    """Download the result of an export; several files come as a zip."""
    try:
        path = services.exports.file(job)
    except KeyError:
        raise _unknown_export(job) from None
    return FileResponse(
        path,
        media_type="application/octet-stream",
        filename=path.name,
        headers={"cache-control": "no-store", "x-content-type-options": "nosniff"},
    )


@router.delete("/exports/{job}", status_code=204, responses=responses(404, 422))
async def drop_export(job: int, services: TheServices) -> Response:
    """Cancel an export, or delete it and its file."""
    try:
        await services.exports.drop(job)
    except KeyError:
        raise _unknown_export(job) from None
    return Response(status_code=204)


def _unknown_export(job: int) -> DomainError:
    return DomainError("not-found", f"Export {job} not found.", "It may have expired; begin it again.")
