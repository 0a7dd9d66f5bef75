"""Which device gets which stream of corrections? One each; a device that is removed loses its own."""

from __future__ import annotations

from dataclasses import replace

from protocols.registry import PROTOCOLS
from protocols.transactions import DeviceContext
from server.configuration.api_models import Corrections
from server.configuration.correction_log import LogSink, ignore
from server.configuration.correction_stream import CorrectionForwarder
from server.devices.member import AnyDevice
from server.devices.sessions import Sessions

FORWARDING_COMMAND = "ForwardGnssData"


class CorrectionManager:
    """All streams of the server.

    Args:
        sessions: the devices that there are; a stream whose device is gone ends.
    """

    def __init__(self, sessions: Sessions) -> None:
        self._sessions = sessions
        self._streams: dict[str, CorrectionForwarder] = {}

    def takes(self, session: AnyDevice) -> bool:
        """Has the device a receiver that takes RTCM?"""
        info = session.info
        row = PROTOCOLS.get(info.protocol)
        if row is None or row.driver is None:
            return False
        if info.protocol == "isb":
            return True
        commands = row.driver.commands(DeviceContext(product=info.product))
        return bool(info.product) and any(command.name == FORWARDING_COMMAND for command in commands)

    def state(self, session: AnyDevice) -> Corrections:
        """How it goes; an empty source where nothing is forwarded."""
        stream = self._streams.get(session.info.id)
        return stream.state() if stream is not None else Corrections(source="")

    async def begin(self, session: AnyDevice, source: str, tell: LogSink = ignore) -> None:
        """Forward a stream in place of the one before.

        Args:
            tell: takes down what the device's log says of it.
        Raises:
            CorrectionError: the source is written wrongly; the one before goes on.
        """
        fresh = CorrectionForwarder(session, source, lambda: self._is_there(session), tell)
        await self.end(session)
        self._streams[session.info.id] = fresh

    def _is_there(self, session: AnyDevice) -> bool:
        return any(info.id == session.info.id for info in self._sessions.infos)

    async def end(self, session: AnyDevice) -> Corrections:
        """Stop; the last state, not running."""
        stream = self._streams.pop(session.info.id, None)
        if stream is None:
            return Corrections(source="")
        state = stream.state()
        await stream.close()
        return replace(state, running=False, forwarding=False, message="Stopped.", hint="")

    async def close(self) -> None:
        """End all."""
        for stream in self._streams.values():
            await stream.close()
        self._streams.clear()
