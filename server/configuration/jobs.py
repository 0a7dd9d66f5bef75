"""Jobs of a device controller: read, apply, run, raw bytes, restore, roll back after a restart.

    apply   read everything ─> snapshot on disk ─> differences ─> write ─> (restart) ─> read back ─> outcomes
                                                       │ could cut the line
                                                       └─> server/configuration/rollback.py

Every job ends with the device measuring, even if it fails (Driver.within), unless the user had set the device to the
config state before; then it stays there.
"""

import asyncio
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from imuscope.protocols.commands.transactions import (
    BaudChange,
    DeviceRejectedError,
    NoReplyError,
    Transaction,
    Values,
    WriteResult,
)
from imuscope.protocols.schema.fields import Setting
from imuscope.server.configuration import recovery, run_command, settings_procedures
from imuscope.server.configuration.budget import overload_error
from imuscope.server.configuration.device_controller import (
    UNANSWERED_HINT,
    DeviceController,
    JobError,
    RunningJob,
)
from imuscope.server.configuration.rollback import RESTORE_HINT, RollbackRecord, RollbackRun, RollbackStore
from imuscope.server.configuration.sensor_check import check_sensor
from imuscope.server.configuration.settings_diff import ComparedValues, compare
from imuscope.server.configuration.settings_reader import SettingsReader
from imuscope.server.configuration.timings import ConfigurationTimings
from imuscope.server.configuration.transaction_runner import group
from imuscope.server.configuration.value_format import head_of
from imuscope.server.links.base import LinkError
from imuscope.server.wire.codec import to_json_safe

MAX_WORDS = 12  # changes that a pending rollback lists
CHANGED_HINT = (
    "Nothing was written. Check the edits, which are now based on the present values of the device, then apply them."
)


@dataclass(frozen=True, slots=True)
class Change:
    """Values to write, and their target.

    Args:
        found: values of the device before.
        todo: settings to write, complete or in part.
        held: those of them with values that the device reported earlier; they are sent unchecked.
        restart: they take effect after a restart.
        confirm_s: the change is temporary until it is confirmed within this time, s.
    """

    snapshot: settings_procedures.SettingsSnapshot
    todo: dict[str, dict[str, Any]]
    held: Collection[str]
    restart: bool
    confirm_s: float | None = None


class Jobs:
    """The work of jobs.

    Args:
        timings: how long a device and its user are waited for.
    """

    def __init__(self, reader: SettingsReader, rollbacks: RollbackStore, timings: ConfigurationTimings) -> None:
        self._reader = reader
        self._rollbacks = rollbacks
        self._timings = timings

    # ── read ─────────────────────────────────────────────────────────────────────────────────────────────────────────

    async def read(
        self,
        running: RunningJob,
        names: Sequence[str] | None,
        reason: str,
        title: str = "",
        *,
        pinned: bool = False,
    ) -> None:
        """Read settings into a snapshot."""
        controller = running.controller
        snapshot = await self._reader.read_settings(running, names)
        if not snapshot.values:
            why = next(iter(snapshot.missing.values()), "the device reported none")
            raise JobError(f"No setting could be read: {why}.", UNANSWERED_HINT)
        name = await self._reader.save_snapshot(
            controller, snapshot, title or "Read from the device", reason, pinned=pinned
        )
        running.job.snapshot = name
        lacking = f"; {len(snapshot.missing)} could not be read" if snapshot.missing else ""
        running.job.message = f"{len(snapshot.values)} settings read{lacking}."
        controller.log.add_note(f"{running.job.message[:-1]}, saved as a snapshot.")

    # ── apply ────────────────────────────────────────────────────────────────────────────────────────────────────────

    async def apply(
        self,
        running: RunningJob,
        changes: Mapping[str, Mapping[str, Any]],
        reason: str,
        base: Mapping[str, Mapping[str, Any]] | None = None,
        held: Collection[str] = (),
        confirm_s: float | None = None,
        sensor: str = "",
    ) -> None:
        """Write settings, with a rollback.

        Args:
            base: values of the device when the changes were made. If it has other values by now, nothing is written,
                because another client's change would be undone silently.
            held: settings whose values the device has, or had once; they are sent unchecked.
            confirm_s: any change is temporary until it is confirmed within this time, s; None: only one that could
                cut the link, for the usual time.
            sensor: serial number of the sensor that is meant; another one is not written. "": whichever is there.
        """
        controller = running.controller
        snapshot = await self._reader.read_settings(running, None)
        check_sensor(controller, sensor, snapshot.known)
        rows = controller.rows
        unknown = [name for name in changes if name not in rows or not rows[name].write]
        if unknown:
            raise JobError(f"This device has no writable setting {', '.join(unknown)}.", "Leave it out.")
        todo = settings_procedures.minimal_changes(controller.driver, rows, snapshot.values, changes)
        if not todo:
            running.job.message = "Nothing to change: the device already has these settings."
            return
        changed = settings_procedures.changed_elsewhere(controller.driver, rows, snapshot.values, base, todo)
        if changed:
            raise JobError(f"{changed} was changed by another client since it was last shown.", CHANGED_HINT)
        over = overload_error(replace(controller.present, values=snapshot.values), todo)
        if over is not None:
            raise JobError(over.message, f"Nothing was written. {over.hint}")
        titles = ", ".join(rows[name].title or name for name in todo)
        running.job.snapshot = await self._reader.save_snapshot(
            controller, snapshot, "Before this change", reason or f"Before writing {titles}."
        )
        restart = any(rows[name].after == "reset" for name in todo)
        await self._write(running, Change(snapshot, todo, held, restart, confirm_s))

    async def _write(self, running: RunningJob, change: Change) -> None:
        controller = running.controller
        rows, driver, old = controller.rows, controller.driver, change.snapshot.values
        lines = [driver.line_change(name, old.get(name), new, controller.context) for name, new in change.todo.items()]
        cuts = [line for line in lines if line is not None]
        if cuts or change.confirm_s is not None:
            record = self._record(controller, change, cuts)
            record.held = [name for name in change.todo if name in change.held]
            for baud in {rate for cut in cuts for rate in (cut.baud, *cut.others) if rate is not None}:
                await controller.member.access.link.check_rate(baud)  # also reports a far end that must be set by hand
            written = await RollbackRun(running, self._rollbacks, record, self._timings).apply()
        else:
            written = await self._write_in_place(running, change)
        also = also_changed(controller, old, written)
        self._report(running, rows, written, also)

    async def _write_in_place(self, running: RunningJob, change: Change) -> list[WriteResult]:
        """Write settings that cannot cut the line. The rollback record is on disk during the write: if the server is
        killed, the device would stay silent with half of the settings; the next server run restores it
        (server/configuration/rollback.py).
        """
        controller = running.controller
        known = all(change.snapshot.values.get(name) for name in change.todo)
        record = self._record(controller, change, ()) if known else None
        if record is not None:
            await self._store(record)
        try:
            written: list[WriteResult] = []
            try:
                written = await controller.run(controller.driver.within(_writing(running, change), controller.context))
                cut = any(one.actual is None and not one.refused for one in written)
            except (LinkError, NoReplyError) as error:
                controller.log.add_note(str(error), error=True)
                cut = True
            if cut:
                written = await self._cut_off(running, change.todo, written, record)
            if change.restart and not all(one.refused for one in written):
                written = await self._restarted(running, written)
            return written
        finally:
            if record is not None and controller.cut_off != record.new:
                await asyncio.to_thread(self._rollbacks.forget, record)

    async def _store(self, record: RollbackRecord) -> None:
        """Write a rollback record; a job that is stopped before it is written leaves none."""
        saving = asyncio.ensure_future(asyncio.to_thread(self._rollbacks.save, record))
        try:
            await asyncio.shield(saving)
        except asyncio.CancelledError:
            await asyncio.wait((saving,))  # its thread goes on
            await asyncio.to_thread(self._rollbacks.forget, record)
            raise

    async def _cut_off(
        self,
        running: RunningJob,
        todo: dict[str, dict[str, Any]],
        written: Sequence[WriteResult],
        record: RollbackRecord | None,
    ) -> list[WriteResult]:
        """Values of the device after an interrupted write.

        Raises:
            JobError: the device did not accept everything, or did not return; then the rollback record stays on disk.
        """
        controller = running.controller
        controller.cut_off = record.new if record is not None else {}
        back = await recovery.read_back(running, list(todo), self._timings)
        controller.cut_off = {}
        written = recovery.merged(todo, written, back)
        running.job.outcomes = settings_procedures.outcomes(controller.driver, controller.rows, written)
        if running.job.outcomes:
            words = recovery.summary(controller, written)
            raise JobError(
                f"The device stopped answering while it was written. Read back: {words}", recovery.AGAIN_HINT
            )
        controller.log.add_note(
            "The device stopped answering while it was written; read back, it has the requested values."
        )
        return written

    async def _restarted(self, running: RunningJob, written: list[WriteResult]) -> list[WriteResult]:
        """Restart the device and read the written settings back."""
        controller = running.controller
        running.step("The device restarts")
        controller.restarts(running.job.title)
        again: Sequence[bytes] = ()
        try:
            again = await controller.run(controller.driver.store_and_restart(controller.context))
        except NoReplyError as error:  # a lost answer to a reset is normal
            controller.log.add_note(str(error))
        if not await run_command.answers(controller, self._timings.rounds):
            hint = "Wait a few seconds and read its settings; if it stays silent, switch it off and on."
            raise JobError("The device does not answer after its restart.", hint)
        await controller.run(controller.driver.resume(again, controller.context))
        names = [one.setting for one in written]
        snapshot = await self._reader.read_settings(
            running, [*names, *settings_procedures.altered(controller.driver, controller.context, names)]
        )
        return [replace(one, actual=snapshot.values.get(one.setting)) for one in written]

    def _record(
        self,
        controller: DeviceController,
        change: Change,
        cuts: Sequence[BaudChange],
    ) -> RollbackRecord:
        rows, snapshot, todo = controller.rows, change.snapshot, change.todo
        lacking = [rows[name].title or name for name in todo if name not in snapshot.values]
        if lacking:
            names = ", ".join(lacking)
            hint = "Read the device's settings again."
            raise JobError(f"{names} could not be read, so the change could not be rolled back.", hint)
        old: dict[str, dict[str, Any]] = {}
        changes: list[str] = []
        for name, new in todo.items():
            row, before = rows[name], to_json_safe(snapshot.values[name])
            read_only = {one.name for one in row.fields if one.read_only}
            keys = new if row.partial else before
            old[name] = {key: before[key] for key in keys if key in before and key not in read_only}
            changes += settings_procedures.changed_words(
                row, controller.driver.same(name, old[name], new), old[name], new
            )
        bauds = [cut.baud for cut in cuts if cut.baud is not None]
        baud = controller.member.access.baud
        seconds = self._timings.rollback_s if change.confirm_s is None else change.confirm_s
        return RollbackRecord(
            source=controller.member.info.source,
            protocol=controller.member.info.protocol,
            product=snapshot.known.product,
            serial_number=snapshot.known.serial_number,
            firmware=snapshot.known.firmware,
            old=old,
            new=to_json_safe(todo),
            old_baud=baud,
            new_baud=bauds[-1] if bauds and baud is not None else baud,
            other_bauds=[] if baud is None else list(dict.fromkeys(rate for cut in cuts for rate in cut.others)),
            restart=change.restart,
            changes=changes[:MAX_WORDS],
            deadline=controller.bus.now() + 60 + seconds,
            seconds=seconds,
            device=controller.member.name,
            address=controller.member.address,
        )

    def _report(
        self,
        running: RunningJob,
        rows: Mapping[str, Setting],
        written: Sequence[WriteResult],
        also: Sequence[str],
    ) -> None:
        controller = running.controller
        actual = {one.setting: one.actual for one in written if one.actual is not None}
        controller.values = {  # another object, because holders of the earlier values compare
            **controller.values,
            **{name: {**controller.values.get(name, {}), **values} for name, values in actual.items()},
        }
        job = running.job
        job.outcomes = settings_procedures.outcomes(controller.driver, rows, written)
        refused = [one for one in job.outcomes if not one.path]
        good = len(written) - len(refused)
        job.message = f"{good} of {len(written)} settings written and read back"
        if len(job.outcomes) > len(refused):
            job.message += f"; {len(job.outcomes) - len(refused)} values differ from the request"
        job.message += "." if not refused else f"; {refused[0].title}: {refused[0].reason}."
        if also:
            job.message += f" Also changed: {', '.join(also[:MAX_WORDS])}."
        for outcome in job.outcomes:
            texts = (
                outcome.reason
                or f"requested {outcome.requested or 'nothing'}, the device has {outcome.actual or 'nothing'}"
            )
            controller.log.add_note(f"{outcome.title}: {texts}.", error=not outcome.path)
        if not job.outcomes:
            controller.log.add_note("Read back: equal to the request.")
        titles = ", ".join(rows[one.setting].title or one.setting for one in written)
        data = {"settings": to_json_safe({one.setting: one.requested for one in written}), "snapshot": job.snapshot}
        controller.bus.event(controller.device, "device", "info", f"{titles}: {job.message}", data=data)
        if refused:
            if any(one.actual is None and not one.refused for one in written):
                raise JobError(job.message if good else "The device could not be read back.", recovery.AWAY_HINT)
            hint = "The refused settings have their previous values."
            raise JobError(job.message if good else f"The device refused: {refused[0].reason}.", hint)

    # ── other jobs ───────────────────────────────────────────────────────────────────────────────────────────────────

    async def run(
        self,
        running: RunningJob,
        command: str,
        values: Values,
        *,
        changes: bool,
        restarts: bool = False,
        sensor: str = "",
    ) -> None:
        """Run one command; see server/configuration/run_command.py."""
        await run_command.run(
            *(self._reader, self._timings, running, command, values),
            changes=changes,
            restarts=restarts,
            sensor=sensor,
        )

    async def raw(self, running: RunningJob, data: bytes) -> None:
        """Send raw bytes."""
        await run_command.raw(running, data)

    async def restore(self, running: RunningJob) -> None:
        """Restore a device that does not answer at any baud rate; an unfinished rollback is completed."""
        controller = running.controller
        record = await asyncio.to_thread(self._unfinished, controller)
        running.step("Switch the device off and on now")
        before = controller.member.access.baud
        if not await _call_device(running, self._timings):
            await controller.runner.reopen(before)
            raise JobError("The device did not answer.", "Switch its power off and on while this runs.")
        rate = f" at {group(controller.member.access.baud)} Bd" if controller.member.access.baud else ""
        running.job.message = f"The device answers again{rate}, with the factory's communication settings."
        if controller.pending_rollback is not None and controller.pending_rollback.state == "unreachable":
            controller.pending_rollback = None
        if record is not None:
            rollback = RollbackRun(running, self._rollbacks, record, self._timings)
            try:
                wrong = await rollback.put_back(controller.member.access.baud)
            except (NoReplyError, DeviceRejectedError) as error:
                raise JobError(f"The device answers{rate}, but: {error}", "Read its settings.") from None
            if wrong:
                raise JobError(f"The device answered{rate}, but {wrong}.", "Read its settings.")
            running.job.message = "The device answers again and has its old settings."
        await self._refreshed(running)

    async def _refreshed(self, running: RunningJob) -> None:
        """Read all settings of a device that is found again, because values read before are uncertain. Settings that
        cannot be read are marked; the job still succeeds.
        """
        controller = running.controller
        controller.invalidate(list(controller.values), run_command.NOT_SINCE.format(running.job.title))
        try:
            await self._reader.read_settings(running, None)
        except (NoReplyError, DeviceRejectedError, LinkError) as error:
            controller.log.add_note(str(error), error=True)
            running.job.hint = "Its settings could not be read; read them again."

    def _unfinished(self, controller: DeviceController) -> RollbackRecord | None:
        source = controller.member.info.source
        device = controller.member.name
        records = [
            one
            for one in self._rollbacks.all()
            if (one.source, one.device) == (source, device) and one.state == "unreachable"
        ]
        return next(
            (one for one in records if one.serial_number == controller.context.serial_number),
            records[0] if records else None,
        )

    async def resume(self, running: RunningJob, record: RollbackRecord) -> None:
        """Roll back a change that the previous run left unconfirmed."""
        controller = running.controller
        member = controller.member
        if member.info.protocol != record.protocol:
            link = member.link_session
            await link.read_as(replace(link.decode_options, protocol=record.protocol))
        rollback = RollbackRun(running, self._rollbacks, record, self._timings)
        if record.state == "unreachable":
            rollback.show("unreachable", "The device could not be reached when this server last ran.")
            raise JobError("The device could not be reached when this server last ran.", RESTORE_HINT)
        await rollback.go_back("The server was started again while a change was unconfirmed.")
        running.job.message = "The device has its old settings again."
        await self._refreshed(running)


def _writing(running: RunningJob, change: Change) -> Transaction[list[WriteResult]]:
    """Write, and read the settings altered by it, unless a restart follows; then they are read after the restart."""
    controller = running.controller

    written = yield from settings_procedures.write_all(
        controller.driver, controller.context, change.todo, running.step, change.held
    )
    also = [] if change.restart else settings_procedures.altered(controller.driver, controller.context, change.todo)
    if also and not all(one.refused for one in written):
        snapshot = yield from settings_procedures.read_settings(
            controller.driver, controller.context, also, running.step
        )
        controller.update(snapshot.known, snapshot.values, snapshot.missing)
    return written


async def _call_device(running: RunningJob, timings: ConfigurationTimings) -> bool:
    """Call the device until it answers. The port of a bus-powered device disappears and returns with its power.

    Raises:
        LinkError: the port disappeared, and did not return in time.
    """
    controller = running.controller
    end = time.monotonic() + timings.return_s
    while True:
        try:
            await controller.member.access.reopen()  # a port that is gone already is waited for, too
            return await controller.run(controller.driver.restore_communication(controller.context))
        except LinkError:
            if time.monotonic() > end:
                raise
            running.step("Its port is gone: switch the device on again")
            await asyncio.sleep(timings.reopen_s)


def also_changed(controller: DeviceController, old: Mapping[str, Values], written: Sequence[WriteResult]) -> list[str]:
    """Values that changed beside those that were written, as read back: "Sampling period 10 ms → 5 ms"."""
    requested = {one.setting: set(one.requested) for one in written}
    read = {**controller.values, **{one.setting: one.actual for one in written if one.actual is not None}}
    rows = controller.rows
    now = {name: read[name] for name in old if name in read and name in rows and rows[name].write}
    sides = ComparedValues("", {name: old[name] for name in now}), ComparedValues("", now)
    return [
        f"{one.title} {one.left or 'none'} → {one.right or 'none'}"
        for one in compare(controller.driver, controller.context, *sides).rows
        if one.writable and head_of(one.path, old[one.setting])[0] not in requested.get(one.setting, ())
    ]
