"""Measurements of the clocks of live devices, each in a subprocess (worker.py), one at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Mapping

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.system.temporary_folder import TemporaryFolder
from imuscope.server.devices.link.byte_memory import LinkMemory
from imuscope.server.devices.link.session import Session
from imuscope.server.errors import DomainError
from imuscope.server.extensions.clocks.memory_source import BYTES, RESULT, write_memory
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
    """Long-lived objects, for a server with these services."""
    yield ServicePart("the clocks", LiveClocks())
