"""Record: begin, end, drop a marker. What is recorded, and how it goes, is told by the op `recorder` and here."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Request

from recordings.mcap_writer import RecordingError
from server import wire
from server.api.errors import ApiError, responses
from server.error_kinds import status_of
from server.library.api_models import Mark, Start
from server.library.recorder import Recorder, RecorderError

router = APIRouter(tags=["recorder"])

MOST_TEXT = 2000
MOST_TITLE = 200


def recorder_of(request: Request) -> Recorder:
    recorder: Recorder = request.app.state.recorder
    return recorder


TheRecorder = Annotated[Recorder, Depends(recorder_of)]


def _refused(error: RecorderError) -> ApiError:
    return ApiError(status_of(error.kind), error.kind, error.message, error.hint)


def _bounded(text: str, most: int, what: str) -> None:
    if len(text) > most:
        raise ApiError(
            422, "bad-request", f"{what} has {len(text)} characters; {most} is the most.", "Make it shorter."
        )


@router.get("/api/recorder")
async def get_recorder(recorder: TheRecorder) -> wire.RecorderState:
    """What is being recorded."""
    return recorder.state


@router.post("/api/recordings/start", responses=responses(404, 409, 422, 507))
async def start(body: Start, recorder: TheRecorder) -> wire.RecorderState:
    """Record these devices, or all, into a new file."""
    _bounded(body.title, MOST_TITLE, "The title")
    try:
        return await recorder.start(body.devices, body.title)
    except RecorderError as error:
        raise _refused(error) from None
    except RecordingError as error:
        raise ApiError(507, "disk", error.message, error.hint) from None


@router.post("/api/recordings/stop", responses=responses(409, 422))
async def stop(recorder: TheRecorder) -> wire.RecorderState:
    """End the recording; its file is whole when this answers."""
    try:
        return await recorder.stop()
    except RecorderError as error:
        raise _refused(error) from None


@router.post("/api/recordings/mark", responses=responses(409, 422))
async def mark(body: Mark, recorder: TheRecorder) -> wire.RecorderState:
    """Drop a marker or a note into what is being recorded."""
    _bounded(body.text, MOST_TEXT, "The text")
    try:
        return recorder.mark(body)
    except RecorderError as error:
        raise _refused(error) from None
