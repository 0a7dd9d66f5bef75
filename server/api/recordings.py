"""The library: which recordings there are, and what a person changes about them; files in and out."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Annotated, BinaryIO, TypeVar
from urllib.parse import quote

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import StreamingResponse
from starlette.requests import ClientDisconnect

from recordings import sidecar
from recordings.download import file_name, full_recording, original_bytes
from recordings.library import LibraryEntry, NamingError
from recordings.mcap_writer import RecordingError
from server.api.errors import ApiError, bytes_of, responses
from server.library.api_models import Edit, Mark, Marker, RecordingInfo
from server.library.catalogue import Catalogue
from server.streaming_response import streamed, with_first_chunk

router = APIRouter(prefix="/api/recordings", tags=["recordings"])

MOST_TITLE, MOST_NOTES, MOST_TAGS, MOST_TAG, MOST_TEXT, MOST_MARKERS = 200, 20_000, 50, 60, 2000, 5000
BUFFER = 1 << 20
BYTES = "application/octet-stream"
Changed = TypeVar("Changed")


def catalogue_of(request: Request) -> Catalogue:
    catalogue: Catalogue = request.app.state.library
    return catalogue


TheLibrary = Annotated[Catalogue, Depends(catalogue_of)]


def unknown(recording: str) -> ApiError:
    """There is no such recording."""
    return ApiError(
        404, "not-found", f"There is no recording {recording:.80}.", "It may have been deleted; choose one of the list."
    )


def not_now(recording: str) -> ApiError:
    """It is being recorded."""
    return ApiError(409, "busy", f"{recording:.80} is being recorded.", "Stop the recording first.")


def entry_of(recording: str, library: TheLibrary) -> LibraryEntry:
    """A recording of the list. A route of its own thread: it looks into the folder."""
    try:
        return library.library.get(recording)
    except KeyError:
        raise unknown(recording) from None


OneEntry = Annotated[LibraryEntry, Depends(entry_of)]


@router.get("", responses=responses(422))
async def list_recordings(
    library: TheLibrary,
    q: Annotated[str, Query(max_length=400, description="words that title, tags, notes, devices or markers hold")] = "",
) -> list[RecordingInfo]:
    """Newest first; then those in the bin, which have `deleted`."""
    return await library.all(q)


@router.put(
    "/upload",
    status_code=201,
    responses=responses(400, 411, 413, 415, 422, 507),
    openapi_extra={"requestBody": {"required": True, "content": bytes_of(BYTES)[200]["content"]}},
)
async def upload(
    request: Request, library: TheLibrary, name: Annotated[str, Query(min_length=1, max_length=400)]
) -> RecordingInfo:
    """A file of any kind that can be read. Its body is the bytes of the file."""
    length = int(request.headers.get("content-length", "0"))
    try:
        path = await asyncio.to_thread(library.library.incoming, name)
    except RecordingError as error:
        raise ApiError(507, "disk", error.message, error.hint) from None
    try:
        await _receive(request.stream(), path, length)
        entry = await asyncio.to_thread(library.library.take, path)
    except RecordingError as error:
        words = error.message.replace(path.name, name[:120])  # as its owner calls it
        raise ApiError(422, "cannot-open", words, error.hint) from None
    except ClientDisconnect:
        raise ApiError(400, "cut", "The upload ended before it was whole.", "Send it again.") from None
    except OSError as error:
        words = (error.strerror or "it cannot be written").lower()
        raise ApiError(507, "disk", f"The upload cannot be kept: {words}.", "Free some space.") from None
    finally:
        await asyncio.to_thread(library.library.refuse, path)
    library.changed()
    return library.told(entry)


async def _receive(chunks: AsyncIterator[bytes], path: Path, length: int) -> None:
    """Write what comes, at most `length` bytes."""
    got, held = 0, bytearray()
    with path.open("wb") as file:
        async for chunk in chunks:
            got += len(chunk)
            if got > length:
                raise RecordingError("The upload is longer than it said.", "Send its true Content-Length.")
            held += chunk
            if len(held) >= BUFFER:
                await asyncio.to_thread(file.write, bytes(held))
                held.clear()
        await asyncio.to_thread(file.write, bytes(held))
    if got < length:
        raise RecordingError("The upload ended before it was whole.", "Send it again.")


@router.patch("/{recording}", responses=responses(404, 409, 422, 507))
async def edit_recording(recording: str, body: Edit, library: TheLibrary) -> RecordingInfo:
    """Title, tags, notes, pinned, the file's name; what is null stays. With another name it has another id."""
    _bounded(body.title, MOST_TITLE, "The title")
    _bounded(body.file, MOST_TITLE, "The name")
    _bounded(body.notes, MOST_NOTES, "The notes")
    if len(body.tags or ()) > MOST_TAGS:
        raise ApiError(422, "bad-request", f"At most {MOST_TAGS} tags can be given.", "Notes hold any text.")
    for tag in body.tags or ():
        _bounded(tag, MOST_TAG, "A tag")
    tags = (
        None if body.tags is None else tuple(dict.fromkeys(" ".join(tag.split()) for tag in body.tags if tag.strip()))
    )
    title = None if body.title is None else " ".join(body.title.split())
    edits = sidecar.Edits(title, tags, body.notes, body.pinned)
    entry = await _tried(recording, lambda: library.library.edit(recording, edits))
    name = body.file
    if name is not None:
        if library.is_recording(entry):
            raise not_now(recording)
        entry = await _tried(recording, lambda: library.rename(recording, name))
    library.changed()
    return library.told(entry)


@router.post("/{recording}/markers", status_code=201, responses=responses(404, 409, 422, 507))
async def add_marker(recording: str, body: Mark, library: TheLibrary, entry: OneEntry) -> Marker:
    """A marker or a note, put in later."""
    _bounded(body.text, MOST_TEXT, "The text")
    _bounded(body.device, MOST_TAG, "The device")
    if library.is_recording(entry):
        raise ApiError(409, "busy", "It is being recorded.", "Stop the recording first, or put a marker into it.")
    if body.time is None or not math.isfinite(body.time):
        raise ApiError(422, "bad-request", "A marker needs a time.", "Unix seconds, within the recording.")
    if len(entry.edits.markers) >= MOST_MARKERS:
        raise ApiError(
            422, "bad-request", f"A recording can have {MOST_MARKERS} markers of that kind.", "Notes hold any text."
        )
    marker = sidecar.Marker(body.time, body.kind, body.text, body.device)
    kept = await _tried(recording, lambda: library.library.mark(recording, marker))
    library.changed()
    return Marker(kept.time, body.kind, kept.text, kept.device, kept.id)


@router.delete("/{recording}", responses=responses(404, 409, 422, 507))
async def delete_recording(recording: str, library: TheLibrary, entry: OneEntry) -> RecordingInfo:
    """Into the bin, from where it can be taken back for 7 days."""
    if library.is_recording(entry):
        raise not_now(recording)
    gone = await _tried(recording, lambda: library.library.delete(recording))
    library.changed()
    return library.told(gone)


@router.post("/{recording}/undelete", responses=responses(404, 409, 422, 507))
async def undelete_recording(recording: str, library: TheLibrary) -> RecordingInfo:
    """Back from the bin."""
    entry = await _tried(recording, lambda: library.library.undelete(recording))
    library.changed()
    return library.told(entry)


@router.get(
    "/{recording}/download",
    responses={**bytes_of("application/x-mcap", "text/csv"), **responses(404, 409, 422)},
    response_class=StreamingResponse,
)
async def download(recording: str, library: TheLibrary, entry: OneEntry) -> StreamingResponse:
    """One file with everything in it: bytes, times, events, markers, title, tags, notes (MCAP; of a CSV file CSV)."""
    if library.is_recording(entry):
        raise not_now(recording)
    name = file_name(entry)
    kind = "text/csv" if name.endswith("csv") else "application/x-mcap"
    return await _file(name, kind, lambda out: full_recording(entry, out))


@router.get(
    "/{recording}/original",
    responses={**bytes_of(BYTES), **responses(404, 409, 422)},
    response_class=StreamingResponse,
)
async def download_original(
    library: TheLibrary,
    entry: OneEntry,
    device: Annotated[str, Query(max_length=100, description="where there are several")] = "",
) -> StreamingResponse:
    """The bytes that came from one device, one after the other, as they came."""
    if library.is_recording(entry):
        raise not_now(entry.id)
    devices = [one.id for one in entry.peek.devices]
    if not device and len(devices) > 1:
        hint = f"Say which with ?device=: {', '.join(devices)}."
        raise ApiError(422, "which-device", f"{entry.title:.80} holds {len(devices)} devices.", hint)
    if device and devices and device not in devices:
        raise ApiError(404, "not-found", f"There is no device {device:.40} in it.", f"There are: {', '.join(devices)}.")
    name = f"{entry.path.stem}-{device}" if device else entry.path.stem
    chosen = device or (devices[0] if devices else "")
    return await _file(f"{name}.bin", BYTES, lambda out: original_bytes(entry.path, chosen, out))


async def _file(name: str, kind: str, write: Callable[[BinaryIO], None]) -> StreamingResponse:
    """What is written, as it comes; ApiError where it cannot even begin."""
    plain = "".join(c if c.isascii() and c.isprintable() and c not in '"\\' else "_" for c in name)
    headers = {
        "content-disposition": f"attachment; filename=\"{plain}\"; filename*=UTF-8''{quote(name, safe='')}",
        "cache-control": "no-store",
        "x-content-type-options": "nosniff",
    }
    try:
        pieces = await with_first_chunk(streamed(write))
    except RecordingError as error:
        raise ApiError(422, "cannot-open", error.message, error.hint) from None
    except OSError as error:
        words = f"It cannot be read: {(error.strerror or 'the disk failed').lower()}."
        raise ApiError(422, "cannot-open", words, "Is its file still there?") from None
    return StreamingResponse(pieces, media_type=kind, headers=headers)


def _bounded(text: str | None, most: int, what: str) -> None:
    if text is not None and len(text) > most:
        raise ApiError(
            422, "bad-request", f"{what} has {len(text)} characters; {most} is the most.", "Make it shorter."
        )


async def _tried(recording: str, work: Callable[[], Changed]) -> Changed:
    """Work on the folder in a thread; ApiError where it cannot be done."""
    try:
        return await asyncio.to_thread(work)
    except KeyError:
        raise unknown(recording) from None
    except NamingError as error:
        raise ApiError(409, "name", error.message, error.hint) from None
    except RecordingError as error:
        raise ApiError(507, "disk", error.message, error.hint) from None
