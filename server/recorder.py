"""What is being recorded? One recording at a time, of any number of devices, and the button that begins and ends it.

    session.chunks ──bytes both ways──┐
    hub: events, devices, exchange  ──┼──> Tape (its own thread) ──> <data>/recordings/20261121T044324Z-MTi-630.mcap
    desk: settings that were read   ──┤                                     │ finished, or full and split
    a person: markers, notes        ──┘                                     └──> Packer (a process) ──> small, indexed

Devices that appear later join a recording of all. What is known about a device is written again when more of it is. An
Xsens device is asked for its Configuration, which its own program wants at the head of a log; it pauses for that, once
in a recording, through the queue of its desk (server/control.py), and what it refuses is said and does no harm.

A browser that goes, a device that goes, a busy page: none ends a recording. The disk does, and then `message` says why.
"""

from __future__ import annotations

import asyncio
import contextlib
import platform
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from recordings import quota
from recordings.container import RecordingError
from recordings.names import free_path
from recordings.tape import Limits, Tape
from server import codec, wire
from server.config import Config
from server.control import Desk
from server.desks import Desks
from server.head import Head
from server.hub import Hub
from server.packer import Packer
from server.recorded import Mark
from server.session import Session
from server.sessions import Sessions
from server.version import VERSION

FOLDER = "recordings"  # of the data folder
LOOK_S = 0.5  # between two looks at how it goes, told to every browser
CULL_EVERY = 20  # looks
RATE_S = 10.0  # over which `seconds_left` takes the rate
TOLD = ("name", "source", "link", "protocol", "product", "serial_number", "firmware", "baud", "protection")


class RecorderError(Exception):
    """A wish that cannot be met: `kind` is "busy", "not-now" or "not-found"."""

    def __init__(self, kind: str, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.kind, self.message, self.hint = kind, message, hint


@dataclass(frozen=True, slots=True)
class Plan:
    """How recordings are made.

    Args:
        folder: where they are.
        limits: when a recording goes on in a new file.
        quota_bytes: more than that in the folder, and the oldest unpinned go; 0 for no quota.
        ask_head: ask an Xsens device for its Configuration.
    """

    folder: Path
    limits: Limits = field(default_factory=Limits)
    quota_bytes: int = 0
    ask_head: bool = True


def plan_of(config: Config) -> Plan:
    """What the configuration says about recordings."""
    limits = Limits(round(config.split_mb * 1e6), config.split_min * 60)
    return Plan(config.data / FOLDER, limits, round(config.recordings_quota_gb * 1e9), config.record_head)


@dataclass(slots=True)
class _Running:
    """A recording under way."""

    tape: Tape
    title: str
    all: bool
    started: float
    off: dict[str, Callable[[], None]] = field(default_factory=dict)  # device → takes its chunks off
    said: dict[str, Any] = field(default_factory=dict)  # device → the settings that were written last
    heads: dict[str, Head] = field(default_factory=dict)
    sizes: list[tuple[float, int]] = field(default_factory=list)  # (when, bytes) of the last looks


class Recorder:
    """Begins, watches and ends recordings.

    Args:
        desks: for settings that are known and for asking an Xsens device; None where nobody configures.
        packer: None: files stay as they were written.
    """

    def __init__(self, hub: Hub, sessions: Sessions, desks: Desks | None, plan: Plan, packer: Packer | None) -> None:
        self.plan = plan
        self._hub = hub
        self._sessions = sessions
        self._desks = desks
        self._packer = packer
        self._now: _Running | None = None
        self._last = wire.RecorderState(running=False)
        self._watcher: asyncio.Task[None] | None = None
        self._starting = asyncio.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        sessions.on_added(self._appeared)
        hub.heard_event.add(self._event)
        hub.heard_device.add(self._device)
        hub.heard_control.add(self._control)
        hub.heard_exchange.add(self._exchange)

    # ── the button ───────────────────────────────────────────────────────────────────────────────────────────────────

    async def start(
        self, devices: Sequence[str] | None = None, title: str = "", path: Path | None = None
    ) -> wire.RecorderState:
        """Begin.

        Args:
            devices: ids; None for all, also those that appear later.
            title: what a person calls it; may be empty.
            path: of the file, where it is not to be in the folder under a name of its own.
        Raises:
            RecorderError: something is being recorded already, or there is no such device.
            RecordingError: the file cannot be made.
        """
        async with self._starting:
            if self._now is not None:
                raise RecorderError("busy", "A recording is running already.", "Stop it first.")
            chosen = self._chosen(devices)
            self._loop = asyncio.get_running_loop()
            tape = await asyncio.to_thread(self._tape, self._words(chosen, title), title, path)
            now = self._now = _Running(tape, title, devices is None, self._hub.now())
            for session in chosen if devices is not None else self._sessions.all:
                self._join(now, session)
            self._watcher = asyncio.get_running_loop().create_task(self._watch(now), name="recorder")
            self._tell()
            self._hub.library_changed()
            return self.state

    async def stop(self) -> wire.RecorderState:
        """End it; the file is whole when this returns.

        Raises:
            RecorderError: nothing is being recorded.
        """
        now = self._now
        if now is None:
            raise RecorderError("not-now", "Nothing is being recorded.", "")
        await self._end(now)
        return self.state

    def mark(self, mark: Mark) -> wire.RecorderState:
        """Put a marker or a note into what is being recorded.

        Raises:
            RecorderError: nothing is being recorded.
        """
        now = self._now
        if now is None:
            hint = "A marker can be put into a finished recording on its page."
            raise RecorderError("not-now", "Nothing is being recorded.", hint)
        when = self._hub.now() if mark.time is None else mark.time
        now.tape.note(mark.kind, mark.text, round(when * 1e9), mark.device)
        self._hub.event(mark.device, "marker", "info", mark.text or "Marker", time=when, data={"kind": mark.kind})
        return self.state

    @property
    def state(self) -> wire.RecorderState:
        """As browsers are told."""
        now = self._now
        if now is None:
            return self._last
        free = _free(now.tape.path)
        return wire.RecorderState(
            running=True,
            id=now.tape.path.stem,
            title=now.title,
            devices=list(now.off),
            started=now.started,
            bytes=now.tape.bytes,
            behind_s=now.tape.behind_s,
            free=free,
            seconds_left=_seconds_left(now.sizes, free),
        )

    @property
    def path(self) -> Path | None:
        """The file that is being written, which nobody may touch; None while there is none."""
        return self._now.tape.path if self._now is not None else None

    async def resume(self) -> None:
        """Pack what was left behind by the server before this one."""
        if self._packer is not None:
            await self._packer.resume(self.plan.folder)

    async def close(self) -> None:
        """The server ends: so does the recording."""
        if self._now is not None:
            await self._end(self._now)
        if self._packer is not None:
            await self._packer.close()

    # ── begin and end ────────────────────────────────────────────────────────────────────────────────────────────────

    def _chosen(self, devices: Sequence[str] | None) -> list[Session]:
        if devices is None:
            return self._sessions.all
        found: dict[str, Session] = {}
        for device in devices:
            try:
                session = self._sessions.get(device.partition(".")[0])  # one that shares a link is on its first's
            except KeyError:
                raise RecorderError("not-found", f"There is no device {device:.40}.", "") from None
            found[session.info.id] = session
        if not found:
            raise RecorderError("not-found", "No device was chosen.", "Leave `devices` out to record all.")
        return list(found.values())

    @staticmethod
    def _words(chosen: Sequence[Session], title: str) -> str:
        """What the file is called after."""
        if title or not chosen:
            return title
        more = f"-and-{len(chosen) - 1}-more" if len(chosen) > 1 else ""
        return chosen[0].info.name + more

    def _tape(self, words: str, title: str, path: Path | None) -> Tape:
        """In a thread: it makes a file."""
        folder = path.parent if path is not None else self.plan.folder
        if path is None:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                words = f"The folder {folder} cannot be made: {error.strerror}."
                raise RecordingError(words, "Choose another with --data.") from None
            self._cull(())

        def name(part: int) -> Path:
            if path is not None and part == 1:
                return path
            return free_path(folder, time.time(), path.stem if path is not None else words)

        about = {
            "title": title,
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "host": platform.node(),
            "version": VERSION,
        }
        now_ns = lambda: round(self._hub.now() * 1e9)  # noqa: E731
        return Tape(name, about, now_ns, self.plan.limits, lambda part: self._soon(self._part_done, part))

    def _soon(self, function: Callable[..., None], *arguments: Any) -> None:
        """Have the event loop call it; from a thread."""
        with contextlib.suppress(RuntimeError):  # it has ended
            if self._loop is not None:
                self._loop.call_soon_threadsafe(function, *arguments)

    async def _end(self, now: _Running, *, why: RecordingError | None = None) -> None:
        """Take everything off, wait for the file."""
        for off in now.off.values():
            off()
        for head in now.heads.values():
            head.close()
        await asyncio.to_thread(now.tape.stop)
        if self._now is not now:
            return  # somebody else was quicker
        why = why or now.tape.trouble
        last = self.state
        self._now = None
        last.running, last.behind_s, last.seconds_left = False, 0.0, None
        last.message, last.hint = (why.message, why.hint) if why is not None else ("", "")
        self._last = last
        if why is not None:
            self._hub.event("", "device", "fault", f"The recording has ended: {why.message}", data={"hint": why.hint})
        self._hub.set_recorder(last)
        self._hub.library_changed()
        watcher, self._watcher = self._watcher, None
        if watcher is not None and watcher is not asyncio.current_task():
            watcher.cancel()

    def _part_done(self, path: Path) -> None:
        """A file is finished."""
        if self._packer is not None:
            self._packer.add(path)
        self._hub.library_changed()

    # ── while it runs ────────────────────────────────────────────────────────────────────────────────────────────────

    async def _watch(self, now: _Running) -> None:
        looks = 0
        while self._now is now:
            await asyncio.sleep(LOOK_S)
            looks += 1
            if not now.tape.running:
                await self._end(now)
                return
            now.sizes.append((self._hub.now(), now.tape.bytes))
            now.sizes = [one for one in now.sizes if one[0] >= self._hub.now() - RATE_S]
            self._tell()
            if looks % CULL_EVERY == 0 and self.plan.quota_bytes:
                await asyncio.to_thread(self._cull, (now.tape.path,))

    def _cull(self, spare: Sequence[Path]) -> None:
        """In a thread: what has to go so that the folder stays within its quota."""
        if not self.plan.quota_bytes:
            return
        gone = quota.cull(self.plan.folder, self.plan.quota_bytes, spare)
        if gone:
            names = ", ".join(path.stem for path in gone)
            self._soon(self._culled, f"Over the quota, the oldest recordings were deleted: {names}.")

    def _culled(self, text: str) -> None:
        self._hub.event("", "device", "caution", text)
        self._hub.library_changed()

    def _tell(self) -> None:
        self._hub.set_recorder(self.state)

    # ── what goes into it ────────────────────────────────────────────────────────────────────────────────────────────

    def _appeared(self, session: Session) -> None:
        if self._now is not None and self._now.all:
            self._join(self._now, session)

    def _join(self, now: _Running, session: Session) -> None:
        device, tape = session.info.id, now.tape
        tape.device(device, about(session.info))
        now.off[device] = session.chunks(lambda data, time_ns, way: tape.chunk(device, way, data, time_ns))

        async def left() -> None:
            now.off.pop(device, lambda: None)()

        session.before_close(left)
        desk = self._desk(device)
        if desk is not None:
            self._settings(now, desk)
            now.heads[device] = Head(desk, lambda told: tape.device(device, told))
            self._ask(now, session.info)

    def _desk(self, device: str) -> Desk | None:
        try:
            return self._desks.get(device) if self._desks is not None else None
        except KeyError:
            return None

    def _ask(self, now: _Running, info: wire.DeviceInfo) -> None:
        """Have it asked what the head of a log wants, when it is there."""
        if self.plan.ask_head and info.status == "live" and info.id in now.heads:
            now.heads[info.id].ask()

    def _settings(self, now: _Running, desk: Desk) -> None:
        """The settings of a device, where they are known and were not written yet."""
        if not desk.values or now.said.get(desk.device) == desk.values:
            return
        now.said[desk.device] = dict(desk.values)
        known = desk.known
        body = {
            "values": desk.values,
            "missing": desk.missing,
            "reason": "as read while it was recorded" if desk.read_at >= now.started else "as read before",
            "taken": desk.read_at,
            "protocol": desk.session.info.protocol,
            "product": known.product,
            "serial_number": known.serial_number,
            "firmware": known.firmware,
        }
        now.tape.snapshot(desk.device, codec.plain(body), round(self._hub.now() * 1e9))

    def _event(self, event: wire.EventInfo) -> None:
        now = self._now
        if now is None or event.kind == "marker":  # that one is a note
            return
        if not event.device or event.device.partition(".")[0] in now.off:
            now.tape.event(codec.plain(event), round(event.time * 1e9))

    def _device(self, info: wire.DeviceInfo) -> None:
        now = self._now
        if now is not None and info.id in now.off:
            now.tape.device(info.id, about(info))
            self._ask(now, info)

    def _control(self, state: wire.ControlState) -> None:
        now, desk = self._now, self._desk(state.device)
        if now is not None and desk is not None and state.device in now.off and state.running is None:
            self._settings(now, desk)

    def _exchange(self, entry: wire.ExchangeEntry) -> None:
        """What was said between the frames; the frames themselves are bytes, and commands are events."""
        now = self._now
        if now is not None and entry.way == "note" and entry.device in now.off:
            event = {"device": entry.device, "kind": "command", "level": entry.level, "text": entry.text, "data": {}}
            now.tape.event(event, round(entry.time * 1e9))


def about(info: wire.DeviceInfo) -> dict[str, Any]:
    """What a recording tells of a device; what is not known is left out."""
    return {name: value for name in TOLD if (value := getattr(info, name)) not in ("", None)}


def _free(path: Path) -> int | None:
    try:
        return shutil.disk_usage(path.parent).free
    except OSError:
        return None


def _seconds_left(sizes: Sequence[tuple[float, int]], free: int | None) -> float | None:
    """Until the disk is full, as it went in the last seconds."""
    if free is None or len(sizes) < 2:
        return None
    (first, before), (last, after) = sizes[0], sizes[-1]
    if last <= first or after <= before:
        return None
    return free / ((after - before) / (last - first))
