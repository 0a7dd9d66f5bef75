"""Read a device into what its desk knows, and onto disk.

    survey   settings asked for, or all ──> the desk's values, and why one could not be read
    keep     what was found ──> a snapshot on disk, before anything is written

What a device took that was cut off while it was written is known once it is read; its way back is forgotten then.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any

from protocols.transactions import Values
from server.configuration import settings_procedures
from server.configuration.device_controller import DeviceController, JobError, QueuedJob
from server.configuration.rollback import RollbackStore
from server.configuration.snapshots import Snapshot, SnapshotError, Snapshots

FIRST = "First contact"


class SettingsReader:
    """Reads devices.

    Args:
        snapshots: where what was found is kept.
        trials: where the way back of an unfinished change is.
    """

    def __init__(self, snapshots: Snapshots, trials: RollbackStore) -> None:
        self._snapshots = snapshots
        self._trials = trials

    async def survey(
        self, desk: DeviceController, task: QueuedJob, names: Sequence[str] | None
    ) -> settings_procedures.SettingsSnapshot:
        driver, known = desk.driver, desk.known
        body = settings_procedures.read_settings(driver, known, names, lambda words: desk.step(task, words))
        found = await desk.run(driver.within(body, known))
        desk.learn(found.known, found.values, found.missing)
        if desk.cut_off and set(desk.cut_off) <= set(found.values):  # what it took is known now: nothing goes back
            record = await asyncio.to_thread(self._trials.of, desk.session.info.protocol, found.known.serial_number)
            if record is not None and record.new == desk.cut_off:  # another device may be at the port by now
                await asyncio.to_thread(self._trials.forget, record)
                desk.cut_off = {}
        return found

    async def keep(
        self,
        desk: DeviceController,
        found: settings_procedures.SettingsSnapshot,
        title: str,
        reason: str,
        *,
        pinned: bool = False,
    ) -> str:
        """A snapshot of what was found, on disk; its name."""
        protocol = desk.session.info.protocol
        there = await asyncio.to_thread(self._snapshots.all, protocol, found.known.serial_number)
        snapshot = Snapshot(
            protocol=protocol,
            product=found.known.product,
            serial_number=found.known.serial_number,
            firmware=found.known.firmware,
            title=title if there or pinned else FIRST,
            reason=reason,
            taken=desk.hub.now(),
            pinned=pinned or not there,
            values=plain_values(found.values),
            missing=found.missing,
        )
        try:
            return (await asyncio.to_thread(self._snapshots.keep, snapshot, desk.rows)).name
        except SnapshotError as error:
            raise JobError(str(error), f"Nothing was written to the device. {error.hint}") from None


def plain_values(values: Mapping[str, Values]) -> dict[str, dict[str, Any]]:
    """Wire values as JSON and YAML hold them; 64-bit numbers stay numbers."""
    return {name: dict(fields) for name, fields in values.items()}
