"""A recording as a source: its devices appear as if they were there, for every browser."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Depends, Request

from recordings.importers import open_file
from recordings.mcap_writer import RecordingError
from recordings.replay import extent
from server import wire
from server.api.devices import AllSessions
from server.api.errors import ApiError, responses
from server.library.api_models import Play
from server.links.capture_file import SPEEDS

router = APIRouter(tags=["recordings"])

HINT_SPEED = f"From {SPEEDS[0]:g} to {SPEEDS[1]:g} times as fast as it was."


def file_of(recording: str, request: Request) -> Path:
    """ApiError where there is no such recording."""
    try:
        path: Path = request.app.state.library.path(recording)
    except KeyError:
        text = f"There is no recording {recording:.80}."
        raise ApiError(404, "not-found", text, "It may have been deleted; choose one of the list.") from None
    return path


def source_of(path: Path, play: Play) -> str:
    """A recording and how it is to be played, as a source.

    Raises:
        ApiError: it cannot be played like that, or not be read.
    """
    if not SPEEDS[0] <= play.speed <= SPEEDS[1]:
        raise ApiError(422, "bad-request", f"A speed of {play.speed:g} is too much or too little.", HINT_SPEED)
    options = [f"speed={play.speed:g}"] if play.speed != 1 else []
    if play.loop:
        options.append("loop=1")
    if play.t0 is not None or play.t1 is not None:
        try:
            span = extent(open_file(path))
        except RecordingError as error:
            raise ApiError(422, "cannot-open", error.message, error.hint) from None
        began = span[0] / 1e9 if span is not None else 0.0
        first = max(0.0, play.t0 - began) if play.t0 is not None else 0.0
        options.append(f"from={first:.9f}")
        if play.t1 is not None:
            if play.t1 - began <= first:
                raise ApiError(422, "bad-span", "The stretch ends before it begins.", "Unix seconds, t0 ≤ t1.")
            options.append(f"to={play.t1 - began:.9f}")
    return f"{path}?{'&'.join(options)}" if options else str(path)


@router.post("/api/recordings/{recording}/play", status_code=201, responses=responses(404, 409, 422))
async def play(body: Play, path: Annotated[Path, Depends(file_of)], sessions: AllSessions) -> list[wire.DeviceInfo]:
    """Play it; each of its devices appears. They end with the file and can be played again, or be removed."""
    source = await asyncio.to_thread(source_of, path, body)
    return [session.info for session in sessions.add_all(source)]
