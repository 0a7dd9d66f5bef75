"""Recorder: start, stop and split recordings. One recording at a time, of any number of devices.

    sessions, bus ──RecordingSession──> RecordingWriter (a thread) ──> <data>/recordings/20261121T044324Z-MTi-630.mcap
                                                                  │ finished, or full and split
                                                                  └──> CompactionWorker (a process) ──> small, indexed

Devices that appear later join a recording of all devices. The Configuration of an Xsens device, which the vendor's
program needs at the head of a log, is the one that was received last (server/library/log_header.py). It is requested
only if a user wants that: the device pauses for it, through the queue of its controller
(server/configuration/device_controller.py). A refusal is reported and harmless.

`start(before_s=…)` begins with the bytes that are in memory already (server/devices/link/byte_memory.py), and `save`
writes those alone to a recording of their own, also while another one runs.

A recording continues if a browser or a device disconnects, or a page is busy. A disk error ends it, and `message`
contains the cause; after a full disk the one of `record = true` is resumed (standing_recording.py).
"""

import asyncio
import contextlib
import logging
import math
import platform
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from imuscope.recordings.errors import FULL, RecordingError
from imuscope.recordings.file_names import free_path
from imuscope.recordings.library import quota
from imuscope.recordings.mcap.live_writer import Limits, RecordingWriter
from imuscope.server import wire
from imuscope.server.concurrency.heartbeat import beat
from imuscope.server.configuration.controllers import ControllerRegistry
from imuscope.server.devices.device.device_state import short_source
from imuscope.server.devices.link.byte_memory import ByteMemory
from imuscope.server.devices.link.session import Session
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.errors import DomainError
from imuscope.server.library.api_models import MarkerRequest, SavedMemory
from imuscope.server.library.compaction_worker import CompactionWorker
from imuscope.server.library.recording_session import RecordingSession
from imuscope.server.library.signal_definitions import SignalDefinitions
from imuscope.server.library.standing_recording import StandingRecording
from imuscope.server.settings.config import Config
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.version import VERSION

log = logging.getLogger("imuscope.recorder")

FOLDER = "recordings"  # of the data folder
POLL_S = 0.5  # between two status updates to browsers
CULL_EVERY = 20  # updates
SHIFT_NS = 2_000_000_000  # a larger offset means that the wall clock was set


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """Options for new recordings.

    Args:
        folder: folder of the recordings.
        limits: when a recording continues in a new file.
        quota_bytes: size of the folder above which the oldest unpinned recordings are deleted; 0 for no quota.
        request_header: request the Configuration of an Xsens device.
        follow_clock: continue in a new file when the wall clock is set.
        sync_s: longest time until data is forced to the disk; 0 to leave that to the system.
    """

    folder: Path
    limits: Limits = field(default_factory=Limits)
    quota_bytes: int = 0
    request_header: bool = False
    follow_clock: bool = True
    sync_s: float = 1.0


def plan_of(config: Config) -> RecordingOptions:
    """Recording options from the configuration."""
    limits = Limits(round(config.split_mb * 1e6), config.split_min * 60)
    quota_bytes = round(config.recordings_quota_gb * 1e9)
    return RecordingOptions(config.data / FOLDER, limits, quota_bytes, config.record_head, sync_s=config.sync_s)


class Recorder:
    """Starts, monitors and stops recordings.

    Args:
        controllers: for known settings and for requests to an Xsens device; None without configuration.
        compactor: None: files are not compacted.
        wall_ns: the wall clock. Recordings use its time, because the bus clock never steps and would stay wrong if the
            host's clock was set after the server started.
        memory: of the bytes of live links; None for none.
        signals: definitions of the computed signals, which are recorded with their devices; None for none.
    """

    def __init__(
        self,
        bus: TelemetryBus,
        sessions: Sessions,
        controllers: ControllerRegistry | None,
        plan: RecordingOptions,
        compactor: CompactionWorker | None,
        wall_ns: Callable[[], int] | None = None,
        memory: ByteMemory | None = None,
        signals: SignalDefinitions | None = None,
    ) -> None:
        self.plan = plan
        self.waiting: Callable[[], Collection[Path]] = lambda: ()
        """Recordings to be uploaded first, which the quota deletes only when the disk is short. For any thread."""
        self.pinned_in_file: quota.PinnedInFile = lambda path: True
        self.signals = signals
        self._wall_ns = wall_ns
        self._bus, self.now = bus, bus.now
        self._sessions = sessions
        self._controllers = controllers
        self.compactor = compactor
        self._memory = memory
        self._now: RecordingSession | None = None
        self._last = wire.RecorderState(running=False)
        self._watcher: asyncio.Task[None] | None = None
        self._starting = asyncio.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._standing = StandingRecording(plan.folder, self.start, lambda: self._now is not None, self._report)
        sessions.on_added(self._appeared)

    # ── start and stop ───────────────────────────────────────────────────────────────────────────────────────────────

    async def start(
        self,
        devices: Sequence[str] | None = None,
        title: str = "",
        *,
        path: Path | None = None,
        words: str = "",
        before_s: float = 0.0,
        with_head: bool | None = None,
    ) -> wire.RecorderState:
        """Start a recording.

        Args:
            devices: ids; None for all, including those that appear later.
            title: title given by the user; may be empty.
            path: path of the file, instead of a generated name in the folder.
            words: text for the file name; by default the title or the names of the received devices.
            before_s: begin with the bytes of the last seconds, as far as they are in memory; no byte is lost or
                doubled between them and those that follow.
            with_head: request the Configuration of an Xsens device, which pauses it for about 90 ms; None: as the
                setting `record_head` says.

        Raises:
            DomainError: a recording is running, or a device is unknown.
            RecordingError: the file cannot be created.
        """
        async with self._starting:
            if self._now is not None:
                raise DomainError("busy", "A recording is already running.", "Stop it first.")
            chosen, every = self._chosen(devices), devices is None
            since = self._bus.now() - before_s if before_s else None
            request_header = self.plan.request_header if with_head is None else with_head
            now = await self._new_session(chosen, title, path, words, since, every=every, request_header=request_header)
            self._now = now
            for session in self._sessions.all if every else chosen:
                now.join(session, with_past=True)
            if since is not None:
                now.note_past(await asyncio.to_thread(now.write_past))
            now.follow_links()
            self._watcher = asyncio.get_running_loop().create_task(self._watch(now), name="recorder")
            self._publish()
            self._bus.library_changed()
            return self.state

    async def save(
        self, devices: Sequence[str] | None = None, t0: float | None = None, t1: float | None = None, title: str = ""
    ) -> SavedMemory:
        """Save the bytes in memory as a recording, with what a recording of that time would also have.

        Args:
            devices: ids; None for all.
            t0, t1: only bytes that arrived from t0 on and before t1, unix s; None for no limit.
            title: title given by the user; may be empty.

        Raises:
            DomainError: a device is unknown, or no bytes are in memory.
            RecordingError: the file cannot be written.
        """
        chosen = self._chosen(devices)
        since, until = t0 or 0.0, math.inf if t1 is None else t1
        held = self._held(chosen, since, until)
        if not held:
            raise DomainError(
                "not-found",
                "No bytes of these devices are in memory.",
                "Only bytes received while the server runs are kept, unless bytes_mb is 0 in its configuration.",
            )
        since = max(since, min(held) - 1e-3)  # a float of unix seconds is not exact to the nanosecond
        now = await self._new_session(chosen, title, None, "", since, every=False, request_header=False)
        for session in chosen:
            now.join(session, with_past=True)
        now.detach()  # later bytes are not part of it
        written = await asyncio.to_thread(now.write_past, until)
        await asyncio.to_thread(now.writer.stop)
        if now.writer.error is not None:
            raise now.writer.error
        self._bus.library_changed()
        first, last, size = written or (0, 0, 0)
        return SavedMemory(now.writer.path.stem, now.recorded, first / 1e9, last / 1e9, size)

    def _held(self, sessions: Sequence[Session], since: float, until: float) -> list[float]:
        """Times of the first stored chunk of each link that may have some between two times, unix s."""
        spans = [link.span for one in sessions if self._memory and (link := self._memory.of(one.info.id)) is not None]
        return [span[0] / 1e9 for span in spans if span and span[1] / 1e9 >= since and span[0] / 1e9 < until]

    async def begin(self, sources: Sequence[str]) -> None:
        """Record all devices from the start of the server, before its sources are opened; errors are reported."""
        error = await self._standing.begin(_words([short_source(source) for source in sources]))
        if error is not None:
            hint = self._standing.ended(error) or error.hint
            self._last = wire.RecorderState(running=False, message=error.message, hint=hint)
            self._bus.recorder.publish(self._last)
            words = f"Nothing is recorded: {error.message}"
            log.error("%s %s", words, hint)
            self._report("error", words, hint)

    async def stop(self, only: RecordingSession | None = None) -> wire.RecorderState:
        """Stop recording; the file is complete when this returns.

        Args:
            only: stop nothing but this one, see `current`.

        Raises:
            DomainError: no recording is running.
        """
        async with self._starting:  # the bytes from before its start are written first
            now = self._now
            if only is not None and now is not only:
                return self.state
            if only is None and self._standing.drop() and now is None:
                self._last = wire.RecorderState(running=False)
                self._publish()
                return self.state
            if now is None:
                raise DomainError("not-now", "No recording is running.", "Start a recording first.")
            await self._end(now)
        return self.state

    def mark(self, mark: MarkerRequest) -> wire.RecorderState:
        """Add a marker or a note to the running recording.

        Raises:
            DomainError: no recording is running.
        """
        now = self._now
        if now is None:
            hint = "A marker can be added to a finished recording on its page."
            raise DomainError("not-now", "No recording is running.", hint)
        now.mark(mark)
        return self.state

    @property
    def state(self) -> wire.RecorderState:
        """State as clients see it."""
        now = self._now
        if now is None:
            return self._last
        free = now.free_bytes
        return wire.RecorderState(
            running=True,
            id=now.writer.path.stem,
            title=now.title,
            devices=now.devices,
            started=now.started,
            bytes=now.writer.bytes,
            behind_s=now.writer.behind_s,
            free=free,
            seconds_left=now.seconds_left(free),
            headless=now.headless,
        )

    @property
    def current(self) -> RecordingSession | None:
        """The recording that is running, the same object in all its files; None if there is none."""
        return self._now

    @property
    def path(self) -> Path | None:
        """The file that is being written, which must not be touched; None if there is none."""
        return self._now.writer.path if self._now is not None else None

    async def resume(self) -> None:
        """Compact recordings that a previous run left uncompacted."""
        if self.compactor is not None:
            await self.compactor.resume(self.plan.folder, self.path)

    async def close(self) -> None:
        """Stop the recording at the end of the server; compaction is left to the next start."""
        self._standing.drop()
        if self.compactor is not None:
            await self.compactor.close()
        async with self._starting:
            if self._now is not None:
                await self._end(self._now)

    # ── start and end of a recording ─────────────────────────────────────────────────────────────────────────────────

    def _chosen(self, devices: Sequence[str] | None) -> list[Session]:
        if devices is None:
            return self._sessions.all
        sessions: dict[str, Session] = {}
        for device in devices:
            try:
                session = self._sessions.get(device.partition(".")[0])  # devices on one link share its first session
            except KeyError:
                raise DomainError(
                    "not-found",
                    f"Device {device:.40} not found.",
                    "It may have been removed; choose one of the list.",
                ) from None
            sessions[session.info.id] = session
        if not sessions:
            raise DomainError("not-found", "No device was chosen.", "Leave `devices` out to record all.")
        return list(sessions.values())

    async def _new_session(
        self,
        chosen: Sequence[Session],
        title: str,
        path: Path | None,
        words: str,
        since: float | None,
        *,
        every: bool,
        request_header: bool,
    ) -> RecordingSession:
        """Create the writer and what feeds it. Arguments as for `start`; `since`: its first bytes, unix s."""
        received = [session for session in chosen if session.info.last_arrival is not None] or chosen
        words = words or title or _words([session.info.lasting_name for session in received])
        self._loop = asyncio.get_running_loop()
        before_s = self._bus.now() - since if since is not None else 0.0
        writer = await asyncio.to_thread(self._new_writer, words, title, path, before_s)
        return RecordingSession(
            self._bus,
            self._controllers,
            writer,
            title,
            every=every,
            request_header=request_header,
            memory=self._memory,
            since=since,
            signals=self.signals,
        )

    def _new_writer(self, words: str, title: str, path: Path | None, before_s: float) -> RecordingWriter:
        """Create the writer and its file; runs in a thread."""
        folder = path.parent if path is not None else self.plan.folder
        if path is None:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                words = f"The folder {folder} cannot be created: {error.strerror}."
                raise RecordingError(words, "Choose another with --data.", is_full=error.errno in FULL) from None
            self._delete_oldest([self.path] if self.path is not None else [])

        def name(part: int) -> Path:
            if path is not None and part == 1:
                return path
            begun = time.time() - (before_s if part == 1 else 0)
            return free_path(folder, begun, path.stem if path is not None else words)

        about = {
            "title": title,
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "host": platform.node(),
            "version": VERSION,
        }
        now_ns = lambda: round(self._bus.now() * 1e9)  # noqa: E731
        return RecordingWriter(
            name,
            about,
            now_ns,
            self.plan.limits,
            lambda part: self._soon(self._part_done, part),
            lambda text: self._soon(self._notice, text),
            shift_ns=self._shift_ns(),
            sync_s=self.plan.sync_s,
        )

    def _shift_ns(self) -> int:
        """Offset of the wall clock from the bus clock; 0 if it could be a slow start or a leap second."""
        shift = self._wall_ns() - round(self._bus.now() * 1e9) if self._wall_ns is not None else 0
        return shift if abs(shift) > SHIFT_NS else 0

    def _soon(self, function: Callable[..., None], *arguments: Any) -> None:
        """Schedule a call on the event loop, from a thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            if self._loop is not None:
                self._loop.call_soon_threadsafe(function, *arguments)

    async def _end(self, now: RecordingSession, *, why: RecordingError | None = None) -> None:
        """Detach from all sources, and wait for the file."""
        now.detach()
        await asyncio.to_thread(now.writer.stop)
        if self._now is not now:
            return  # already ended
        why = why or now.writer.error
        last = self.state
        self._now, behind_s = None, last.behind_s
        last.running, last.behind_s, last.seconds_left = False, 0.0, None
        last.message, last.hint = (why.message, why.hint) if why is not None else ("", "")
        self._last = last
        if why is not None:
            last.hint = self._standing.ended(why, behind_s) or why.hint
            self._report("error", f"The recording has ended: {why.message}", last.hint)
        self._bus.recorder.publish(last)
        self._bus.library_changed()
        watcher, self._watcher = self._watcher, None
        if watcher is not None and watcher is not asyncio.current_task():
            watcher.cancel()

    def _part_done(self, path: Path) -> None:
        """Handle a finished file."""
        if self.compactor is not None:
            self.compactor.add(path)
        self._bus.library_changed()

    # ── while it runs ────────────────────────────────────────────────────────────────────────────────────────────────

    async def _watch(self, now: RecordingSession) -> None:
        updates, shift_ns = 0, now.writer.shift_ns
        while self._now is now:
            await beat(POLL_S)
            updates += 1
            if not now.writer.running:
                await self._end(now)
                return
            now.update()
            self._publish()
            if abs((shift := self._shift_ns()) - shift_ns) > SHIFT_NS:
                self._clock_was_set(now, shift - shift_ns)
                shift_ns = shift
            if updates % CULL_EVERY == 0 and self.plan.quota_bytes:
                await asyncio.to_thread(self._delete_oldest, (now.writer.path,))

    def _delete_oldest(self, spare: Sequence[Path]) -> None:
        """Delete recordings above the quota; runs in a thread."""
        if not self.plan.quota_bytes:
            return
        folder, most = self.plan.folder, self.plan.quota_bytes
        if quota.excess_bytes(folder, most) <= 0:
            return
        waiting = self.waiting()
        deleted = quota.cull(folder, most, self.pinned_in_file, [*spare, *waiting])
        if deleted:
            self._soon(self._notice, f"Over the quota, the oldest recordings were deleted: {_stems(deleted)}.")
        lost = quota.cull(folder, most, self.pinned_in_file, spare, only_if_short=True) if waiting else []
        if lost:
            words = f"The disk is short: recordings were deleted before they were uploaded: {_stems(lost)}."
            self._soon(self._notice, words, "error")

    def _clock_was_set(self, now: RecordingSession, by_ns: int) -> None:
        words = f"The host's clock was set by {by_ns / 1e9:+.1f} s"
        if self.plan.follow_clock:
            now.writer.set_clock(now.writer.shift_ns + by_ns)
            self._notice(f"{words}; the recording continues in a new file, with the new time.")
        else:
            self._notice(f"{words}; the recording keeps its original time.")

    def _notice(self, text: str, level: wire.Level = "warning") -> None:
        self._bus.event("", "device", level, text)
        self._bus.library_changed()

    def _report(self, level: wire.Level, text: str, hint: str) -> None:
        self._bus.event("", "device", level, text, data={"hint": hint} if hint else {})

    def _publish(self) -> None:
        self._bus.recorder.publish(self.state)

    def _appeared(self, session: Session) -> None:
        if self._now is not None and self._now.every:
            self._now.join(session)


def _stems(paths: Sequence[Path]) -> str:
    return ", ".join(path.stem for path in paths)


def _words(names: Sequence[str]) -> str:
    """The first name, and the number of further ones."""
    more = f"-and-{len(names) - 1}-more" if len(names) > 1 else ""
    return names[0] + more if names else ""
