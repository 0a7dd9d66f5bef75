"""What can be done to a device? The jobs of a desk: read, apply, run, raw bytes, restore, go back after a restart.

    apply   read everything ─> snapshot on disk ─> what is different ─> write ─> (restart) ─> read back ─> outcomes
                                                          │ could cut the line
                                                          └─> server/configuration/rollback.py

Every job of these ends with the device measuring, also when it fails (Driver.within), unless a person has sent it to
the config state before: it stays there then.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from protocols.schema import Setting
from protocols.transactions import (
    BaudChange,
    DeviceContext,
    DeviceDriver,
    DeviceRejectedError,
    NoReplyError,
    Transaction,
    Values,
    WriteResult,
)
from server.configuration import commanding, cut_off, settings_procedures
from server.configuration.budget import OVER_HINT, overload
from server.configuration.device_controller import DeviceController, JobError, QueuedJob
from server.configuration.reading import SettingsReader
from server.configuration.rollback import RESTORE_HINT, RollbackRecord, RollbackRun, RollbackStore
from server.configuration.snapshots import Snapshots
from server.configuration.transaction_runner import group
from server.configuration.value_format import field_at, title_at, value_at, words
from server.devices.member import address_of, name_of
from server.links.base import LinkError
from server.wire_codec import to_json_safe

MOST_WORDS = 12  # changes that a trial lists
CHANGED_HINT = (
    "Nothing was written. Look at the edits again, which are now based on what the device has, then apply them."
)


@dataclass(frozen=True, slots=True)
class Change:
    """What is written, and to what.

    Args:
        found: what the device has before.
        todo: settings to write, whole or in part.
        held: those of them with values that the device has told once; they are sent unchecked.
        restart: they take effect by a restart.
    """

    found: settings_procedures.SettingsSnapshot
    todo: dict[str, dict[str, Any]]
    held: Collection[str]
    restart: bool


class Jobs:
    """Makes the work of a desk.

    Args:
        trial_s: how long a person has to keep settings on trial.
    """

    def __init__(self, snapshots: Snapshots, trials: RollbackStore, trial_s: float) -> None:
        self._reader = SettingsReader(snapshots, trials)
        self._trials = trials
        self._trial_s = trial_s

    # ── read ─────────────────────────────────────────────────────────────────────────────────────────────────────────

    def read(
        self, desk: DeviceController, names: Sequence[str] | None, reason: str, title: str = "", *, pinned: bool = False
    ) -> Callable[[QueuedJob], Awaitable[None]]:
        """Read settings into a snapshot."""

        async def work(task: QueuedJob) -> None:
            found = await self._reader.survey(desk, task, names)
            name = await self._reader.keep(desk, found, title or "Read from the device", reason, pinned=pinned)
            task.job.snapshot = name
            lacking = f"; {len(found.missing)} could not be read" if found.missing else ""
            task.job.message = f"{len(found.values)} settings read{lacking}."
            desk.log.note(f"{task.job.message[:-1]}, kept as a snapshot.")

        return work

    # ── apply ────────────────────────────────────────────────────────────────────────────────────────────────────────

    def apply(
        self,
        desk: DeviceController,
        changes: Mapping[str, Mapping[str, Any]],
        reason: str,
        base: Mapping[str, Mapping[str, Any]] | None = None,
        held: Collection[str] = (),
    ) -> Callable[[QueuedJob], Awaitable[None]]:
        """Write settings, with a way back.

        Args:
            base: what the device had when the changes were made. Where it has something else by now, nothing is
                written: somebody else's change would be undone without a word.
            held: settings whose values the device has, or had once; they are sent unchecked.
        """

        async def work(task: QueuedJob) -> None:
            found = await self._reader.survey(desk, task, None)
            rows = desk.rows
            unknown = [name for name in changes if name not in rows or not rows[name].write]
            if unknown:
                raise JobError(f"This device has no setting {', '.join(unknown)} that can be written.", "Leave it out.")
            todo = settings_procedures.minimal_changes(desk.driver, rows, found.values, changes)
            if not todo:
                task.job.message = "Nothing to change: the device has these settings already."
                return
            changed = settings_procedures.changed_elsewhere(desk.driver, rows, found.values, base, todo)
            if changed:
                raise JobError(f"{changed} was changed elsewhere since it was last shown.", CHANGED_HINT)
            why = overload(replace(desk.present, values=found.values), todo)
            if why:
                raise JobError(why, f"Nothing was written. {OVER_HINT}")
            titles = ", ".join(rows[name].title or name for name in todo)
            task.job.snapshot = await self._reader.keep(
                desk, found, "Before this change", reason or f"Before writing {titles}."
            )
            restart = any(rows[name].after == "reset" for name in todo)
            await self._write(desk, task, Change(found, todo, held, restart))

        return work

    async def _write(self, desk: DeviceController, task: QueuedJob, change: Change) -> None:
        rows, driver, old = desk.rows, desk.driver, change.found.values
        lines = [driver.line_change(name, old.get(name), new, desk.known) for name, new in change.todo.items()]
        cuts = [line for line in lines if line is not None]
        if cuts:
            record = self._record(desk, change, cuts)
            record.held = [name for name in change.todo if name in change.held]
            for baud in {rate for cut in cuts for rate in (cut.baud, *cut.others) if rate is not None}:
                await desk.session.check_rate(baud)  # also says that a network's far end must be set by hand
            written = await RollbackRun(desk, driver, self._trials, record, task).apply()
        else:
            written = await self._write_in_place(desk, task, change)
        self._report(desk, task, rows, written)

    async def _write_in_place(self, desk: DeviceController, task: QueuedJob, change: Change) -> list[WriteResult]:
        """Write what cannot cut the line. The way back is on disk meanwhile: of a server that is killed the device
        would stay silent, with half of the settings; the next one puts it back (server/configuration/rollback.py)."""
        known = all(change.found.values.get(name) for name in change.todo)
        record = self._record(desk, change, ()) if known else None
        if record is not None:
            await asyncio.to_thread(self._trials.keep, record)
        try:
            written: list[WriteResult] = []
            try:
                written = await desk.run(desk.driver.within(_writing(desk, task, change), desk.known))
                cut = any(one.got is None and not one.refused for one in written)
            except (LinkError, NoReplyError) as error:
                desk.log.note(str(error), fault=True)
                cut = True
            if cut:
                written = await self._cut_off(desk, task, change.todo, written, record)
            if change.restart and not all(one.refused for one in written):
                written = await self._restarted(desk, task, written)
            return written
        finally:
            if record is not None and desk.cut_off != record.new:
                await asyncio.to_thread(self._trials.forget, record)

    async def _cut_off(
        self,
        desk: DeviceController,
        task: QueuedJob,
        todo: dict[str, dict[str, Any]],
        written: Sequence[WriteResult],
        record: RollbackRecord | None,
    ) -> list[WriteResult]:
        """What the device has after it was cut off in the middle.

        Raises:
            JobError: it did not take everything, or did not come back; then the way back stays on disk.
        """
        desk.cut_off = record.new if record is not None else {}
        back = await cut_off.read_back(desk, task, list(todo))
        desk.cut_off = {}
        written = cut_off.merged(todo, written, back)
        task.job.outcomes = settings_procedures.outcomes(desk.driver, desk.rows, written)
        if task.job.outcomes:
            words = cut_off.account(desk, written)
            raise JobError(f"The device stopped answering while it was written. Read back: {words}", cut_off.AGAIN_HINT)
        desk.log.note("The device stopped answering while it was written; read back, it has what was asked.")
        return written

    async def _restarted(
        self, desk: DeviceController, task: QueuedJob, written: list[WriteResult]
    ) -> list[WriteResult]:
        """Restart, and what the device has then."""
        desk.step(task, "The device restarts")
        await desk.run(desk.driver.store_and_restart(desk.known))
        if not await desk.run(desk.driver.alive(desk.known)):
            hint = "Wait a few seconds and read its settings; if it stays silent, switch it off and on."
            raise JobError("The device does not answer after its restart.", hint)
        names = [one.setting for one in written]
        back = await self._reader.survey(
            desk, task, [*names, *settings_procedures.altered(desk.driver, desk.known, names)]
        )
        return [replace(one, got=back.values.get(one.setting)) for one in written]

    def _record(
        self,
        desk: DeviceController,
        change: Change,
        cuts: Sequence[BaudChange],
    ) -> RollbackRecord:
        """A trial as it is kept on disk."""
        rows, found, todo = desk.rows, change.found, change.todo
        lacking = [rows[name].title or name for name in todo if name not in found.values]
        if lacking:
            names = ", ".join(lacking)
            hint = "Read the device's settings again."
            raise JobError(f"{names} could not be read, so there would be no way back.", hint)
        old: dict[str, dict[str, Any]] = {}
        changes: list[str] = []
        for name, new in todo.items():
            row, before = rows[name], to_json_safe(found.values[name])
            told = {one.name for one in row.fields if one.read_only}
            keys = new if row.partial else before
            old[name] = {key: before[key] for key in keys if key in before and key not in told}
            changes += changed_words(row, desk.driver.same(name, old[name], new), old[name], new)
        bauds = [cut.baud for cut in cuts if cut.baud is not None]
        baud = desk.session.baud
        return RollbackRecord(
            source=desk.session.info.source,
            protocol=desk.session.info.protocol,
            product=found.known.product,
            serial_number=found.known.serial_number,
            firmware=found.known.firmware,
            old=old,
            new=to_json_safe(todo),
            old_baud=baud,
            new_baud=bauds[-1] if bauds and baud is not None else baud,
            other_bauds=[] if baud is None else list(dict.fromkeys(rate for cut in cuts for rate in cut.others)),
            restart=change.restart,
            changes=changes[:MOST_WORDS],
            deadline=desk.hub.now() + 60 + self._trial_s,
            seconds=self._trial_s,
            device=name_of(desk.session),
            address=address_of(desk.session),
        )

    def _report(
        self, desk: DeviceController, task: QueuedJob, rows: Mapping[str, Setting], written: Sequence[WriteResult]
    ) -> None:
        """Say what came of it."""
        for one in written:
            if one.got is not None:
                desk.values[one.setting] = {**desk.values.get(one.setting, {}), **one.got}
        job = task.job
        job.outcomes = settings_procedures.outcomes(desk.driver, rows, written)
        refused = [one for one in job.outcomes if not one.path]
        good = len(written) - len(refused)
        job.message = f"{good} of {len(written)} settings written and read back"
        if len(job.outcomes) > len(refused):
            job.message += f"; {len(job.outcomes) - len(refused)} values came out otherwise than asked"
        job.message += "." if not refused else f"; {refused[0].title}: {refused[0].why}."
        for outcome in job.outcomes:
            said = outcome.why or f"asked {outcome.asked or 'nothing'}, the device has {outcome.got or 'nothing'}"
            desk.log.note(f"{outcome.title}: {said}.", fault=not outcome.path)
        if not job.outcomes:
            desk.log.note("Read back: equal to what was asked.")
        titles = ", ".join(rows[one.setting].title or one.setting for one in written)
        data = {"settings": to_json_safe({one.setting: one.asked for one in written}), "snapshot": job.snapshot}
        desk.hub.event(desk.device, "device", "info", f"{titles}: {job.message}", data=data)
        if refused and not good:
            if any(one.got is None and not one.refused for one in written):
                raise JobError("The device could not be read back.", cut_off.AWAY_HINT)
            raise JobError(f"The device refused: {refused[0].why}.", "What was there before is unchanged.")

    # ── the rest ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def run(
        self, desk: DeviceController, command: str, values: Values, *, changes: bool, restarts: bool = False
    ) -> Callable[[QueuedJob], Awaitable[None]]:
        """One command; see server/configuration/commanding.py."""
        return commanding.run(self._reader, desk, command, values, changes=changes, restarts=restarts)

    def raw(self, desk: DeviceController, data: bytes) -> Callable[[QueuedJob], Awaitable[None]]:
        """Bytes as they are."""
        return commanding.raw(desk, data)

    def restore(self, desk: DeviceController) -> Callable[[QueuedJob], Awaitable[None]]:
        """The procedure for a device that answers at no rate; old settings come back where a trial was under way."""

        async def work(task: QueuedJob) -> None:
            driver, known = desk.driver, desk.known
            record = await asyncio.to_thread(self._unfinished, desk, known)
            desk.step(task, "Switch the device off and on now")
            before = desk.session.baud
            if not await _called(desk, driver, known, task):
                await desk.runner.relink(before)
                raise JobError("The device did not answer.", "Was its power switched off and on while this ran?")
            rate = f" at {group(desk.session.baud)} Bd" if desk.session.baud else ""
            task.job.message = f"The device answers again{rate}, with the factory's communication settings."
            if desk.trial is not None and desk.trial.state == "unreachable":
                desk.trial = None
            if record is not None:
                hand = RollbackRun(desk, driver, self._trials, record, task)
                try:
                    back = await hand.put_back(desk.session.baud)
                except (NoReplyError, DeviceRejectedError) as error:
                    raise JobError(f"The device answers{rate}, but: {error}", "Read its settings.") from None
                if not back:
                    raise JobError(f"The device answers{rate}, but has not its old settings.", "Read its settings.")
                task.job.message = "The device answers again and has its old settings."
            await self._refreshed(desk, task)

        return work

    async def _refreshed(self, desk: DeviceController, task: QueuedJob) -> None:
        """All that the device has, once it is found again: of what was read before nothing is certain. What cannot be
        read is marked; that it was found stays true."""
        desk.doubt(list(desk.values), commanding.NOT_SINCE.format(task.job.title))
        try:
            await self._reader.survey(desk, task, None)
        except (NoReplyError, DeviceRejectedError, LinkError) as error:
            desk.log.note(str(error), fault=True)
            task.job.hint = "Its settings could not be read; read them again."

    def _unfinished(self, desk: DeviceController, known: DeviceContext) -> RollbackRecord | None:
        source = desk.session.info.source
        device = name_of(desk.session)
        found = [
            one
            for one in self._trials.all()
            if (one.source, one.device) == (source, device) and one.state == "unreachable"
        ]
        return next((one for one in found if one.serial_number == known.serial_number), found[0] if found else None)

    def resume(self, desk: DeviceController, record: RollbackRecord) -> Callable[[QueuedJob], Awaitable[None]]:
        """A trial that the server before this one did not end: go back."""

        async def work(task: QueuedJob) -> None:
            session = desk.session
            if session.info.protocol != record.protocol:
                await session.read_as(replace(session.reading, protocol=record.protocol))
            hand = RollbackRun(desk, desk.driver, self._trials, record, task)
            if record.state == "unreachable":
                hand.show("unreachable", "The device could not be reached when this server last ran.")
                raise JobError("The device could not be reached when this server last ran.", RESTORE_HINT)
            await hand.go_back("The server was started again in the middle of a trial.")
            task.job.message = "The device has its old settings again."
            await self._refreshed(desk, task)

        return work


def _writing(desk: DeviceController, task: QueuedJob, change: Change) -> Transaction[list[WriteResult]]:
    """Write, and read what changed with it; after a restart that is read then."""

    def tell(words: str) -> None:
        desk.step(task, words)

    written = yield from settings_procedures.write_all(desk.driver, desk.known, change.todo, tell, change.held)
    also = [] if change.restart else settings_procedures.altered(desk.driver, desk.known, change.todo)
    if also and not all(one.refused for one in written):
        found = yield from settings_procedures.read_settings(desk.driver, desk.known, also, tell)
        desk.learn(found.known, found.values, found.missing)
    return written


async def _called(desk: DeviceController, driver: DeviceDriver, known: DeviceContext, task: QueuedJob) -> bool:
    """Call until it answers. The port of a device that its cable powers goes and comes with its power.

    Raises:
        LinkError: the port went, and did not come back in time.
    """
    end = time.monotonic() + cut_off.RETURN_S
    while True:
        try:
            return await desk.run(driver.restore_communication(known))
        except LinkError as gone:
            desk.step(task, "Its port is gone: switch the device on again")
            while not await cut_off.opened(desk):
                if time.monotonic() > end:
                    raise gone from None
                await asyncio.sleep(cut_off.REOPEN_S)


def changed_words(row: Setting, paths: Sequence[str], old: Values, new: Values) -> list[str]:
    """ "Baud rate 115 200 → 921 600 Bd", one for each path."""
    said = []
    for path in paths:
        at = field_at(row.fields, path)
        sides = [value_at(values, path) for values in (old, new)]
        left, right = ("—" if v is None else words(at, v) if at is not None else str(v) for v in sides)
        said.append(f"{title_at(row.fields, path)} {left} → {right}")
    return said
