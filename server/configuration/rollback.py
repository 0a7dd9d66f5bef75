"""How does a change that could cut the line find its way back by itself? The dead man's hand.

    on disk: old and new settings, rates, deadline       forced to disk before the first byte of the change is sent
    write ─> restart ─> link at the new rate ─> does it answer, and is what was written there?
                                    │ yes                              │ no
                             "Keep these settings?"             link at new, old, new, old … rate
                          20 s │ keep      │ nobody, or "go back"      │ answers at one
                               v           └──────────┬────────────────┘                       │ at none
                             kept            write old, restart, link at old rate, read back    v
                                                      v                              unreachable until
                                                  reverted                           its power is cycled

The server does this by itself, whoever watches: a browser that is gone cannot say "keep". A server that was killed in
the middle finds the file when it starts again and goes back first of all. Before old settings are written the device is
asked who it is; another one that is at the port by now is left alone.

The file stays while the device is unreachable; the procedure that restores communication (server/configuration/jobs.py)
ends with the old settings too.
"""

from __future__ import annotations

import asyncio
import json
import logging
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from protocols.transactions import DeviceContext, DeviceDriver, DeviceRejectedError, NoReplyError, Values, WriteResult
from recordings import atomic_write
from recordings.mcap_writer import check_format_version
from server.configuration import settings_procedures
from server.configuration.device_controller import DeviceController, JobError, QueuedJob
from server.configuration.transaction_runner import group
from server.links.base import LinkError
from server.wire import Trial

log = logging.getLogger("imuscope.trials")

FORMAT = 1  # of the file
ROUNDS = 4  # new and old rate, in turn
RESTART_S = 3.0  # a device that restarts answers after 2 s
PORT_BACK_S = 60.0  # a port that vanished (USB restarts with the device) may take so long
UNREACHABLE = (
    "The device answers neither at the new rate nor at the old one: it is unreachable until its power is cycled."
)
SLOWER = "Ask for less, or for a rate that its cable carries."
NOT_TAKEN = "The device answers, but did not take its old settings back."
NOT_TAKEN_HINT = "Read its settings; the snapshot taken before the change has the old ones."
BROKEN = "A fault in imuscope interrupted the way back; the device may still have the new settings."
RESTORE_HINT = "Start “Restore communication”, then switch the device off and on while it runs."


@dataclass(slots=True)
class RollbackRecord:
    """A trial as it stands on disk.

    Args:
        old, new: the settings concerned, by name.
        old_baud, new_baud: None where the rate stays or the link has none.
        other_bauds: rates at which the device may be found as well, where it is not known which of its ports is ours.
        restart: the change takes effect by a restart.
        device: on a link that several share, what the stream calls it; "" for the first.
        address: where it is addressed there; None where it has no address.
        deadline: unix seconds, when it goes back by itself; later than anything that is still being done.
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
    state: Literal["applying", "asking", "reverting", "unreachable"] = "applying"
    deadline: float = 0.0
    seconds: float = 20.0
    other_bauds: list[int] = field(default_factory=list)
    held: list[str] = field(default_factory=list)  # of the new settings those that go back to what the device had once
    device: str = ""
    address: int | None = None

    @property
    def known(self) -> DeviceContext:
        device = "" if self.address is None else str(self.address)
        return DeviceContext(self.product, self.serial_number, self.firmware, device=device)


class RollbackStore:
    """The folder of trials that are not over: <data>/trials. Reads and writes files: not on the event loop."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def keep(self, record: RollbackRecord) -> None:
        """Write it, durably.

        Raises:
            JobError: the disk does not take it, so the change must not begin.
        """
        try:
            atomic_write.write_atomic(
                self._path(record), json.dumps({"imuscope": FORMAT, **asdict(record)}, indent=1) + "\n"
            )
        except OSError as error:
            hint = f"Nothing was sent. Is there space, and may this server write to {self._folder}?"
            raise JobError(f"The way back could not be kept on disk: {error.strerror}.", hint) from None

    def forget(self, record: RollbackRecord) -> None:
        """It is over."""
        try:
            atomic_write.remove(self._path(record))
        except OSError as error:
            log.error("%s could not be removed: %s", self._path(record), error)

    def all(self) -> list[RollbackRecord]:
        """What was not over when the last server ended. A file that cannot be read is told in the log, and stays."""
        found = []
        paths = sorted(self._folder.glob("*.json")) if self._folder.is_dir() else []
        for path in paths:
            try:
                body = json.loads(path.read_text(encoding="utf-8"))
                if why := check_format_version(path.name, body.pop("imuscope", FORMAT), FORMAT):
                    log.error("%s %s", why.message, why.hint)
                    continue
                found.append(RollbackRecord(**body))
            except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
                log.error("%s cannot be read: %s", path, error)
        return found

    def of(self, protocol: str, serial_number: str) -> RollbackRecord | None:
        """The one of a device."""
        return next((one for one in self.all() if (one.protocol, one.serial_number) == (protocol, serial_number)), None)

    def _path(self, record: RollbackRecord) -> Path:
        name = re.sub(r"[^A-Za-z0-9-]+", "-", f"{record.protocol}-{record.serial_number or record.source}")
        return self._folder / f"{name[:120]}.json"


class RollbackRun:
    """One trial, carried out.

    Args:
        task: the job it belongs to.
    """

    def __init__(
        self,
        desk: DeviceController,
        driver: DeviceDriver,
        trials: RollbackStore,
        record: RollbackRecord,
        task: QueuedJob,
    ) -> None:
        self._desk = desk
        self._driver = driver
        self._trials = trials
        self.record = record
        self._task = task

    # ── forth ────────────────────────────────────────────────────────────────────────────────────────────────────────

    async def apply(self) -> list[WriteResult]:
        """Write, see whether the device is there, ask, keep or go back; what was written.

        Raises:
            JobError: the device went back, or is unreachable; in words.
        """
        self._task.stoppable = False
        await self._stand("applying", "The change is being made.")
        try:
            written = await self._write()
            if all(one.refused for one in written):
                await self._end("reverted", "The device refused the change; nothing is different.")
                return written
            back = await self._arrived()
        except (NoReplyError, DeviceRejectedError, LinkError) as error:
            self._desk.log.note(str(error), fault=True)
            back = None
        except JobError:
            raise  # another device is at the port: nothing is put back to it
        except Exception:  # whatever it is, the device must not be left half changed
            log.exception("a trial could not be carried out")
            await self.go_back("A fault in imuscope interrupted the change.")
            raise
        if back is None:
            await self.go_back("The device does not answer with the new settings.")
            raise JobError("The device did not answer with the new settings; it went back to the old ones.", SLOWER)
        written = [replace(one, got=back.get(one.setting, one.got)) for one in written]
        if await self._ask():
            await self._end("kept", "The settings are kept.")
            self._task.job.hint = self._source_hint()
            return written
        await self.go_back("Nobody kept the settings in time." if not self._desk.answer.is_set() else "")
        who = "as somebody asked" if self._desk.answer.is_set() else "as nobody kept the new ones in time"
        raise JobError(f"The device went back to the old settings, {who}.", "They can be applied again.")

    async def _write(self) -> list[WriteResult]:
        tell = self._tell
        record = self.record
        known = self._known(self._desk.session.baud)
        body = settings_procedures.write_all(self._driver, known, record.new, tell, record.held)
        return await self._desk.run(self._driver.within(body, known))

    async def _arrived(self) -> dict[str, Values] | None:
        """What the device has at the new settings; None where it does not answer there."""
        record = self.record
        if record.restart:
            self._tell("The device restarts")
            await self._restart()
        if not await self._found():
            return None
        self._tell("Reading the settings back")
        found = await self._read(record.new)
        return found.values if found is not None and set(found.values) >= set(record.new) else None

    async def _found(self) -> bool:
        """Does it answer at the new rate, or at another that it may have?"""
        record = self.record
        rates = tuple(dict.fromkeys((record.new_baud, *record.other_bauds)))
        for baud in rates if len(rates) == 1 else rates * ROUNDS:  # one that restarts may be missed at its rate
            if baud is not None and baud != self._desk.session.baud:
                self._tell(f"The link is opened at {group(baud)} Bd")
                if not await self._desk.runner.relink(baud):
                    continue
            if await self._alive():
                record.new_baud = baud
                return True
        return False

    async def _ask(self) -> bool:
        """Did a person keep the settings before the time was over?"""
        desk, record = self._desk, self.record
        desk.answer.clear()
        desk.kept = False
        rate = f" at {group(record.new_baud)} Bd" if record.new_baud else ""
        moved = record.old_baud and record.new_baud and record.new_baud != record.old_baud
        before = f" to {group(record.old_baud)} Bd" if record.old_baud and moved else " to what was before"
        record.deadline = desk.hub.now() + record.seconds
        words = f"The device answers{rate}. If you say nothing, it goes back{before}."
        if record.new_baud in (None, record.old_baud):
            rows = desk.rows
            titles = ", ".join(rows[name].title or name if name in rows else name for name in record.new)
            words = f"The device answers with the new settings ({titles}). If you say nothing, the old ones come back."
        await self._stand("asking", words)
        desk.session.hush(False)
        self._tell("Keep these settings?")
        try:
            await asyncio.wait_for(desk.answer.wait(), record.seconds)
        except TimeoutError:
            return False
        finally:
            desk.session.hush(True)
        return desk.kept

    def _source_hint(self) -> str:
        """A source that names the old rate does not find the device after the next start of the server."""
        record = self.record
        if record.new_baud in (None, record.old_baud) or f"baud={record.old_baud}" not in record.source:
            return ""
        source = record.source.replace(f"baud={record.old_baud}", f"baud={record.new_baud}")
        return f"Open it as {source} when this server is started again."

    # ── back ─────────────────────────────────────────────────────────────────────────────────────────────────────────

    async def go_back(self, why: str = "") -> None:
        """Old settings, restart, old rate, read back. However it ends, it ends: nothing stays "reverting".

        Raises:
            JobError: it answers nowhere, or does not take its old settings, or another device is there.
        """
        self._task.stoppable = False
        self.record.deadline = 0.0
        try:
            await self._stand("reverting", f"{why} The old settings are being put back.".strip())
            answered = await self._tried_back()
        except JobError:
            raise
        except Exception:
            await self._stand("unreachable", BROKEN)
            raise
        if answered is None:
            return
        words, hint = (NOT_TAKEN, NOT_TAKEN_HINT) if answered else (UNREACHABLE, RESTORE_HINT)
        await self._stand("unreachable", words)
        raise JobError(words, hint)

    async def _tried_back(self) -> bool | None:
        """None when the device has its old settings; else whether it answered at all."""
        rates = list(dict.fromkeys((self.record.new_baud, self.record.old_baud, *self.record.other_bauds)))
        answered = False
        for turn in range(ROUNDS):
            for baud in rates:
                if not await self._link_at(baud, first=turn == 0):
                    continue
                try:
                    if await self._alive():
                        answered = True
                        if await self.put_back(baud):
                            return None
                except (NoReplyError, DeviceRejectedError, LinkError) as error:
                    self._desk.log.note(str(error), fault=True)
        return answered

    async def _link_at(self, baud: int | None, *, first: bool) -> bool:
        """The link open at a rate; a port that is away for a moment is waited for."""
        session = self._desk.session
        if first and baud == session.baud and session.info.status == "live":
            return True
        waited = 0.0
        while not await self._desk.runner.relink(baud):
            if waited >= (PORT_BACK_S if first else RESTART_S):
                return False
            await asyncio.sleep(1.0)
            waited += 1.0
        return True

    async def put_back(self, baud: int | None) -> bool:
        """Write the old settings to a device that answers; False where it cannot be read back afterwards."""
        record, driver = self.record, self._driver
        known = self._known(baud)
        self._tell("Putting the old settings back")

        def body() -> Any:
            told = yield from driver.identify(known)
            self._is_it(told)
            return (yield from settings_procedures.write_all(driver, known, record.old, self._tell, held=record.old))

        written: list[WriteResult] = await self._desk.run(driver.within(body(), known))
        for one in written:
            if one.refused:
                self._desk.log.note(f"{one.setting}: {one.refused}.", fault=True)
        if record.restart:
            await self._restart()
        if record.old_baud is not None and record.old_baud != self._desk.session.baud:
            await self._desk.runner.relink(record.old_baud)
        if not await self._alive():
            return False
        found = await self._read(record.old)
        if found is None or any(
            driver.same(name, values, {key: found.values.get(name, {}).get(key) for key in values})
            for name, values in record.old.items()
        ):
            return False
        await self._end("reverted", "The device has its old settings again; they were read back.")
        return True

    def _is_it(self, told: DeviceContext) -> None:
        ours = self.record.serial_number
        if ours and told.serial_number and ours not in (told.serial_number, *self._driver.formerly(told.serial_number)):
            self._trials.forget(self.record)
            self.show("unreachable", f"Device {told.serial_number} is at the port now, not {ours}.")
            raise JobError(
                f"Another device is at this port: {told.serial_number}, not {ours}. It was left as it is.",
                f"Connect {ours} and put its settings back from the snapshot taken before the change.",
            )

    # ── both ways ────────────────────────────────────────────────────────────────────────────────────────────────────

    async def _restart(self) -> None:
        """Store and restart. That the answer to a reset is lost is no news."""
        try:
            await self._desk.run(self._driver.store_and_restart(self._known(self._desk.session.baud)))
        except NoReplyError as error:
            self._desk.log.note(str(error))

    async def _alive(self) -> bool:
        return await self._desk.run(self._driver.alive(self._known(self._desk.session.baud)))

    async def _read(self, names: Mapping[str, Any]) -> settings_procedures.SettingsSnapshot | None:
        known = self._known(self._desk.session.baud)
        also = settings_procedures.altered(self._driver, known, names)
        body = settings_procedures.read_settings(self._driver, known, [*names, *also], self._tell)
        try:
            found = await self._desk.run(self._driver.within(body, known))
        except (NoReplyError, DeviceRejectedError) as error:
            self._desk.log.note(str(error), fault=True)
            return None
        self._is_it(found.known)
        self._desk.learn(found.known, found.values, found.missing)
        return found

    def _known(self, baud: int | None) -> DeviceContext:
        return replace(self.record.known, baud=baud, key=self._desk.session.reading.key)

    def _tell(self, words: str) -> None:
        self._desk.step(self._task, words)

    async def _stand(self, state: Literal["applying", "asking", "reverting", "unreachable"], words: str) -> None:
        """Where it stands: on disk, then to everybody.

        Raises:
            JobError: the disk does not take it, before anything was sent. Later that only shows in the log: the device
                is on its way, and going on is all that helps.
        """
        self.record.state = state
        try:
            await asyncio.to_thread(self._trials.keep, self.record)
        except JobError as error:
            if state == "applying":
                raise
            self._desk.log.note(str(error), fault=True)
        self.show(state, words)

    async def _end(self, state: Literal["kept", "reverted"], words: str) -> None:
        await asyncio.to_thread(self._trials.forget, self.record)
        self.show(state, words)
        self._desk.log.note(words)
        self._desk.hub.event(self._desk.device, "device", "info", words, data={"trial": state})

    def show(
        self, state: Literal["applying", "asking", "reverting", "kept", "reverted", "unreachable"], words: str
    ) -> None:
        """Where it stands, to everybody."""
        deadline = self.record.deadline if state == "asking" else None
        self._desk.trial = Trial(
            self._desk.device, state, list(self.record.changes), words, deadline, self.record.seconds
        )
        self._desk.tell()
