"""Route that plays a recording as a source: its devices appear like live ones, in every browser."""

from __future__ import annotations

from pathlib import Path

from imuscope.recordings.errors import RecordingError
from imuscope.server import wire
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.api.recordings import OneEntry
from imuscope.server.errors import DomainError
from imuscope.server.library.api_models import PlayRequest
from imuscope.server.library.foreign_files import ForeignFiles
from imuscope.server.links.capture_file import SPEEDS

router = lazy_router(tags=["recordings"])

HINT_SPEED = f"Use {SPEEDS[0]:g} to {SPEEDS[1]:g} times the original speed."


async def source_of(path: Path, play: PlayRequest, files: ForeignFiles) -> str:
    """Source text of a recording with its playback options.

    Raises:
        DomainError: an option is out of range, or the recording cannot be read.
    """
    if not SPEEDS[0] <= play.speed <= SPEEDS[1]:
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


@router.post("/api/recordings/{recording}/play", status_code=201, responses=responses(404, 409, 422))
async def play(body: PlayRequest, entry: OneEntry, services: TheServices) -> list[wire.DeviceInfo]:
    """Play a recording. Each of its devices appears, ends with the file, and can be played again or removed."""
    source = await source_of(entry.path, body, services.catalogue.files)
    return [session.info for session in await services.sessions.add_all(source)]
