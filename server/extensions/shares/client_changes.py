"""Changes that clients of a shared port make to the settings of a device.

    client ── SetOutputConfiguration ──> device ── acknowledgement ──> the controller's values
                                           done (holder) ──> differences, by whom: event, traffic log, snapshot

What a client writes is taken from its frames, once the device has acknowledged it. Nothing is read back: that could
interrupt the measurement that the client waits for, and no user has requested it.
"""

import asyncio
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from imuscope.protocols.commands.transactions import Values
from imuscope.protocols.events import Batch, Reply
from imuscope.server.configuration.device_controller import ControlError, DeviceController
from imuscope.server.configuration.settings_diff import ComparedValues, compare
from imuscope.server.configuration.settings_reader import plain_values
from imuscope.server.configuration.snapshots import Snapshot, SnapshotError, Snapshots

MAX_LATEST = 5
MOST_WORDS = 6  # changes that a sentence lists
MOST_PENDING = 50
WRITTEN = "written"  # in place of a value of a setting that was not known before
POLL_S, MOST_DECODING_S = 0.05, 3.0  # a device without viewers is decoded once in a while


@dataclass(frozen=True, slots=True)
class ChangedValue:
    """A value before and after; empty if it was not known."""

    title: str
    unit: str
    before: str
    after: str


@dataclass(frozen=True, slots=True)
class SettingsChange:
    """Changes of a client to the settings of the device."""

    client: str
    time: float = field(metadata={"description": "unix s"})
    rows: tuple[ChangedValue, ...]
    unread: tuple[str, ...] = field(
        metadata={"description": "titles of settings that it may have changed, and were not read since"}
    )
    snapshot: str = field(metadata={"description": "name of the snapshot after it; empty if there is none"})


@dataclass(slots=True)
class _Configuration:
    """Settings that a client has written until now."""

    client: str
    before: Mapping[str, Values]
    pending: deque[tuple[str, str, Values]] = field(default_factory=lambda: deque(maxlen=MOST_PENDING))
    """Answer that is awaited, name of the frame, its values."""
    written: dict[str, Values] = field(default_factory=dict)
    altered: dict[str, None] = field(default_factory=dict)


class ClientChanges:
    """Changes of the settings of one device."""

    def __init__(self, controller: DeviceController, snapshots: Snapshots) -> None:
        self._controller = controller
        self._snapshots = snapshots
        self._now: _Configuration | None = None
        self._ending: _Configuration | None = None  # its client is done, and answers are still being decoded
        self.latest: deque[SettingsChange] = deque(maxlen=MAX_LATEST)
        self._tasks: set[asyncio.Task[None]] = set()
        self._off = controller.member.listen_to_news(self._on_news)

    def close(self) -> None:
        """Stop following the device."""
        self._off()
        for task in self._tasks:
            task.cancel()

    def sent(self, client: str, line: Mapping[str, Any]) -> None:
        """Note a frame of a client, decoded."""
        name, values = str(line.get("message") or ""), line.get("fields", {})
        controller = self._controller
        try:
            driver, known = controller.driver, controller.context
        except ControlError:
            return
        command = next((one for one in driver.commands(known) if one.name == name), None)
        if command is None or (command.kind == "ask" and not driver.alters(name, values, known)):
            return
        if self._now is None or self._now.client != client:
            self._now = _Configuration(client, dict(controller.values))
        if command.reply:
            self._now.pending.append((command.reply, name, values))
        else:
            self._take(self._now, name, values)

    def _on_news(self, event: Batch | Reply) -> None:
        """Take what the device acknowledges."""
        now = self._ending or self._now
        if now is None or not isinstance(event, Reply):
            return
        place = next((at for at, one in enumerate(now.pending) if one[0] == event.message.name), None)
        if place is None:
            return
        for _ in range(place):  # those before it were refused, or are not answered
            now.pending.popleft()
        _, name, values = now.pending.popleft()
        self._take(now, name, values)

    def _take(self, now: _Configuration, name: str, values: Values) -> None:
        """Take the values of a frame that the device has accepted."""
        controller = self._controller
        for row in controller.rows.values():
            if row.write != name:
                continue
            if set(values) <= {one.name for one in row.fields} and (row.partial or len(values) == len(row.fields)):
                now.written[row.name] = {**now.before.get(row.name, {}), **now.written.get(row.name, {}), **values}
                now.altered.pop(row.name, None)
            else:
                now.altered[row.name] = None
        for setting in controller.driver.alters(name, values, controller.context):
            if setting in controller.rows:
                now.written.pop(setting, None)
                now.altered[setting] = None

    def finished(self) -> None:
        """Show the changes: the client is done."""
        now, self._now = self._now, None
        if now is not None:
            self._ending = now
            task = asyncio.get_running_loop().create_task(self._finish(now), name="changes of a client")
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _finish(self, now: _Configuration) -> None:
        """Report a configuration, when its answers are decoded, which may be a moment after they have arrived."""
        deadline = time.monotonic() + MOST_DECODING_S
        while now.pending and time.monotonic() < deadline:
            await asyncio.sleep(POLL_S)
        if self._ending is now:
            self._ending = None
        if not (now.written or now.altered):
            return
        controller = self._controller
        controller.update(controller.context, now.written, {})
        controller.invalidate(list(now.altered), f"{now.client} may have changed it; read it again.")
        await self._report(now, now.written, list(now.altered))

    async def _report(self, now: _Configuration, changed: Mapping[str, Values], unread: Sequence[str]) -> None:
        controller = self._controller
        rows = controller.rows
        before = {name: now.before[name] for name in changed if name in now.before}
        difference = compare(
            controller.driver,
            controller.context,
            ComparedValues("before", before, otherwise="it was not read before"),
            ComparedValues("after", dict(changed), from_device=True),
        )
        new = [name for name in changed if name not in before]
        titles = {name: rows[name].title or name for name in rows}
        if not difference.rows and not new and not unread:
            same = ", ".join(titles[name] for name in changed)
            self._report_to_log(now, f"{now.client} wrote {same}; the values are the same.")
            return
        words = [f"{one.title} {one.left or '—'} → {one.right or '—'}" for one in difference.rows[:MOST_WORDS]]
        words += [f"{len(difference.rows) - MOST_WORDS} more"] if len(difference.rows) > MOST_WORDS else []
        words += [f"{titles[name]} (not read before)" for name in new]
        words += [f"{titles[name]} (not read yet)" for name in unread]
        self._report_to_log(now, f"{now.client} changed the settings: {'; '.join(words)}.", is_change=True)
        name = await self._save(now, [titles[one] for one in (*changed, *unread)])
        known = [ChangedValue(row.title, row.unit, row.left, row.right) for row in difference.rows]
        shown = (*known, *(ChangedValue(titles[one], "", "", WRITTEN) for one in new))
        unread_titles = tuple(titles[one] for one in unread)
        self.latest.appendleft(SettingsChange(now.client, controller.bus.now(), shown, unread_titles, name))

    def _report_to_log(self, now: _Configuration, text: str, *, is_change: bool = False) -> None:
        controller = self._controller
        controller.log.add_note(text)
        data = {"kind": "share", "client": now.client}
        controller.bus.event(controller.device, "device", "warning" if is_change else "info", text, data=data)

    async def _save(self, now: _Configuration, titles: Sequence[str]) -> str:
        """Save the settings after the change; "" if that is not possible."""
        controller = self._controller
        known = controller.context
        snapshot = Snapshot(
            protocol=controller.member.info.protocol,
            product=known.product,
            serial_number=known.serial_number,
            firmware=known.firmware,
            title=f"Set by {now.client}",
            reason=f"{now.client} wrote {', '.join(titles)}.",
            taken=controller.bus.now(),
            values=plain_values(controller.values),
            missing=dict(controller.missing),
        )
        try:
            return (await asyncio.to_thread(self._snapshots.save, snapshot, controller.rows)).name
        except SnapshotError as error:
            text = f"The settings that {now.client} wrote are not in a snapshot: {error}"
            controller.bus.event(controller.device, "device", "warning", text, data={"hint": error.hint})
            return ""
