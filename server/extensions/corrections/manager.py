"""Correction streams of all devices, at most one each. The stream of a removed device ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.configuration.api_models import Corrections
from imuscope.server.devices.link.link_member import LinkMember
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.extensions.corrections.log import LogSink, ignore
from imuscope.server.extensions.corrections.stream import CorrectionForwarder
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
    """Long-lived objects, for a server with these services."""
    manager = CorrectionManager(services.sessions)
    yield ServicePart("corrections", manager, manager.close, sends=True)
