"""What is being recorded? One recording at a time, of any number of devices, and the button that begins and ends it.

    devices, hub, desks ──Taking──> RecordingWriter (its own thread) ──> <data>/recordings/20261121T044324Z-MTi-630.mcap
                                                                    │ finished, or full and split
                                                                    └──> CompactionWorker (a process) ──> small, indexed

Devices that appear later join a recording of all. An Xsens device is asked for its Configuration, which its own program
wants at the head of a log; it pauses for that, once in a recording, through the queue of its desk
(server/configuration/device_controller.py), and what it refuses is said and does no harm.

A browser that goes, a device that goes, a busy page: none ends a recording. The disk does, and then `message` says why.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import platform
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from recordings import quota
from recordings.file_names import free_path
from recordings.mcap_writer import RecordingError
from recordings.recording_writer import Limits, RecordingWriter
from server import wire
from server.config import Config
from server.configuration.controllers import ControllerRegistry
from server.devices.device_state import short_source
from server.devices.session import Session
from server.devices.sessions import Sessions
from server.library.api_models import Mark
from server.library.compaction_worker import CompactionWorker
from server.library.recording_session import RecordingSession
from server.streaming.hub import Hub
from server.version import VERSION

log = logging.getLogger("imuscope.recorder")

FOLDER = "recordings"  # of the data folder
LOOK_S = 0.5  # between two looks at how it goes, told to every browser
CULL_EVERY = 20  # looks
SHIFT_NS = 2_000_000_000  # a wall clock that is further away was set


class RecorderError(Exception):
    """A wish that cannot be met: `kind` is "busy", "not-now" or "not-found"."""

    def __init__(self, kind: str, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.kind, self.message, self.hint = kind, message, hint


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """How recordings are made.

    Args:
        folder: where they are.
        limits: when a recording goes on in a new file.
        quota_bytes: more than that in the folder, and the oldest unpinned go; 0 for no quota.
        ask_head: ask an Xsens device for its Configuration.
        follow_clock: go on in a new file when the wall clock is set.
    """

    folder: Path
    limits: Limits = field(default_factory=Limits)
    quota_bytes: int = 0
    ask_head: bool = True
    follow_clock: bool = True


def plan_of(config: Config) -> RecordingOptions:
    """What the configuration says about recordings."""
    limits = Limits(round(config.split_mb * 1e6), config.split_min * 60)
    return RecordingOptions(config.data / FOLDER, limits, round(config.recordings_quota_gb * 1e9), config.record_head)


class Recorder:
    """Begins, watches and ends recordings.

    Args:
        desks: for settings that are known and for asking an Xsens device; None where nobody configures.
        packer: None: files stay as they were written.
        wall_ns: the wall clock. A recording keeps the time that it shows: the hub's never steps, and is wrong for good
            on a host whose clock was set after the server began.
    """

    def __init__(
        self,
        hub: Hub,
        sessions: Sessions,
        desks: ControllerRegistry | None,
        plan: RecordingOptions,
        packer: CompactionWorker | None,
        wall_ns: Callable[[], int] | None = None,
    ) -> None:
        self.plan = plan
        self._wall_ns = wall_ns
        self._hub = hub
        self._sessions = sessions
        self._desks = desks
        self._packer = packer
        self._now: RecordingSession | None = None
        self._last = wire.RecorderState(running=False)
        self._watcher: asyncio.Task[None] | None = None
        self._starting = asyncio.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        sessions.on_added(self._appeared)

    # ── the button ───────────────────────────────────────────────────────────────────────────────────────────────────

    async def start(
        self, devices: Sequence[str] | None = None, title: str = "", *, path: Path | None = None, words: str = ""
    ) -> wire.RecorderState:
        """Begin.

        Args:
            devices: ids; None for all, also those that appear later.
            title: what a person calls it; may be empty.
            path: of the file, where it is not to be in the folder under a name of its own.
            words: what the file is called after; the title or the devices that were heard where they are left out.
        Raises:
            RecorderError: something is being recorded already, or there is no such device.
            RecordingError: the file cannot be made.
        """
        async with self._starting:
            if self._now is not None:
                raise RecorderError("busy", "A recording is running already.", "Stop it first.")
            chosen = self._chosen(devices)
            heard = [session for session in chosen if session.info.last_arrival is not None] or chosen
            words = words or title or _words([session.info.name for session in heard])
            self._loop = asyncio.get_running_loop()
            tape = await asyncio.to_thread(self._tape, words, title, path)
            every = devices is None
            now = RecordingSession(self._hub, self._desks, tape, title, every=every, ask_head=self.plan.ask_head)
            self._now = now
            for session in self._sessions.all if every else chosen:
                now.join(session)
            self._watcher = asyncio.get_running_loop().create_task(self._watch(now), name="recorder")
            self._tell()
            self._hub.library_changed()
            return self.state

    async def begin(self, sources: Sequence[str]) -> None:
        """Record all from the start of the server, before its sources are opened; where that cannot be, say so."""
        try:
            await self.start(words=_words([short_source(source) for source in sources]))
        except RecordingError as error:
            self._last = wire.RecorderState(running=False, message=error.message, hint=error.hint)
            self._hub.set_recorder(self._last)
            words = f"Nothing is recorded: {error.message}"
            log.error("%s %s", words, error.hint)
            self._hub.event("", "device", "fault", words, data={"hint": error.hint})

    async def stop(self) -> wire.RecorderState:
        """End it; the file is whole when this returns.

        Raises:
            RecorderError: nothing is being recorded.
        """
        now = self._now
        if now is None:
            raise RecorderError("not-now", "Nothing is being recorded.", "Begin a recording first.")
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
        now.mark(mark)
        return self.state

    def now(self) -> float:
        """Unix s that never step."""
        return self._hub.now()

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
            devices=now.devices,
            started=now.started,
            bytes=now.tape.bytes,
            behind_s=now.tape.behind_s,
            free=free,
            seconds_left=now.seconds_left(free),
        )

    @property
    def path(self) -> Path | None:
        """The file that is being written, which nobody may touch; None while there is none."""
        return self._now.tape.path if self._now is not None else None

    async def resume(self) -> None:
        """Pack what was left behind by the server before this one."""
        if self._packer is not None:
            await self._packer.resume(self.plan.folder, self.path)

    async def close(self) -> None:
        """The server ends: so does the recording. Nothing is packed any more, that is for the next start."""
        if self._packer is not None:
            await self._packer.close()
        if self._now is not None:
            await self._end(self._now)

    # ── begin and end ────────────────────────────────────────────────────────────────────────────────────────────────

    def _chosen(self, devices: Sequence[str] | None) -> list[Session]:
        if devices is None:
            return self._sessions.all
        found: dict[str, Session] = {}
        for device in devices:
            try:
                session = self._sessions.get(device.partition(".")[0])  # one that shares a link is on its first's
            except KeyError:
                raise RecorderError(
                    "not-found",
                    f"There is no device {device:.40}.",
                    "It may have been removed; choose one of the list.",
                ) from None
            found[session.info.id] = session
        if not found:
            raise RecorderError("not-found", "No device was chosen.", "Leave `devices` out to record all.")
        return list(found.values())

    def _tape(self, words: str, title: str, path: Path | None) -> RecordingWriter:
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
        return RecordingWriter(
            name,
            about,
            now_ns,
            self.plan.limits,
            lambda part: self._soon(self._part_done, part),
            lambda text: self._soon(self._notice, text),
            shift_ns=self._shift_ns(),
        )

    def _shift_ns(self) -> int:
        """What the wall clock is ahead of the hub's, where that is more than a slow start or a leap second."""
        shift = self._wall_ns() - round(self._hub.now() * 1e9) if self._wall_ns is not None else 0
        return shift if abs(shift) > SHIFT_NS else 0

    def _soon(self, function: Callable[..., None], *arguments: Any) -> None:
        """Have the event loop call it; from a thread."""
        with contextlib.suppress(RuntimeError):  # it has ended
            if self._loop is not None:
                self._loop.call_soon_threadsafe(function, *arguments)

    async def _end(self, now: RecordingSession, *, why: RecordingError | None = None) -> None:
        """Take everything off, wait for the file."""
        now.leave()
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

    async def _watch(self, now: RecordingSession) -> None:
        looks, shift_ns = 0, now.tape.shift_ns
        while self._now is now:
            await asyncio.sleep(LOOK_S)
            looks += 1
            if not now.tape.running:
                await self._end(now)
                return
            now.look()
            self._tell()
            if abs((shift := self._shift_ns()) - shift_ns) > SHIFT_NS:
                self._clock_was_set(now, shift - shift_ns)
                shift_ns = shift
            if looks % CULL_EVERY == 0 and self.plan.quota_bytes:
                await asyncio.to_thread(self._cull, (now.tape.path,))

    def _cull(self, spare: Sequence[Path]) -> None:
        """In a thread: what has to go so that the folder stays within its quota."""
        if not self.plan.quota_bytes:
            return
        gone = quota.cull(self.plan.folder, self.plan.quota_bytes, spare)
        if gone:
            names = ", ".join(path.stem for path in gone)
            self._soon(self._notice, f"Over the quota, the oldest recordings were deleted: {names}.")

    def _clock_was_set(self, now: RecordingSession, by_ns: int) -> None:
        words = f"The host's clock was set by {by_ns / 1e9:+.1f} s"
        if self.plan.follow_clock:
            now.tape.set_clock(now.tape.shift_ns + by_ns)
            self._notice(f"{words}; the recording continues in a new file, with the new time.")
        else:
            self._notice(f"{words}; the recording keeps the time that it began with.")

    def _notice(self, text: str) -> None:
        self._hub.event("", "device", "caution", text)
        self._hub.library_changed()

    def _tell(self) -> None:
        self._hub.set_recorder(self.state)

    def _appeared(self, session: Session) -> None:
        if self._now is not None and self._now.every:
            self._now.join(session)


def _words(names: Sequence[str]) -> str:
    """The first name, and how many more."""
    more = f"-and-{len(names) - 1}-more" if len(names) > 1 else ""
    return names[0] + more if names else ""


def _free(path: Path) -> int | None:
    try:
        return shutil.disk_usage(path.parent).free
    except OSError:
        return None
