"""The desks of all devices, and what they share: snapshots, trials, protocols' drivers.

A desk is made with its session, so that its log begins with the device, and ends with it; one of a further device on a
link when that is first heard. When the server starts, what the one before it left on trial is taken up first.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from protocols.transactions import DeviceDriver
from server.configuration.device_controller import DeviceController
from server.configuration.jobs import Jobs
from server.configuration.rollback import RollbackRecord, RollbackStore
from server.configuration.snapshots import Snapshots
from server.devices.member import AnyDevice, Member
from server.devices.session import Session
from server.devices.sessions import Sessions
from server.links.base import LinkError
from server.streaming.hub import Hub

log = logging.getLogger("imuscope.desks")


def driver_of(protocol: str) -> DeviceDriver | None:
    """The driver of a protocol of the registry."""
    from protocols.registry import PROTOCOLS

    row = PROTOCOLS.get(protocol)
    return row.driver if row is not None else None


def decode(protocol: str, frame: bytes, session: AnyDevice) -> Mapping[str, Any] | None:
    """The first frame of some bytes as plain values; None where there is none."""
    from protocols.registry import PROTOCOLS

    row = PROTOCOLS.get(protocol)
    if row is None:
        return None
    listing = row.listing(**session.reading.settings(row.settings))
    listing.feed(frame)
    return next((line for line in listing.drain(stalled=True) if "reject" not in line), None)


class ControllerRegistry:
    """All desks of the server.

    Args:
        data: the data folder.
        trial_s: how long a person has to keep settings on trial.
    """

    def __init__(
        self,
        hub: Hub,
        sessions: Sessions,
        data: Path,
        trial_s: float,
        *,
        drivers: Callable[[str], DeviceDriver | None] = driver_of,
    ) -> None:
        self._hub = hub
        self._sessions = sessions
        self._drivers = drivers
        self.snapshots = Snapshots(data / "snapshots", self._formerly)
        self.trials = RollbackStore(data / "trials")
        self.jobs = Jobs(self.snapshots, self.trials, trial_s)
        self._desks: dict[str, DeviceController] = {}
        sessions.on_added(self._added)

    def _formerly(self, protocol: str, serial_number: str) -> Sequence[str]:
        driver = self._drivers(protocol)
        return driver.formerly(serial_number) if driver is not None else ()

    def _added(self, session: AnyDevice) -> None:
        device = session.info.id
        desk = self._desks[device] = DeviceController(session, self._hub, self._drivers, decode, self._beside)

        async def left() -> None:
            self._desks.pop(device, None)

        session.before_close(left)
        desk.tell()
        if isinstance(session, Session):
            session.senders.made.add(lambda sender: self._added(Member(session, sender)))

    def on_link_of(self, device: str) -> list[DeviceController]:
        """The desks of a device and of those that share its link."""
        own = device.partition(".")[0]
        return [desk for name, desk in self._desks.items() if name.partition(".")[0] == own]

    def _beside(self, device: str) -> list[DeviceController]:
        return [desk for desk in self.on_link_of(device) if desk.device != device]

    def get(self, device: str) -> DeviceController:
        """KeyError when there is no such device."""
        return self._desks[device]

    def _desk_at(self, record: RollbackRecord) -> DeviceController:
        """The desk of the device of a trial, whose source is opened where it is not; that may be written otherwise than
        before, or be open at another rate."""
        same = (one.session for one in self._desks.values() if one.session.info.source == record.source)
        session = next((one for one in same if isinstance(one, Session)), None)
        session = session or self._sessions.at(record.source) or self._sessions.add(record.source)
        if record.address is not None:
            session.senders.expect(record.device, record.address)
        return self._desks[f"{session.info.id}.{record.device}" if record.device else session.info.id]

    async def resume(self) -> None:
        """Take up what the server before this one left on trial."""
        for record in await asyncio.to_thread(self.trials.all):
            try:
                desk = self._desk_at(record)
            except LinkError as error:
                log.error("%s is on trial and cannot be opened: %s", record.source, error)
                continue
            desk.add("Go back to the settings before the trial", self.jobs.resume(desk, record), stoppable=False)
