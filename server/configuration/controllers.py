"""The controllers of all devices, with their shared snapshots, rollbacks and drivers.

A controller is created and closed with its session, so that its log covers the device's whole life; the controller of a
further device on a link is created when that device is first received. When the server starts, changes that the
previous run left unconfirmed are rolled back first.
"""

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from imuscope.protocols.commands.transactions import DeviceDriver
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.jobs import Jobs
from imuscope.server.configuration.put_back import PUT_BACK, PutBackStore
from imuscope.server.configuration.rollback import RollbackRecord, RollbackStore
from imuscope.server.configuration.settings_reader import SettingsReader
from imuscope.server.configuration.snapshots import Snapshots
from imuscope.server.configuration.timings import ConfigurationTimings
from imuscope.server.devices.link.link_member import LinkMember
from imuscope.server.devices.link.session import Session
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.links.base import LinkError
from imuscope.server.streaming.bus import TelemetryBus

log = logging.getLogger("imuscope.controllers")


def driver_of(protocol: str) -> DeviceDriver | None:
    """The driver of a registered protocol; None if it has none."""
    row = PROTOCOLS.get(protocol)
    return row.configuration.driver if row is not None else None


def decode(protocol: str, frame: bytes, member: LinkMember) -> Mapping[str, Any] | None:
    """The first frame of some bytes as plain values; None if there is none."""
    row = PROTOCOLS.get(protocol)
    if row is None:
        return None
    listing = row.frames.listing(**member.link_session.decode_options.settings(row.name))
    listing.feed(frame)
    return next((line for line in listing.drain(stalled=True) if "reject" not in line), None)


class ControllerRegistry:
    """All controllers of the server.

    Args:
        data: the data folder.
        timings: how long a device and its user are waited for.
    """

    def __init__(
        self,
        bus: TelemetryBus,
        sessions: Sessions,
        data: Path,
        timings: ConfigurationTimings,
        *,
        drivers: Callable[[str], DeviceDriver | None] = driver_of,
    ) -> None:
        self._bus = bus
        self._sessions = sessions
        self._drivers = drivers
        self.snapshots = Snapshots(data / "snapshots", self._formerly)
        self.rollbacks = RollbackStore(data / "rollbacks")
        self.put_back = PutBackStore(data / PUT_BACK)
        self._timings = timings
        self.reader = SettingsReader(self.snapshots, self.rollbacks)
        self.jobs = Jobs(self.reader, self.rollbacks, timings)
        self._controllers: dict[str, DeviceController] = {}
        sessions.on_added(self._session_added)

    @property
    def rollback_s(self) -> float:
        """Time to confirm a change that could cut the link, s."""
        return self._timings.rollback_s

    def _formerly(self, protocol: str, serial_number: str) -> Sequence[str]:
        driver = self._drivers(protocol)
        return driver.formerly(serial_number) if driver is not None else ()

    def _session_added(self, session: Session) -> None:
        self._added(LinkMember(session))
        session.devices.created.add(lambda sender: self._added(LinkMember(session, sender)))

    def _added(self, member: LinkMember) -> None:
        device = member.info.id
        controller = self._controllers[device] = DeviceController(
            member,
            self._bus,
            self._drivers,
            decode,
            self._sharing_line,
            timings=self._timings,
            put_back=self.put_back,
        )

        async def removed() -> None:
            self._controllers.pop(device, None)

        member.listeners.before_close(removed)
        controller.notify()

    def on_link_of(self, device: str) -> list[DeviceController]:
        """The controllers of a device and of the devices that share its link."""
        own = device.partition(".")[0]
        controllers = list(self._controllers.items())  # changes are planned in a thread
        return [controller for name, controller in controllers if name.partition(".")[0] == own]

    def _sharing_line(self, device: str) -> list[DeviceController]:
        return [controller for controller in self.on_link_of(device) if controller.device != device]

    def get(self, device: str) -> DeviceController:
        """The controller of a device, by its id or key. KeyError, DomainError: as Sessions.id_of."""
        return self._controllers[device if device in self._controllers else self._sessions.id_of(device)]

    def _controller_at(self, record: RollbackRecord) -> DeviceController:
        """The controller of a device with a pending rollback. Its source is opened if necessary; it may be written
        differently than before, or be open at another baud rate.
        """
        session = self._session_at(record.source)
        if record.address is not None:
            session.devices.expect_reply(record.device, record.address)
        return self._controllers[f"{session.info.id}.{record.device}" if record.device else session.info.id]

    def _session_at(self, source: str) -> Session:
        present = (one.member.link_session for one in self._controllers.values())
        session = next((one for one in present if one.info.source == source), None)
        return session or self._sessions.at(source) or self._sessions.add(source)

    async def resume(self) -> None:
        """Put devices back whose transaction the end of the previous run interrupted, and roll back changes that it
        left unconfirmed.
        """
        for interrupted in await asyncio.to_thread(self.put_back.all):
            try:
                controller = self._controllers[
                    self._session_at(interrupted.source).info.id
                ]  # all on a link have one line
            except LinkError as error:
                log.error("%s was interrupted and cannot be opened: %s", interrupted.source, error)
                continue
            await controller.put_back.resume(interrupted)
        for record in await asyncio.to_thread(self.rollbacks.all):
            try:
                controller = self._controller_at(record)
            except LinkError as error:
                log.error("%s has a pending rollback and cannot be opened: %s", record.source, error)
                continue
            controller.add(
                "Roll back to the previous settings", partial(self.jobs.resume, record=record), stoppable=False
            )
