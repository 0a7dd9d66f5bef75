"""Reading of device settings into the controller and onto disk.

    read_settings   requested settings, or all ──> the controller's values, and why one could not be read
    save_snapshot   values read ──> a snapshot on disk, before anything is written

When a device that was cut off during a write is read, the outcome is known and its rollback record is deleted.
"""

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any

from imuscope.protocols.commands.transactions import Values
from imuscope.server.configuration import settings_procedures
from imuscope.server.configuration.device_controller import DeviceController, JobError, RunningJob
from imuscope.server.configuration.rollback import RollbackStore
from imuscope.server.configuration.snapshots import Snapshot, SnapshotError, Snapshots

FIRST = "First contact"


class SettingsReader:
    """Reads devices.

    Args:
        snapshots: store of the values read.
        rollbacks: rollback records of unfinished changes.
    """

    def __init__(self, snapshots: Snapshots, rollbacks: RollbackStore) -> None:
        self._snapshots = snapshots
        self._rollbacks = rollbacks

    async def read_settings(
        self, running: RunningJob, names: Sequence[str] | None
    ) -> settings_procedures.SettingsSnapshot:
        controller = running.controller
        driver, known = controller.driver, controller.context
        body = settings_procedures.read_settings(driver, known, names, running.step)
        snapshot = await controller.run(driver.within(body, known))
        controller.update(snapshot.known, snapshot.values, snapshot.missing)
        if controller.cut_off and set(controller.cut_off) <= set(
            snapshot.values
        ):  # the outcome is known now: no rollback
            record = await asyncio.to_thread(
                self._rollbacks.record_of, controller.member.info.protocol, snapshot.known.serial_number
            )
            if record is not None and record.new == controller.cut_off:  # another device may be at the port by now
                await asyncio.to_thread(self._rollbacks.forget, record)
                controller.cut_off = {}
        return snapshot

    async def save_snapshot(
        self,
        controller: DeviceController,
        settings: settings_procedures.SettingsSnapshot,
        title: str,
        reason: str,
        *,
        pinned: bool = False,
    ) -> str:
        """Save a snapshot of the values read; returns its name."""
        protocol = controller.member.info.protocol
        existing = await asyncio.to_thread(self._snapshots.all, protocol, settings.known.serial_number)
        snapshot = Snapshot(
            protocol=protocol,
            product=settings.known.product,
            serial_number=settings.known.serial_number,
            firmware=settings.known.firmware,
            title=title if existing or pinned else FIRST,
            reason=reason,
            taken=controller.bus.now(),
            pinned=pinned or not existing,
            values=plain_values(settings.values),
            missing=settings.missing,
        )
        try:
            return (await asyncio.to_thread(self._snapshots.save, snapshot, controller.rows)).name
        except SnapshotError as error:
            raise JobError(str(error), f"Nothing was written to the device. {error.hint}") from None


def plain_values(values: Mapping[str, Values]) -> dict[str, dict[str, Any]]:
    """Wire values for JSON and YAML; 64-bit numbers stay numbers."""
    return {name: dict(fields) for name, fields in values.items()}
