"""Corrections for a device's receiver: the forwarded stream and its state."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace

from pydantic import BaseModel, Field

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.api.configure import OneController
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.devices import check_path
from imuscope.server.api.errors import responses
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.configuration.api_models import Corrections
from imuscope.server.devices.link.link_member import LinkMember
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.errors import DomainError
from imuscope.server.extensions.corrections.log import LogSink, ignore
from imuscope.server.extensions.corrections.ntrip import CorrectionError
from imuscope.server.extensions.corrections.stream import CorrectionForwarder, file_of
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services


class CorrectionManager:
    """All streams of the server.

    Args:
        sessions: the present devices; a stream ends when its device is removed.
    """

    def __init__(self, sessions: Sessions) -> None:
        self._sessions = sessions
        self._streams: dict[str, CorrectionForwarder] = {}

    def accepts(self, member: LinkMember) -> bool:
        """Whether the device has a receiver that accepts RTCM."""
        info = member.info
        row = PROTOCOLS.get(info.protocol)
        if row is None:
            return False
        return row.configuration.corrections is not None and row.configuration.corrections.takes(
            DeviceContext(product=info.product)
        )

    def state(self, member: LinkMember) -> Corrections:
        """State of forwarding; the source is empty if nothing is forwarded."""
        stream = self._streams.get(member.info.id)
        return stream.state() if stream is not None else Corrections(source="")

    async def begin(self, member: LinkMember, source: str, log_sink: LogSink = ignore) -> None:
        """Forward a stream in place of the previous one.

        Args:
            log_sink: receives entries for the device's log.

        Raises:
            CorrectionError: the source is invalid; the previous stream continues.
        """
        device = member.info.id
        before = self._streams.get(device)
        self._streams[device] = CorrectionForwarder(member, source, lambda: self._exists(device), log_sink)
        over = [] if before is None else [before]
        over += [self._streams.pop(one) for one in list(self._streams) if one != device and not self._exists(one)]
        for stream in over:  # last: another request may come while it closes
            await stream.close()

    def _exists(self, device: str) -> bool:
        return any(info.id == device for info in self._sessions.infos)

    async def end(self, member: LinkMember) -> Corrections:
        """Stop forwarding; returns the final state."""
        stream = self._streams.pop(member.info.id, None)
        if stream is None:
            return Corrections(source="")
        state = stream.state()
        await stream.close()
        return replace(state, running=False, forwarding=False, message="Stopped.", hint="")

    async def close(self) -> None:
        """End all streams."""
        streams, self._streams = self._streams, {}
        for stream in streams.values():
            await stream.close()


def parts(services: Services) -> Iterator[ServicePart]:
    manager = CorrectionManager(services.sessions)
    yield ServicePart("corrections", manager, manager.close, sends=True)


router = lazy_router(prefix="/api/devices/{device}", tags=["corrections"])


class CorrectionsRequest(BaseModel, extra="forbid"):
    """A stream to forward."""

    source: str = Field(
        min_length=1,
        max_length=1000,
        description="RTCM 3 from ntrip://user:password@host:2101/MOUNT, tcp://host:port, or a file: of the library, or "
        "of a folder that source_folders names",
    )


@router.get("/corrections", responses=responses(404, 422))
async def get_corrections(receiver: OneController, services: TheServices) -> Corrections:
    """The stream that is forwarded; an empty source if there is none. The password is never returned."""
    return services.parts.get(CorrectionManager).state(receiver.member)


@router.put("/corrections", responses=responses(400, 404, 409, 422))
async def put_corrections(receiver: OneController, body: CorrectionsRequest, services: TheServices) -> Corrections:
    """Forward this stream in place of the previous one."""
    member = receiver.member
    if not services.parts.get(CorrectionManager).accepts(member):
        title = PROTOCOLS[member.info.protocol].title if member.info.protocol in PROTOCOLS else "This device"
        hints = [
            family.configuration.corrections.hint
            for family in PROTOCOLS.values()
            if family.configuration.corrections is not None
        ]
        hint = f"Devices that accept them: {', '.join(hint for hint in hints if hint)}."
        raise DomainError("no-receiver", f"{title} {member.info.product} does not accept corrections.", hint)
    try:
        file = file_of(body.source)
        if file is not None:
            await asyncio.to_thread(check_path, file, services.source_folders)
        await services.parts.get(CorrectionManager).begin(member, body.source, receiver.log.streamed)
    except CorrectionError as error:
        raise DomainError("bad-source", error.message, error.hint) from None
    return services.parts.get(CorrectionManager).state(member)


@router.delete("/corrections", responses=responses(404, 422))
async def delete_corrections(receiver: OneController, services: TheServices) -> Corrections:
    """Stop forwarding; returns the final counters."""
    return await services.parts.get(CorrectionManager).end(receiver.member)
