"""Routes of the clocks of an opened recording, and of a live device."""

import asyncio
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from fastapi import Request
from fastapi.responses import Response

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.sidecar import stored_reading
from imuscope.recordings.system.temporary_folder import TemporaryFolder
from imuscope.server.api.dependencies import CLIENT_GONE, TheServices, while_connected
from imuscope.server.api.devices import session_of
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.api.recording_data import OneStore
from imuscope.server.api.recordings import OneEntry
from imuscope.server.devices.link.byte_memory import LinkMemory
from imuscope.server.devices.link.session import Session
from imuscope.server.errors import DomainError
from imuscope.server.extensions.clocks.figures import MessageClocks, clocks_of
from imuscope.server.extensions.clocks.file_readings import FileReadingBody, body_of, is_table
from imuscope.server.extensions.clocks.live_time import BYTES, RESULT, LiveTime, write_memory
from imuscope.server.library.recording_session import about
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services
from imuscope.server.system.workers import Worker

STOP_S = 2.0  # for a worker to end


class LiveClocks:
    """Measures the clocks of live devices."""

    def __init__(self) -> None:
        self._turn = asyncio.Lock()

    async def measure(self, session: Session, memory: LinkMemory) -> bytes:
        """The time of a link over its bytes in memory: a LiveTime as JSON.

        Raises:
            DomainError: no bytes are in memory, or they cannot be decoded.
        """
        info = session.info
        async with self._turn:
            with TemporaryFolder() as folder:
                write = lambda: write_memory(folder / BYTES, memory.runs(), session.access.link.preamble)  # noqa: E731
                if not await asyncio.to_thread(write):
                    raise nothing_stored(info.id)
                request = {
                    "folder": str(folder),
                    "device": info.id,
                    "protocol": info.protocol,
                    "identity": {key: str(value) for key, value in about(info).items()},
                    "options": dict(session.decode_options.values),
                }
                await self._work(request)
                return await asyncio.to_thread((folder / RESULT).read_bytes)

    async def _work(self, request: Mapping[str, object]) -> None:
        worker = await Worker.start("imuscope.server.extensions.clocks.worker")
        try:
            worker.request(request)
            async for _ in worker:  # nothing but a failure is reported
                pass
            if await worker.wait() != 0:
                raise RecordingError("The clocks cannot be measured.", "The log has details.")
        except RecordingError as error:
            raise DomainError("not-now", error.message, error.hint) from None
        finally:
            await worker.end(STOP_S)


def nothing_stored(device: str) -> DomainError:
    """The error for a device without bytes in memory."""
    hint = "They are kept unless bytes_mb is 0 in the configuration."
    return DomainError("not-found", f"No bytes of device {device} are in memory.", hint)


def parts(services: Services) -> Iterator[ServicePart]:
    yield ServicePart("the clocks", LiveClocks())


router = lazy_router()


@dataclass(frozen=True, slots=True)
class FileTime:
    """Time of a recording: its clocks, and which of them is the time axis.

    Args:
        start, end: unix s of the first and the last sample; null without samples.
        sentences: the axis of a file that imuscope did not record, why it is that, and the assumptions.
        sure: "stated" by the file or a user, "known" from the form, "inferred" from the numbers, "assumed"; "" of a
            device's bytes.
        messages: the clocks of each message.
        reading: the choices kept with it, by which its clocks can be chosen; is_chosen: whether there are any.
        is_table: whether the options of tables apply.
    """

    start: float | None
    end: float | None
    sentences: list[str]
    sure: str
    messages: list[MessageClocks]
    reading: FileReadingBody
    is_chosen: bool
    is_table: bool


@router.get("/api/recordings/{recording}/clocks", tags=["recordings"], responses=responses(404, 409, 422))
def list_clocks(store: OneStore, entry: OneEntry) -> FileTime:
    """Every clock of an opened recording: unit, epoch, resolution, drift and jitter against the axis, steps."""
    manifest = store.manifest
    described = manifest.get("time") or {}
    axis = [event["text"] for event in manifest["events"] if event["kind"] == "clock" and event["level"] == "info"]
    return FileTime(
        manifest["started"],
        manifest["ended"],
        list(described.get("sentences") or axis),
        described.get("sure", ""),
        clocks_of(store),
        body_of(reading := stored_reading(entry.path)),
        bool(reading),
        is_table(store),
    )


@router.get("/api/devices/{device}/clocks", tags=["devices"], responses=responses(404, 409, 422))
async def list_live_clocks(device: str, services: TheServices, request: Request) -> LiveTime:
    """Every clock of the link of a live device, over its bytes in memory, and how they arrive."""
    session = session_of(device.partition(".")[0], services)  # a further device of a link shares its bytes
    memory = services.sessions.memory_of(session.info.id)
    if memory is None:
        raise nothing_stored(session.info.id)
    time = await while_connected(request, services.parts.get(LiveClocks).measure(session, memory))
    status = CLIENT_GONE if time is None else 200
    return Response(time, status, media_type="application/json")  # type: ignore[return-value] # a LiveTime as it is sent
