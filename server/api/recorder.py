"""Routes of the recorder: start, stop, add a marker, state (also sent with the op `recorder`)."""

from __future__ import annotations

from fastapi import APIRouter

from recordings.mcap_writer import RecordingError
from server import wire
from server.api.dependencies import TheServices
from server.api.errors import responses
from server.errors import DomainError
from server.library.api_models import MarkerRequest, StartRequest

router = APIRouter(tags=["recorder"])

MAX_TEXT = 2000
MAX_TITLE = 200


def _bounded(text: str, most: int, what: str) -> None:
    if len(text) > most:
        raise DomainError(
            "bad-request", f"{what} has {len(text)} characters; the maximum is {most}.", "Make it shorter."
        )


@router.get("/api/recorder")
async def get_recorder(services: TheServices) -> wire.RecorderState:
    """State of the recorder."""
    return services.recorder.state


@router.post("/api/recordings/start", responses=responses(404, 409, 422, 507))
async def start(body: StartRequest, services: TheServices) -> wire.RecorderState:
    """Record these devices, or all of them, into a new file."""
    _bounded(body.title, MAX_TITLE, "The title")
    try:
        return await services.recorder.start(body.devices, body.title)
    except RecordingError as error:
        raise DomainError("disk", error.message, error.hint) from None


@router.post("/api/recordings/stop", responses=responses(409, 422))
async def stop(services: TheServices) -> wire.RecorderState:
    """Stop recording; the file is complete when this answers."""
    return await services.recorder.stop()


@router.post("/api/recordings/mark", responses=responses(409, 422))
async def mark(body: MarkerRequest, services: TheServices) -> wire.RecorderState:
    """Add a marker or a note to the running recording."""
    _bounded(body.text, MAX_TEXT, "The text")
    return services.recorder.mark(body)
