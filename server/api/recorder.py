"""Routes of the recorder: start, stop, add a marker, state (also sent with the op `recorder`)."""

from imuscope.recordings.errors import RecordingError
from imuscope.server import wire
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import check_length, responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.errors import DomainError
from imuscope.server.library.api_models import (
    HeldBytes,
    LibraryStorage,
    MarkerRequest,
    SavedMemory,
    SaveMemoryRequest,
    StartRequest,
)

router = lazy_router(tags=["recorder"])

MAX_TEXT = 2000
MAX_TITLE = 200
MAX_SECONDS = 86_400
MAX_TIME = 9e9  # unix s


def _seconds(value: float, what: str) -> None:
    if not 0 <= value <= MAX_SECONDS:
        raise DomainError("bad-request", f"{what} is {value:g} s; allowed: 0 … {MAX_SECONDS} s.", "Choose fewer.")


@router.get("/api/recorder")
async def get_recorder(services: TheServices) -> wire.RecorderState:
    """State of the recorder."""
    return services.recorder.state


@router.post("/api/recordings/start", responses=responses(404, 409, 422, 507))
async def start(body: StartRequest, services: TheServices) -> wire.RecorderState:
    """Record these devices, or all of them, into a new file."""
    check_length(body.title, MAX_TITLE, "The title")
    _seconds(body.before_s, "before_s")
    try:
        return await services.recorder.start(body.devices, body.title, before_s=body.before_s, with_head=body.with_head)
    except RecordingError as error:
        raise DomainError("disk", error.message, error.hint) from None


@router.get("/api/recorder/memory")
async def get_memory(services: TheServices) -> list[HeldBytes]:
    """The bytes of each live link that are in memory, and so can be saved."""
    rows = []
    for session in services.sessions.all:
        device = session.info.id
        link = services.sessions.memory_of(device)
        if link is not None and (span := link.span) is not None:
            rows.append(HeldBytes(device, span[0] / 1e9, span[1] / 1e9, link.nbytes))
    return rows


@router.get("/api/recorder/storage")
async def get_storage(services: TheServices) -> LibraryStorage:
    """Disk space: the share of recordings, free space, and the quota."""
    return await services.catalogue.storage(services.recorder.plan.quota_bytes)


@router.post("/api/recordings/save-memory", responses=responses(404, 422, 507))
async def save_memory(body: SaveMemoryRequest, services: TheServices) -> SavedMemory:
    """Save the last bytes of these devices, or of all, from memory as a recording; answers when it is complete."""
    check_length(body.title, MAX_TITLE, "The title")
    t0 = body.t0
    if body.seconds is not None:
        _seconds(body.seconds, "seconds")
        t0 = services.recorder.now() - body.seconds
    for name, time in (("t0", t0), ("t1", body.t1)):
        if time is not None and not 0 <= time <= MAX_TIME:
            raise DomainError("bad-request", f"{name} is {time:g} s; allowed: 0 … {MAX_TIME:g} s.", "Give unix time.")
    try:
        return await services.recorder.save(body.devices, t0, body.t1, body.title)
    except RecordingError as error:
        raise DomainError("disk", error.message, error.hint) from None


@router.post("/api/recordings/read-headers", responses=responses(409, 422))
async def read_headers(services: TheServices) -> wire.RecorderState:
    """Read the configuration of each MTi that the running recording lacks (`headless`), for an .mtb export. It pauses
    the device for about 90 ms.
    """
    if (recording := services.recorder.current) is None:
        raise DomainError("not-now", "No recording is running.", "Start a recording first.")
    recording.request_headers()
    return services.recorder.state


@router.post("/api/recordings/stop", responses=responses(409, 422))
async def stop(services: TheServices) -> wire.RecorderState:
    """Stop recording; the file is complete when this answers."""
    return await services.recorder.stop()


@router.post("/api/recordings/mark", responses=responses(409, 422))
async def mark(body: MarkerRequest, services: TheServices) -> wire.RecorderState:
    """Add a marker or a note to the running recording."""
    check_length(body.text, MAX_TEXT, "The text")
    return services.recorder.mark(body)
