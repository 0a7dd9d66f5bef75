"""Automatic rollback of changes that could cut the link ("commit confirmed").

    on disk: old and new settings, rates, deadline       forced to disk before the first byte of the change is sent
    write ─> restart ─> link at the new rate ─> does it answer, with the new settings?
                                    │ yes                              │ no
                             "Keep these settings?"             link at new, old, new, old … rate
                          20 s │ confirmed │ no answer, or "roll back" │ answers at one
                               v           └──────────┬────────────────┘                       │ at none
                           confirmed         write old, restart, link at old rate, read back    v
                                                      v                              unreachable until
                                                 rolled back                         its power is cycled

The server does this without any browser: one that lost its connection cannot confirm. A server that was killed in the
middle finds the file when it starts again and rolls back first. Before old settings are written the device is
identified; a different device at the port is left unchanged.

The file stays while the device is unreachable; the procedure that restores communication (server/configuration/jobs.py)
also ends with the old settings.
"""

import asyncio
import json
import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from imuscope.protocols.commands.transactions import (
    DeviceContext,
    DeviceRejectedError,
    NoReplyError,
    Values,
    WriteResult,
)
from imuscope.recordings.errors import check_format_version
from imuscope.recordings.system import atomic_write
from imuscope.recordings.system.regular_file import read_regular
from imuscope.server.configuration import settings_procedures
from imuscope.server.configuration.device_controller import JobError, RunningJob
from imuscope.server.configuration.sensor_check import is_same
from imuscope.server.configuration.timings import ConfigurationTimings
from imuscope.server.configuration.transaction_runner import group
from imuscope.server.links.base import LinkError
from imuscope.server.wire import PendingRollback

log = logging.getLogger("imuscope.rollbacks")

FORMAT = 1  # of the file
UNREACHABLE = (
    "The device answers neither at the new rate nor at the old one: it is unreachable until its power is cycled."
)
SLOWER = "Request less data, or a baud rate that its cable can carry."
NOT_ACCEPTED = "The device answers, but did not accept its old settings."
NOT_ACCEPTED_HINT = "Read its settings; the snapshot taken before the change has the old ones."
BROKEN = "An internal error of imuscope interrupted the rollback; the device may still have the new settings."
RESTORE_HINT = "Start “Restore communication”, then switch the device off and on while it runs."


@dataclass(slots=True)
class RollbackRecord:
    """The rollback record on disk.

    Args:
        old, new: the settings concerned, by name.
        old_baud, new_baud: None if the rate stays or the link has none.
        other_bauds: other possible rates of the device, if it is not known which of its ports is connected.
        restart: the change takes effect after a restart.
        device: on a shared link, its id in the stream; "" for the first.
        address: its address there; None if it has none.
        deadline: unix seconds of the automatic rollback; later than any step still in progress.
    """

    source: str
    protocol: str
    product: str
    serial_number: str
    firmware: str
    old: dict[str, dict[str, Any]]
    new: dict[str, dict[str, Any]]
    old_baud: int | None
    new_baud: int | None
    restart: bool
    changes: list[str] = field(default_factory=list)
    state: Literal["applying", "pending", "rolling-back", "unreachable"] = "applying"
    deadline: float = 0.0
    seconds: float = 20.0
    other_bauds: list[int] = field(default_factory=list)
    held: list[str] = field(default_factory=list)  # new settings with values that the device had before; sent unchecked
    device: str = ""
    address: int | None = None

    @property
    def known(self) -> DeviceContext:
        device = "" if self.address is None else str(self.address)
        return DeviceContext(self.product, self.serial_number, self.firmware, device=device)


class RollbackStore:
    """The folder of pending rollbacks: <data>/rollbacks. Reads and writes files; do not use it on the event loop."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def save(self, record: RollbackRecord) -> None:
        """Write a record durably.

        Raises:
            JobError: it cannot be written, so the change must not begin.
        """
        try:
            atomic_write.write_atomic(
                self._path(record), json.dumps({"imuscope": FORMAT, **asdict(record)}, indent=1) + "\n"
            )
        except OSError as error:
            hint = f"Nothing was sent. Check free space and write permission of {self._folder}."
            raise JobError(f"The rollback record could not be saved: {error.strerror}.", hint) from None

    def forget(self, record: RollbackRecord) -> None:
        """Delete a record."""
        try:
            atomic_write.remove(self._path(record))
        except OSError as error:
            log.error("%s could not be removed: %s", self._path(record), error)

    def all(self) -> list[RollbackRecord]:
        """Rollback records that the previous run left. A file that cannot be read is logged, and stays."""
        records = []
        paths = sorted(self._folder.glob("*.json")) if self._folder.is_dir() else []
        for path in paths:
            try:
                body = json.loads(read_regular(path))
                if why := check_format_version(path.name, body.pop("imuscope", FORMAT), FORMAT):
                    log.error("%s %s", why.message, why.hint)
                    continue
                records.append(RollbackRecord(**body))
            except (OSError, KeyError, ValueError, TypeError, AttributeError, RecursionError) as error:
                log.error("%s cannot be read: %s", path, error)
        return records

    def record_of(self, protocol: str, serial_number: str) -> RollbackRecord | None:
        return next((one for one in self.all() if (one.protocol, one.serial_number) == (protocol, serial_number)), None)

    def _path(self, record: RollbackRecord) -> Path:
        name = re.sub(r"[^A-Za-z0-9-]+", "-", f"{record.protocol}-{record.serial_number or record.source}")
        return self._folder / f"{name[:120]}.json"


class RollbackRun:
    """Execution of one temporary change.

    Args:
        running: the job it belongs to.
    """

    def __init__(
        self,
        running: RunningJob,
        rollbacks: RollbackStore,
        record: RollbackRecord,
        timings: ConfigurationTimings,
    ) -> None:
        self._running = running
        self._controller = running.controller
        self._driver = running.controller.driver
        self._rollbacks = rollbacks
        self.record = record
        self._timings = timings
        self._to_resume: Sequence[bytes] = ()  # what ran before a restart, until it runs again

    # ── change ───────────────────────────────────────────────────────────────────────────────────────────────────────

    async def apply(self) -> list[WriteResult]:
        """Write, check that the device answers, wait for confirmation, and keep or roll back.

        Returns:
            The written values.

        Raises:
            JobError: the change was rolled back, or the device is unreachable.
        """
        self._running.stoppable = False
        await self._report("applying", "The change is being made.")
        try:
            written = await self._write()
            if all(one.refused for one in written):
                await self._end("rolled-back", "The device refused the change; nothing is different.")
                return written
            back = await self._read_new_settings()
            lost = [one for one in written if one.actual is None and not one.refused]
            if back is not None and any(
                self._driver.same(one.setting, one.requested, back[one.setting]) for one in lost
            ):
                back = None  # it answers, but not every setting was written
        except (NoReplyError, DeviceRejectedError, LinkError) as error:
            self._controller.log.add_note(str(error), error=True)
            back = None
        except JobError:
            raise  # another device is at the port: do not write to it
        except Exception:  # whatever the error, the device must not be left half changed
            log.exception("a temporary change could not be carried out")
            await self.go_back("An internal error of imuscope interrupted the change.")
            raise
        if back is None:
            await self.go_back("The device does not answer with the new settings.")
            raise JobError(
                "The device did not answer with the new settings; it was rolled back to the old ones.", SLOWER
            )
        written = [replace(one, actual=back.get(one.setting, one.actual)) for one in written]
        if await self._is_confirmed():
            await self._end("confirmed", "The new settings are confirmed.")
            self._running.job.hint = self._source_hint()
            return written
        await self.go_back("The change was not confirmed in time." if not self._controller.answer.is_set() else "")
        who = "as requested" if self._controller.answer.is_set() else "because the change was not confirmed in time"
        raise JobError(f"The device was rolled back to the old settings, {who}.", "They can be applied again.")

    async def _write(self) -> list[WriteResult]:
        report = self._running.step
        record = self.record
        known = self._known_values(self._controller.member.access.baud)
        body = settings_procedures.write_all(self._driver, known, record.new, report, record.held)
        return await self._controller.run(self._driver.within(body, known))

    async def _read_new_settings(self) -> dict[str, Values] | None:
        """Values of the device at the new settings; None if it does not answer there."""
        record = self.record
        if record.restart:
            self._running.step("The device restarts")
            await self._restart()
        if not await self._read_back():
            return None
        self._running.step("Reading the settings back")
        snapshot = await self._read(record.new)
        return snapshot.values if snapshot is not None and set(snapshot.values) >= set(record.new) else None

    async def _read_back(self) -> bool:
        """Whether the device answers at the new rate, or at another possible rate."""
        record = self.record
        rates = tuple(dict.fromkeys((record.new_baud, *record.other_bauds)))
        for baud in (
            rates if len(rates) == 1 else rates * self._timings.rounds
        ):  # a restarting device may be missed at first
            if baud is not None and baud != self._controller.member.access.baud:
                self._running.step(f"The link is opened at {group(baud)} Bd")
                if not await self._controller.runner.reopen(baud):
                    continue
            if await self._alive():
                record.new_baud = baud
                await self._resume()
                return True
        return False

    async def _is_confirmed(self) -> bool:
        """Whether the user confirmed the settings in time."""
        controller, record = self._controller, self.record
        controller.answer.clear()
        controller.is_change_confirmed = False
        rate = f" at {group(record.new_baud)} Bd" if record.new_baud else ""
        moved = record.old_baud and record.new_baud and record.new_baud != record.old_baud
        before = f" to {group(record.old_baud)} Bd" if record.old_baud and moved else " to the previous settings"
        record.deadline = controller.bus.now() + record.seconds
        words = f"The device answers{rate}. Unless confirmed, it is rolled back{before}."
        if record.new_baud in (None, record.old_baud):
            rows = controller.rows
            titles = ", ".join(rows[name].title or name if name in rows else name for name in record.new)
            words = (
                f"The device answers with the new settings ({titles}). Unless confirmed, the old settings are restored."
            )
        await self._report("pending", words)
        controller.member.suppress_timeout(False)
        self._running.step("Keep these settings?")
        try:
            async with asyncio.timeout(record.seconds):
                await controller.answer.wait()
        except TimeoutError:
            return False
        finally:
            controller.member.suppress_timeout(True)
        return controller.is_change_confirmed

    def _source_hint(self) -> str:
        """Hint for a source with the old rate, which would not find the device after the next start of the server."""
        record = self.record
        if record.new_baud in (None, record.old_baud) or f"baud={record.old_baud}" not in record.source:
            return ""
        source = record.source.replace(f"baud={record.old_baud}", f"baud={record.new_baud}")
        return f"Open it as {source} when this server is started again."

    # ── rollback ─────────────────────────────────────────────────────────────────────────────────────────────────────

    async def go_back(self, why: str = "") -> None:
        """Write the old settings, restart, set the old rate, read back. It always ends in another state than
        "rolling-back".

        Raises:
            JobError: the device does not answer, does not accept its old settings, or is a different one.
        """
        self._running.stoppable = False
        self.record.deadline = 0.0
        words = f"{why} The old settings are being put back.".strip()
        self.show("rolling-back", words)  # before the disk is waited for: it is too late to keep the change
        try:
            await self._report("rolling-back", words)
            answered = await self._try_rollback()
        except JobError:
            raise
        except Exception:
            await self._report("unreachable", BROKEN)
            raise
        if answered is None:
            return
        words, hint = (NOT_ACCEPTED, NOT_ACCEPTED_HINT) if answered else (UNREACHABLE, RESTORE_HINT)
        await self._report("unreachable", words)
        raise JobError(words, hint)

    async def _try_rollback(self) -> bool | None:
        """None when the device has its old settings; otherwise whether it answered at all."""
        rates = list(dict.fromkeys((self.record.new_baud, self.record.old_baud, *self.record.other_bauds)))
        answered = False
        for turn in range(self._timings.rounds):
            for baud in rates:
                if not await self._open_link_at(baud, first=turn == 0):
                    continue
                try:
                    if await self._alive():
                        answered = True
                        if not (wrong := await self.put_back(baud)):
                            return None
                        self._controller.log.add_note(f"The device answered, but {wrong}.", error=True)
                except (NoReplyError, DeviceRejectedError, LinkError) as error:
                    self._controller.log.add_note(str(error), error=True)
        return answered

    async def _open_link_at(self, baud: int | None, *, first: bool) -> bool:
        """Open the link at a rate; waits for a port that is temporarily missing."""
        member = self._controller.member
        if first and baud == member.access.baud and member.info.status == "live":
            return True
        waited = 0.0
        while not await self._controller.runner.reopen(baud):
            if waited >= (self._timings.port_back_s if first else self._timings.restart_s):
                return False
            await asyncio.sleep(self._timings.port_poll_s)
            waited += self._timings.port_poll_s
        return True

    async def put_back(self, baud: int | None) -> str:
        """Write the old settings to a device that answers; returns the problem that is left, "" for none."""
        record, driver = self.record, self._driver
        known = self._known_values(baud)
        self._running.step("Putting the old settings back")

        def body() -> Any:
            identified = yield from driver.identify(known)
            self._check_identity(identified)
            return (
                yield from settings_procedures.write_all(driver, known, record.old, self._running.step, held=record.old)
            )

        written: list[WriteResult] = await self._controller.run(driver.within(body(), known))
        for one in written:
            if one.refused:
                self._controller.log.add_note(f"{one.setting}: {one.refused}.", error=True)
        if record.restart:
            await self._restart()
        if record.old_baud is not None and record.old_baud != self._controller.member.access.baud:
            await self._controller.runner.reopen(record.old_baud)
        if not await self._alive():
            return "did not after its old settings were written"
        await self._resume()
        snapshot = await self._read(record.old)
        if snapshot is None:
            return "its settings cannot be read back"
        if others := [
            name
            for name, values in record.old.items()
            if driver.same(name, values, {key: snapshot.values.get(name, {}).get(key) for key in values})
        ]:
            return f"these settings are not the old ones: {', '.join(others)}"
        await self._end("rolled-back", "The device has its old settings again; they were read back.")
        return ""

    def _check_identity(self, identified: DeviceContext) -> None:
        ours = self.record.serial_number
        if not is_same(self._driver, ours, identified.serial_number):
            self._rollbacks.forget(self.record)
            self.show("unreachable", f"Device {identified.serial_number} is at the port now, not {ours}.")
            raise JobError(
                f"Another device is at this port: {identified.serial_number}, not {ours}. It was not changed.",
                f"Connect {ours} and put its settings back from the snapshot taken before the change.",
            )

    # ── common steps ─────────────────────────────────────────────────────────────────────────────────────────────────

    async def _restart(self) -> None:
        """Store and restart. A lost answer to a reset is normal."""
        known = self._known_values(self._controller.member.access.baud)
        self._controller.restarts(self._running.job.title)
        try:
            running = await self._controller.run(self._driver.store_and_restart(known))
            self._to_resume = self._to_resume or running  # what an earlier restart ended does not run now
        except NoReplyError as error:
            self._controller.log.add_note(str(error))

    async def _resume(self) -> None:
        """Start again what a restart has ended, on the device that answers."""
        if self._to_resume:
            known = self._known_values(self._controller.member.access.baud)
            await self._controller.run(self._driver.resume(self._to_resume, known))
            self._to_resume = ()

    async def _alive(self) -> bool:
        return await self._controller.run(
            self._driver.is_alive(self._known_values(self._controller.member.access.baud))
        )

    async def _read(self, names: Mapping[str, Any]) -> settings_procedures.SettingsSnapshot | None:
        known = self._known_values(self._controller.member.access.baud)
        altered_too = settings_procedures.altered(self._driver, known, names)
        body = settings_procedures.read_settings(self._driver, known, [*names, *altered_too], self._running.step)
        try:
            snapshot = await self._controller.run(self._driver.within(body, known))
        except (NoReplyError, DeviceRejectedError) as error:
            self._controller.log.add_note(str(error), error=True)
            return None
        self._check_identity(snapshot.known)
        self._controller.update(snapshot.known, snapshot.values, snapshot.missing)
        return snapshot

    def _known_values(self, baud: int | None) -> DeviceContext:
        return replace(self.record.known, baud=baud, settings=self._controller.context.settings)

    async def _report(self, state: Literal["applying", "pending", "rolling-back", "unreachable"], words: str) -> None:
        """Store the state on disk and publish it to all clients.

        Raises:
            JobError: it cannot be written, before anything was sent. Later that is only logged, because the device is
                already changing and the procedure must go on.
        """
        self.record.state = state
        try:
            await asyncio.to_thread(self._rollbacks.save, self.record)
        except JobError as error:
            if state == "applying":
                raise
            self._controller.log.add_note(str(error), error=True)
        self.show(state, words)

    async def _end(self, state: Literal["confirmed", "rolled-back"], words: str) -> None:
        await asyncio.to_thread(self._rollbacks.forget, self.record)
        self.show(state, words)
        self._controller.log.add_note(words)
        self._controller.bus.event(self._controller.device, "device", "info", words, data={"rollback": state})

    def show(
        self,
        state: Literal["applying", "pending", "rolling-back", "confirmed", "rolled-back", "unreachable"],
        words: str,
    ) -> None:
        """Publish the state to all clients."""
        deadline = self.record.deadline if state == "pending" else None
        self._controller.pending_rollback = PendingRollback(
            self._controller.device, state, list(self.record.changes), words, deadline, self.record.seconds
        )
        self._controller.notify()
