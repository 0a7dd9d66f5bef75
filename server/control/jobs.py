"""What can be done to a device? The jobs of a desk: read, apply, run, raw bytes, restore, go back after a restart.

    apply   read everything ─> snapshot on disk ─> what is different ─> write ─> (restart) ─> read back ─> outcomes
                                                          │ could cut the line
                                                          └─> server/control/trials.py

Every job of these ends with the device measuring, also when it fails (Driver.within).
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from protocols.dialogues import Driver, InState, Known, LineChange, RefusedError, SilentError, Values, Written
from protocols.schema import Setting
from server.codec import plain
from server.control import cut_off, errands
from server.control.budget import OVER_HINT, overload
from server.control.desk import Desk, JobError, Task
from server.control.runner import group
from server.control.snapshots import Snapshot, SnapshotError, Snapshots
from server.control.trials import RESTORE_HINT, Hand, Record, Trials
from server.control.values import field_at, title_at, value_at, words
from server.links.base import LinkError

LISTEN_S = 1.0  # for what a device answers to bytes that nobody understands here
MOST_WORDS = 12  # changes that a trial lists
FIRST = "First contact"
CHANGED_HINT = (
    "Nothing was written. Look at the edits again, which are now based on what the device has, then apply them."
)


class Jobs:
    """Makes the work of a desk.

    Args:
        trial_s: how long a person has to keep settings on trial.
    """

    def __init__(self, snapshots: Snapshots, trials: Trials, trial_s: float) -> None:
        self._snapshots = snapshots
        self._trials = trials
        self._trial_s = trial_s

    # ── read ─────────────────────────────────────────────────────────────────────────────────────────────────────────

    def read(
        self, desk: Desk, names: Sequence[str] | None, reason: str, title: str = "", *, pinned: bool = False
    ) -> Callable[[Task], Awaitable[None]]:
        """Read settings into a snapshot."""

        async def work(task: Task) -> None:
            found = await self._survey(desk, task, names)
            name = await self._keep(desk, found, title or "Read from the device", reason, pinned=pinned)
            task.job.snapshot = name
            lacking = f"; {len(found.missing)} could not be read" if found.missing else ""
            task.job.message = f"{len(found.values)} settings read{lacking}."
            desk.log.note(f"{task.job.message[:-1]}, kept as a snapshot.")

        return work

    async def _survey(self, desk: Desk, task: Task, names: Sequence[str] | None) -> errands.Survey:
        driver, known = desk.driver, desk.known
        body = errands.survey(driver, known, names, lambda words: desk.step(task, words))
        found = await desk.run(driver.within(body, known))
        desk.learn(found.known, found.values, found.missing)
        if desk.cut_off and set(desk.cut_off) <= set(found.values):  # what it took is known now: nothing goes back
            desk.cut_off = {}
            record = await asyncio.to_thread(self._trials.of, desk.session.info.protocol, found.known.serial_number)
            if record is not None and record.state == "applying":
                await asyncio.to_thread(self._trials.forget, record)
        return found

    async def _keep(self, desk: Desk, found: errands.Survey, title: str, reason: str, *, pinned: bool = False) -> str:
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

    # ── apply ────────────────────────────────────────────────────────────────────────────────────────────────────────

    def apply(
        self,
        desk: Desk,
        changes: Mapping[str, Mapping[str, Any]],
        reason: str,
        base: Mapping[str, Mapping[str, Any]] | None = None,
        held: Collection[str] = (),
    ) -> Callable[[Task], Awaitable[None]]:
        """Write settings, with a way back.

        Args:
            base: what the device had when the changes were made. Where it has something else by now, nothing is
                written: somebody else's change would be undone without a word.
            held: settings whose values the device has, or had once; they are sent unchecked.
        """

        async def work(task: Task) -> None:
            found = await self._survey(desk, task, None)
            rows = desk.rows
            unknown = [name for name in changes if name not in rows or not rows[name].write]
            if unknown:
                raise JobError(f"This device has no setting {', '.join(unknown)} that can be written.", "Leave it out.")
            todo = errands.wanted(desk.driver, rows, found.values, changes)
            if not todo:
                task.job.message = "Nothing to change: the device has these settings already."
                return
            changed = errands.changed_elsewhere(desk.driver, rows, found.values, base, todo)
            if changed:
                raise JobError(f"{changed} was changed elsewhere since it was last shown.", CHANGED_HINT)
            why = overload(replace(desk.present, values=found.values), todo)
            if why:
                raise JobError(why, f"Nothing was written. {OVER_HINT}")
            titles = ", ".join(rows[name].title or name for name in todo)
            task.job.snapshot = await self._keep(
                desk, found, "Before this change", reason or f"Before writing {titles}."
            )
            await self._write(desk, task, found, todo, held)

        return work

    async def _write(
        self,
        desk: Desk,
        task: Task,
        found: errands.Survey,
        todo: dict[str, dict[str, Any]],
        held: Collection[str],
    ) -> None:
        rows, driver = desk.rows, desk.driver
        lines = [driver.line_change(name, found.values.get(name), new, desk.known) for name, new in todo.items()]
        cuts = [line for line in lines if line is not None]
        restart = any(rows[name].after == "reset" for name in todo)
        if cuts:
            record = self._record(desk, found, todo, cuts, restart=restart)
            record.held = [name for name in todo if name in held]
            for baud in {rate for cut in cuts for rate in (cut.baud, *cut.others) if rate is not None}:
                await desk.session.check_rate(baud)  # also says that a network's far end must be set by hand
            written = await Hand(desk, driver, self._trials, record, task).apply()
        else:
            written = await self._write_in_place(desk, task, found, todo, held, restart=restart)
        self._report(desk, task, rows, written)

    async def _write_in_place(
        self,
        desk: Desk,
        task: Task,
        found: errands.Survey,
        todo: dict[str, dict[str, Any]],
        held: Collection[str],
        *,
        restart: bool,
    ) -> list[Written]:
        """Write what cannot cut the line. The way back is on disk meanwhile: of a server that is killed the device
        would stay silent, with half of the settings; the next one puts it back (server/control/trials.py)."""
        known = all(found.values.get(name) for name in todo)
        record = self._record(desk, found, todo, (), restart=restart) if known else None
        if record is not None:
            await asyncio.to_thread(self._trials.keep, record)
        try:
            written: list[Written] = []
            try:
                body = errands.write_all(desk.driver, desk.known, todo, lambda words: desk.step(task, words), held)
                written = await desk.run(desk.driver.within(body, desk.known))
                cut = any(one.got is None and not one.refused for one in written)
            except (LinkError, SilentError) as error:
                desk.log.note(str(error), fault=True)
                cut = True
            if cut:
                written = await self._cut_off(desk, task, todo, written, record)
            if restart and not all(one.refused for one in written):
                written = await self._restarted(desk, task, written)
            return written
        finally:
            if record is not None and desk.cut_off != record.new:
                await asyncio.to_thread(self._trials.forget, record)

    async def _cut_off(
        self,
        desk: Desk,
        task: Task,
        todo: dict[str, dict[str, Any]],
        written: Sequence[Written],
        record: Record | None,
    ) -> list[Written]:
        """What the device has after it was cut off in the middle.

        Raises:
            JobError: it did not take everything, or did not come back; then the way back stays on disk.
        """
        desk.cut_off = record.new if record is not None else {}
        back = await cut_off.read_back(desk, task, list(todo))
        desk.cut_off = {}
        written = cut_off.merged(todo, written, back)
        task.job.outcomes = errands.outcomes(desk.driver, desk.rows, written)
        if task.job.outcomes:
            words = cut_off.account(desk, written)
            raise JobError(f"The device was cut off while it was written. Read back: {words}", cut_off.AGAIN_HINT)
        desk.log.note("The device was cut off while it was written; read back, it has what was asked.")
        return written

    async def _restarted(self, desk: Desk, task: Task, written: list[Written]) -> list[Written]:
        """Restart, and what the device has then."""
        desk.step(task, "The device restarts")
        await desk.run(desk.driver.store_and_restart(desk.known))
        if not await desk.run(desk.driver.alive(desk.known)):
            hint = "Wait a few seconds and read its settings; if it stays silent, switch it off and on."
            raise JobError("The device does not answer after its restart.", hint)
        names = [one.setting for one in written]
        back = await self._survey(desk, task, names)
        return [replace(one, got=back.values.get(one.setting)) for one in written]

    def _record(
        self,
        desk: Desk,
        found: errands.Survey,
        todo: Mapping[str, dict[str, Any]],
        cuts: Sequence[LineChange],
        *,
        restart: bool,
    ) -> Record:
        """A trial as it is kept on disk."""
        rows = desk.rows
        lacking = [rows[name].title or name for name in todo if name not in found.values]
        if lacking:
            names = ", ".join(lacking)
            hint = "Read the device's settings again."
            raise JobError(f"{names} could not be read, so there would be no way back.", hint)
        old: dict[str, dict[str, Any]] = {}
        changes: list[str] = []
        for name, new in todo.items():
            row, before = rows[name], plain(found.values[name])
            told = {one.name for one in row.fields if one.read_only}
            keys = new if row.partial else before
            old[name] = {key: before[key] for key in keys if key in before and key not in told}
            changes += changed_words(row, desk.driver.same(name, old[name], new), old[name], new)
        bauds = [cut.baud for cut in cuts if cut.baud is not None]
        baud = desk.session.baud
        return Record(
            source=desk.session.info.source,
            protocol=desk.session.info.protocol,
            product=found.known.product,
            serial_number=found.known.serial_number,
            firmware=found.known.firmware,
            old=old,
            new=plain(todo),
            old_baud=baud,
            new_baud=bauds[-1] if bauds and baud is not None else baud,
            other_bauds=[] if baud is None else list(dict.fromkeys(rate for cut in cuts for rate in cut.others)),
            restart=restart,
            changes=changes[:MOST_WORDS],
            deadline=desk.hub.now() + 60 + self._trial_s,
            seconds=self._trial_s,
        )

    def _report(self, desk: Desk, task: Task, rows: Mapping[str, Setting], written: Sequence[Written]) -> None:
        """Say what came of it."""
        for one in written:
            if one.got is not None:
                desk.values[one.setting] = {**desk.values.get(one.setting, {}), **one.got}
        job = task.job
        job.outcomes = errands.outcomes(desk.driver, rows, written)
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
        data = {"settings": plain({one.setting: one.asked for one in written}), "snapshot": job.snapshot}
        desk.hub.event(desk.device, "device", "info", f"{titles}: {job.message}", data=data)
        if refused and not good:
            if any(one.got is None and not one.refused for one in written):
                raise JobError("The device could not be read back.", cut_off.AWAY_HINT)
            raise JobError(f"The device refused: {refused[0].why}.", "What was there before is unchanged.")

    # ── the rest ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def run(
        self, desk: Desk, command: str, values: Values, *, changes: bool, restarts: bool = False
    ) -> Callable[[Task], Awaitable[None]]:
        """One command.

        Args:
            changes: it writes something, so a snapshot is taken first; unless it takes up what an earlier command
                began, which reading everything would discard.
            restarts: the device restarts, and may then speak at a rate that was stored before: the link follows it.
        """

        async def work(task: Task) -> None:
            driver, known = desk.driver, desk.known
            body = driver.run(command, values, known)
            if changes and not (isinstance(body, InState) and body.continues):
                found = await self._survey(desk, task, None)
                task.job.snapshot = await self._keep(desk, found, "Before this change", f"Before {task.job.title}.")
                body = driver.run(command, values, desk.known)
            desk.step(task, command)
            answer = await desk.run(driver.within(body, known))
            if restarts:
                await self._follow(desk, task)
            desk.leave(command, driver.unfinished(command, values))
            task.job.values = plain(answer)
            task.job.message = task.job.message or ("Answered." if answer else "Done.")

        return work

    async def _follow(self, desk: Desk, task: Task) -> None:
        """The link at the rate at which a device speaks after its restart."""
        before = desk.session.baud
        rates = desk.driver.rates(desk.values, desk.known) if before is not None else ()
        for rate in rates:
            if rate != desk.session.baud and not await desk.runner.relink(rate):
                continue
            desk.step(task, f"The device restarts; the link listens at {group(rate)} Bd")
            if await desk.run(desk.driver.alive(desk.known)):
                if rate != before:
                    task.job.message = f"The device speaks at {group(rate)} Bd after its restart; the link follows it."
                return
        if rates:
            await desk.runner.relink(before)
            raise JobError("The device does not answer after its restart.", RESTORE_HINT)

    def raw(self, desk: Desk, data: bytes) -> Callable[[Task], Awaitable[None]]:
        """Bytes as they are; what comes back within a second is in the log."""

        async def work(task: Task) -> None:
            desk.log.sent(data, "")
            await desk.session.send(data)
            await asyncio.sleep(LISTEN_S)
            task.job.message = f"{len(data)} bytes sent as they are."

        return work

    def restore(self, desk: Desk) -> Callable[[Task], Awaitable[None]]:
        """The procedure for a device that answers at no rate; old settings come back where a trial was under way."""

        async def work(task: Task) -> None:
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
                hand = Hand(desk, driver, self._trials, record, task)
                try:
                    back = await hand.put_back(desk.session.baud)
                except (SilentError, RefusedError) as error:
                    raise JobError(f"The device answers{rate}, but: {error}", "Read its settings.") from None
                if not back:
                    raise JobError(f"The device answers{rate}, but has not its old settings.", "Read its settings.")
                task.job.message = "The device answers again and has its old settings."

        return work

    def _unfinished(self, desk: Desk, known: Known) -> Record | None:
        source = desk.session.info.source
        found = [one for one in self._trials.all() if one.source == source and one.state == "unreachable"]
        return next((one for one in found if one.serial_number == known.serial_number), found[0] if found else None)

    def resume(self, desk: Desk, record: Record) -> Callable[[Task], Awaitable[None]]:
        """A trial that the server before this one did not end: go back."""

        async def work(task: Task) -> None:
            session = desk.session
            if session.info.protocol != record.protocol:
                await session.read_as(replace(session.reading, protocol=record.protocol))
            hand = Hand(desk, desk.driver, self._trials, record, task)
            if record.state == "unreachable":
                hand.show("unreachable", "The device could not be reached when this server last ran.")
                raise JobError("The device could not be reached when this server last ran.", RESTORE_HINT)
            await hand.go_back("The server was started again in the middle of a trial.")
            task.job.message = "The device has its old settings again."

        return work


async def _called(desk: Desk, driver: Driver, known: Known, task: Task) -> bool:
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


def plain_values(values: Mapping[str, Values]) -> dict[str, dict[str, Any]]:
    """Wire values as JSON and YAML hold them; 64-bit numbers stay numbers."""
    return {name: dict(fields) for name, fields in values.items()}
