"""Routes of the library: list, edit and delete recordings; upload and download files."""

import asyncio
import math
from collections.abc import AsyncGenerator, AsyncIterator, Callable
from pathlib import Path
from typing import Annotated, TypeVar
from urllib.parse import quote

from fastapi import Depends, Query, Request
from fastapi.responses import StreamingResponse
from starlette.requests import ClientDisconnect

from imuscope.recordings import sidecar
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.library.entry import LibraryEntry
from imuscope.recordings.library.library import NamingError
from imuscope.recordings.sidecar import MarkerInfo
from imuscope.recordings.system.atomic_write import open_private
from imuscope.server import wire
from imuscope.server.access.auth import content_type
from imuscope.server.api.dependencies import TheServices, user_of, while_connected
from imuscope.server.api.errors import bytes_of, check_length, recording_errors, responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.errors import DomainError
from imuscope.server.library.api_models import EditRequest, MarkerRequest, PlayRequest, RecordingInfo
from imuscope.server.library.foreign_files import ForeignFiles
from imuscope.server.links.capture_file import SPEED_RANGE

router = lazy_router(prefix="/api/recordings", tags=["recordings"])

MAX_TITLE, MAX_NOTES, MAX_TAGS, MAX_TAG, MAX_TEXT, MAX_MARKERS = 200, 20_000, 50, 60, 2000, 5000
BUFFER_BYTES = 1 << 20
BYTES = "application/octet-stream"
Changed = TypeVar("Changed")


def still_recording(recording: str) -> DomainError:
    """Refuse: the recording is still being written."""
    return DomainError("busy", f"{recording:.80} is being recorded.", "Stop the recording first.")


async def entry_of(recording: str, services: TheServices) -> LibraryEntry:
    """A recording of the library."""
    with recording_errors(recording):
        return await services.catalogue.entry(recording)


OneEntry = Annotated[LibraryEntry, Depends(entry_of)]


@router.get("", responses=responses(422))
async def list_recordings(
    services: TheServices,
    q: Annotated[
        str, Query(max_length=400, description="words to find in title, tags, notes, devices or markers")
    ] = "",
) -> list[RecordingInfo]:
    """All recordings, newest first; then those in the bin, which have `deleted`."""
    return await services.catalogue.all(q)


def upload_length(request: Request, services: TheServices) -> int:
    """Bytes of an upload; DomainError: it is not sent as a file, or is too large."""
    length, most = int(request.headers.get("content-length", "0")), round(services.config.upload_gb * 1e9)
    if length and content_type(request.headers) != BYTES:
        raise DomainError(
            "not-a-file", "The upload has the wrong content type.", f"Send it with Content-Type: {BYTES}."
        )
    if length > most:
        hint = "Raise upload_gb in the configuration file, or copy the file into the recordings folder."
        raise DomainError("too-large", f"The upload may have at most {most} bytes.", hint)
    return length


@router.put(
    "/upload",
    status_code=201,
    responses=responses(400, 411, 413, 415, 422, 507),
    openapi_extra={"requestBody": {"required": True, "content": bytes_of(BYTES)[200]["content"]}},
)
async def upload(
    request: Request,
    services: TheServices,
    length: Annotated[int, Depends(upload_length)],
    name: Annotated[str, Query(min_length=1, max_length=400)],
) -> RecordingInfo:
    """Upload a file of any readable format; the body is the file (application/octet-stream)."""
    try:
        path = await asyncio.to_thread(services.catalogue.library.incoming, name)
    except RecordingError as error:
        raise DomainError("disk", error.message, error.hint) from None
    try:
        await _receive(request.stream(), path, length)
        adding = services.catalogue.add_upload(path, user_of(request))
        entry = await while_connected(request, adding)
        if entry is None:
            raise ClientDisconnect
    except RecordingError as error:
        words = error.message.replace(path.name, name[:120])  # the name that the user gave
        raise DomainError("cannot-open", words, error.hint) from None
    except ClientDisconnect:
        raise DomainError("cut", "Upload incomplete.", "Send it again.") from None
    except OSError as error:
        words = (error.strerror or "it cannot be written").lower()
        raise DomainError("disk", f"The upload cannot be stored: {words}.", "Free some space.") from None
    finally:
        await asyncio.to_thread(services.catalogue.library.refuse, path)
    services.catalogue.changed()
    return services.catalogue.to_api(entry)


async def _receive(chunks: AsyncIterator[bytes], path: Path, length: int) -> None:
    """Write the body, at most `length` bytes."""
    got, buffer = 0, bytearray()
    with open_private(path) as file:
        async for chunk in chunks:
            got += len(chunk)
            if got > length:
                raise RecordingError("The upload is longer than its Content-Length.", "Send its true Content-Length.")
            buffer += chunk
            if len(buffer) >= BUFFER_BYTES:
                await asyncio.to_thread(file.write, bytes(buffer))
                buffer.clear()
        await asyncio.to_thread(file.write, bytes(buffer))
    if got < length:
        raise RecordingError("Upload incomplete.", "Send it again.")


@router.patch("/{recording}", responses=responses(404, 409, 412, 422, 507))
async def edit_recording(recording: str, body: EditRequest, services: TheServices, entry: OneEntry) -> RecordingInfo:
    """Change title, tags, notes, pinned or the file's name; null keeps a value. Renaming the file changes the id."""
    check_length(body.title, MAX_TITLE, "The title")
    check_length(body.file, MAX_TITLE, "The name")
    check_length(body.notes, MAX_NOTES, "The notes")
    if len(body.tags or ()) > MAX_TAGS:
        raise DomainError("bad-request", f"At most {MAX_TAGS} tags can be given.", "Notes hold any text.")
    for tag in body.tags or ():
        check_length(tag, MAX_TAG, "A tag")
    tags = (
        None if body.tags is None else tuple(dict.fromkeys(" ".join(tag.split()) for tag in body.tags if tag.strip()))
    )
    title = None if body.title is None else " ".join(body.title.split())
    edits = sidecar.Edits(title, tags, body.notes, body.pinned)
    entry = await _in_thread(recording, lambda: services.catalogue.library.edit(recording, edits, body.notes_before))
    name = body.file
    if name is not None:
        if services.catalogue.is_recording(entry):
            raise still_recording(recording)
        renamed = await _in_thread(recording, lambda: services.catalogue.rename(recording, name))
        entry = await services.catalogue.entry(renamed.id)
    services.catalogue.changed()
    return services.catalogue.to_api(entry)


@router.post("/{recording}/markers", status_code=201, responses=responses(404, 409, 422, 507))
async def add_marker(recording: str, body: MarkerRequest, services: TheServices, entry: OneEntry) -> MarkerInfo:
    """Add a marker or a note to a finished recording."""
    check_length(body.text, MAX_TEXT, "The text")
    check_length(body.device, MAX_TAG, "The device")
    if services.catalogue.is_recording(entry):
        raise DomainError(
            "busy", "The recording is still running.", "Stop the recording first, or put a marker into it."
        )
    if body.time is None or not math.isfinite(body.time):
        raise DomainError("bad-request", "A marker needs a time.", "Unix seconds, within the recording.")
    if len(entry.edits.markers) >= MAX_MARKERS:
        raise DomainError(
            "bad-request", f"A recording can have at most {MAX_MARKERS} added markers.", "Notes hold any text."
        )
    marker = MarkerInfo(body.time, body.kind, body.text, body.device)
    stored: MarkerInfo = await _in_thread(recording, lambda: services.catalogue.library.mark(recording, marker))
    services.catalogue.changed()
    return stored


@router.delete("/{recording}", responses=responses(404, 409, 422, 507))
async def delete_recording(recording: str, services: TheServices, entry: OneEntry) -> RecordingInfo:
    """Move a recording to the bin, from where it can be restored for 7 days."""
    if services.catalogue.is_recording(entry):
        raise still_recording(recording)
    deleted = await _in_thread(recording, lambda: services.catalogue.library.delete(recording))
    services.catalogue.changed()
    return services.catalogue.to_api(deleted)


@router.post("/{recording}/undelete", responses=responses(404, 409, 422, 507))
async def undelete_recording(recording: str, services: TheServices) -> RecordingInfo:
    """Restore a recording from the bin."""
    await services.catalogue.entries()
    entry = await _in_thread(recording, lambda: services.catalogue.library.undelete(recording))
    services.catalogue.changed()
    return services.catalogue.to_api(entry)


@router.get(
    "/{recording}/download",
    responses={**bytes_of("application/x-mcap", "text/csv"), **responses(404, 409, 422)},
    response_class=StreamingResponse,
)
async def download(request: Request, recording: str, services: TheServices, entry: OneEntry) -> StreamingResponse:
    """One file with bytes, times, events, markers, title, tags and notes (MCAP; CSV for a CSV recording)."""
    if services.catalogue.is_recording(entry):
        raise still_recording(recording)
    name = entry.full_name
    kind = "text/csv" if name.endswith("csv") else "application/x-mcap"
    function = "imuscope.recordings.library.download:full_recording"
    details = (entry.title, entry.edits, entry.probe.format)
    return await _file(
        name, kind, services.catalogue.files.pieces(function, entry.path, *details, user=user_of(request))
    )


@router.get(
    "/{recording}/original",
    responses={**bytes_of(BYTES), **responses(404, 409, 422)},
    response_class=StreamingResponse,
)
async def download_original(
    request: Request,
    services: TheServices,
    entry: OneEntry,
    device: Annotated[str, Query(max_length=100, description="needed if the recording has several")] = "",
) -> StreamingResponse:
    """The received bytes of one device, unchanged and in order."""
    if services.catalogue.is_recording(entry):
        raise still_recording(entry.id)
    devices = [one.id for one in entry.probe.devices]
    if not device and len(devices) > 1:
        hint = f"Choose one with ?device=: {', '.join(devices)}."
        raise DomainError("which-device", f"{entry.title:.80} has {len(devices)} devices.", hint)
    if device and devices and device not in devices:
        raise DomainError("not-found", f"The recording has no device {device:.40}.", f"It has: {', '.join(devices)}.")
    name = f"{entry.path.stem}-{device}" if device else entry.path.stem
    chosen = device or (devices[0] if devices else "")
    function = "imuscope.recordings.library.download:original_bytes"
    pieces = services.catalogue.files.pieces(function, entry.path, chosen, user=user_of(request))
    return await _file(f"{name}.bin", BYTES, pieces)


async def _file(name: str, kind: str, written: AsyncIterator[bytes]) -> StreamingResponse:
    """Stream a file while it is written; DomainError if it cannot begin."""
    plain = "".join(c if c.isascii() and c.isprintable() and c not in '"\\' else "_" for c in name)
    headers = {
        "content-disposition": f"attachment; filename=\"{plain}\"; filename*=UTF-8''{quote(name, safe='')}",
        "cache-control": "no-store",
        "x-content-type-options": "nosniff",
    }
    try:
        pieces = await _with_first_chunk(written)
    except RecordingError as error:
        raise DomainError("cannot-open", error.message, error.hint) from None
    except OSError as error:
        words = f"The recording cannot be read: {(error.strerror or 'the disk failed').lower()}."
        raise DomainError("cannot-open", words, "Check that its file still exists.") from None
    return StreamingResponse(pieces, media_type=kind, headers=headers)


async def _with_first_chunk(pieces: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    """The same pieces, after the first has been produced, so that an early failure can become an error response.

    Raises:
        every exception that occurs before the first piece.
    """
    first = await anext(pieces, b"")

    async def chunks() -> AsyncIterator[bytes]:
        try:
            yield first
            async for piece in pieces:
                yield piece
        finally:
            if isinstance(pieces, AsyncGenerator):
                await pieces.aclose()

    return chunks()


async def _in_thread(recording: str, work: Callable[[], Changed]) -> Changed:
    """Run work on the folder in a thread; raises its errors as DomainError."""
    with recording_errors(recording, "disk"):
        try:
            return await asyncio.to_thread(work)
        except sidecar.ChangedError as error:
            raise DomainError("changed", error.message, error.hint) from None
        except NamingError as error:
            raise DomainError("name", error.message, error.hint) from None


HINT_SPEED = f"Use {SPEED_RANGE[0]:g} to {SPEED_RANGE[1]:g} times the original speed."


async def played_source(path: Path, play: PlayRequest, files: ForeignFiles) -> str:
    """Source text of a recording with its playback options.

    Raises:
        DomainError: an option is out of range, or the recording cannot be read.
    """
    if not SPEED_RANGE[0] <= play.speed <= SPEED_RANGE[1]:
        raise DomainError("bad-request", f"Speed {play.speed:g} is out of range.", HINT_SPEED)
    options = [f"speed={play.speed:g}"] if play.speed != 1 else []
    if play.loop:
        options.append("loop=1")
    if play.t0 is not None or play.t1 is not None:
        function = "imuscope.recordings.library.probe:extent_of"
        try:
            span: tuple[int, int] | None = await files.call(function, path, returns=tuple[int, int] | None)
        except RecordingError as error:
            raise DomainError("cannot-open", error.message, error.hint) from None
        began = span[0] / 1e9 if span is not None else 0.0
        first = max(0.0, play.t0 - began) if play.t0 is not None else 0.0
        options.append(f"from={first:.9f}")
        if play.t1 is not None:
            if play.t1 - began <= first:
                raise DomainError("bad-span", "The range ends before it begins.", "Unix seconds, t0 ≤ t1.")
            options.append(f"to={play.t1 - began:.9f}")
    return f"{path}?{'&'.join(options)}" if options else str(path)


@router.post("/{recording}/play", status_code=201, responses=responses(404, 409, 422))
async def play(body: PlayRequest, entry: OneEntry, services: TheServices) -> list[wire.DeviceInfo]:
    """Play a recording. Each of its devices appears, ends with the file, and can be played again or removed."""
    source = await played_source(entry.path, body, services.catalogue.files)
    return [session.info for session in await services.sessions.add_all(source)]
