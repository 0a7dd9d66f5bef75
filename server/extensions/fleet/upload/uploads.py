"""Uploads of finished recordings to the store (`[store] upload = true`, off by default).

    library ─> finished? ─> refusal ─> upload_worker.py, one at a time ─> upload_log.py: stored, or refused
                                                  └─ the store fails: again, after a growing pause

An upload may be killed at any moment, with the server or without: pending recordings are found again in the library,
and an upload of a stored recording adds nothing (upload.py).

With `keep_days` or `keep_gb`, recordings that the store has move to the bin, one at a time (`next_to_go`): right
before, the store's object is read and compared by its checksum.
"""

import asyncio
import contextlib
import logging
import time
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from imuscope.recordings import sidecar
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.library.entry import LibraryEntry
from imuscope.recordings.system import file_lock
from imuscope.server.concurrency.backoff import Backoff
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.extensions.fleet.model.settings import FleetTables, StoreSettings, hours_of
from imuscope.server.extensions.fleet.robot.robot_settings import robot_name
from imuscope.server.extensions.fleet.upload.upload_log import UploadLog, UploadOutcome
from imuscope.server.library.catalogue import Catalogue
from imuscope.server.library.compaction_worker import CompactionWorker
from imuscope.server.settings.config import Config
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.system.workers import Worker
from imuscope.server.text.prometheus import PrometheusText

log = logging.getLogger("imuscope.uploads")

CHECK_S = 10.0  # between two checks of the library, unless it reports a change
SETTLED_S = 5.0  # a file that changed later may still be copied into the folder
FIRST_PAUSE_S, LONGEST_PAUSE_S = 5.0, 900.0
MAX_CRASHES = 3
DOUBT_S = 3600.0  # pause of deletion after the store did not confirm a recording
# of the quota: share at which the backlog is reported, and below which it is reported again
WARN_SHARE, AGAIN_SHARE = 0.8, 0.6
FOLDER = "uploading"  # temporary files of the worker process
DAY_S = 86_400.0
ALARM_TITLE, ALARM_MARKER = "Alarm ", "Alarm “"  # as server/extensions/alarms/recording_trigger.py writes them

UploadState = Literal["waiting", "uploading", "stored", "refused"]


def refusal(entry: LibraryEntry, settings: StoreSettings) -> str:
    """Reason against an upload, one sentence; "" if there is none."""
    tags = {tag.casefold() for tag in entry.edits.tags or ()}
    if matches := [tag for tag in settings.skip_tags if tag.casefold() in tags]:
        return f"It has the tag {matches[0]}."
    if settings.upload_tags and not tags & {tag.casefold() for tag in settings.upload_tags}:
        return f"It has none of the tags {', '.join(settings.upload_tags)}."
    duration = entry.probe.duration
    if duration is not None and duration < settings.upload_min_s:
        return f"It is shorter than {settings.upload_min_s:g} s."
    if settings.upload_max_mb and entry.size > settings.upload_max_mb * 1e6:
        return f"It is larger than {settings.upload_max_mb:g} MB."
    if settings.upload_alarms_only and not _is_of_alarm(entry):
        return "No alarm has begun or marked it."
    return ""


def pause_until(settings: StoreSettings, now: datetime) -> str:
    """Time of day until which uploads wait, "22:00"; "" if they need not."""
    hours = hours_of(settings.upload_hours)
    if hours is None:
        return ""
    begin, end = hours
    minute = now.hour * 60 + now.minute
    is_within = begin <= minute < end if begin < end else minute >= begin or minute < end
    return "" if is_within else f"{begin // 60:02}:{begin % 60:02}"


def _is_of_alarm(entry: LibraryEntry) -> bool:
    return entry.probe.title.startswith(ALARM_TITLE) or any(
        text.startswith(ALARM_MARKER) for text in entry.marker_texts
    )


def edits_of(entry: LibraryEntry) -> int:
    """Time of change of a recording's sidecar, ns; 0 if it has none."""
    try:
        return sidecar.sidecar_path(entry.path).stat().st_mtime_ns
    except OSError:
        return 0


def next_to_go(
    entries: Collection[LibraryEntry],
    outcome_of: Callable[[LibraryEntry], UploadOutcome | None],
    settings: StoreSettings,
    now: float,
    played: Collection[str] = (),
) -> LibraryEntry | None:
    """The oldest recording that the rules allow to delete; None if there is none. It reads sidecars: call it in a
    thread.

    It is one made by imuscope (MCAP) that the store has with all its words: one that was edited after its upload, is
    pinned, has one of `keep_tags`, or is played as a device, stays.

    Args:
        played: sources of devices; a recording that is one of them stays.
    """
    excess = sum(entry.size for entry in entries) - settings.keep_gb * 1e9 if settings.keep_gb else 0.0
    protected_tags = {tag.casefold() for tag in settings.keep_tags}
    for entry in sorted(entries, key=lambda one: one.began):
        outcome = outcome_of(entry)
        if outcome is None or outcome.state != "stored":
            continue
        is_old = settings.keep_days > 0 and now - outcome.time >= settings.keep_days * DAY_S
        if not is_old and excess <= 0:
            continue
        is_ours = entry.probe.format == "mcap" and len(entry.files) == 1
        has_tag = bool(protected_tags & {tag.casefold() for tag in entry.edits.tags or ()})
        is_played = any(source.partition("?")[0] == str(entry.path) for source in played)
        if not is_ours or has_tag or is_played or entry.edits.pinned or edits_of(entry) != outcome.edits:
            continue
        return entry
    return None


@dataclass(frozen=True, slots=True)
class RecordingUpload:
    """Upload of a recording.

    Args:
        id: of the recording in the library.
        reason: why it waits or is refused, one sentence; "" if it is simply next.
        progress: 0..1; 1 when it is stored.
        recording, object, checksum: in the store: identifier, key, SHA-256.
        stored_at: unix s; null before.
    """

    id: str
    state: UploadState
    reason: str = ""
    progress: float = 0.0
    recording: str = ""
    object: str = ""
    checksum: str = ""
    stored_at: float | None = None


class UploadService:
    """Uploads of one server. To be used in its event loop.

    Raises:
        FleetSettingsError: the name of the robot is not valid.
    """

    def __init__(self, config: Config, catalogue: Catalogue, compactor: CompactionWorker, bus: TelemetryBus) -> None:
        self.settings = config.of(FleetTables).store
        self.robot = robot_name(config.of(FleetTables).fleet) if self.settings.upload else ""
        self.problem = ""  # of the last attempt, if the store failed
        self._config = config
        self._catalogue, self._compactor, self._bus = catalogue, compactor, bus
        self._log = UploadLog(config.data, self.settings.url, self.robot)
        self._backoff = Backoff(FIRST_PAUSE_S, LONGEST_PAUSE_S)
        self._changed = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._current, self._progress = "", 0.0
        self._failures: Counter[str] = Counter()
        self._crashes: Counter[str] = Counter()
        self._failed = 0
        self._doubt_until = float("-inf")
        self._states: Counter[str] = Counter()
        self._backlog_reported = False

    @property
    def is_enabled(self) -> bool:
        return self.settings.upload

    def start(self) -> None:
        """Begin in the background, if configured."""
        if self.is_enabled:
            self._bus.library.subscribe(lambda _: self._changed.set())
            self._task = asyncio.get_running_loop().create_task(self._work(), name="uploads")

    async def close(self) -> None:
        """Stop. An upload that runs is ended, and repeated after the next start."""
        await end_tasks(self._task)

    async def uploads(self) -> list[RecordingUpload]:
        """State of each finished recording, in the order of the library."""
        return [self._state_of(entry) for entry in await self._finished()] if self.is_enabled else []

    def add_metrics(self, page: PrometheusText) -> None:
        """Add the families of uploads."""
        if not self.is_enabled:
            return
        page.family("imuscope_uploads", "gauge", "Recordings, by state of their upload to the store.")
        for state in ("waiting", "uploading", "stored", "refused"):
            page.add(self._states[state], state=state)
        page.family("imuscope_upload_failures_total", "counter", "Uploads that failed, and are tried again.")
        page.add(self._failed)

    def waiting_paths(self) -> set[Path]:
        """Recordings that are still to be uploaded. For any thread."""
        if not self.is_enabled:
            return set()
        entries = (entry for entry in self._catalogue.library.all() if entry.deleted is None)
        return {entry.path for entry in entries if self._state_of(entry).state in ("waiting", "uploading")}

    def _warn_backlog(self, entries: list[LibraryEntry], states: list[RecordingUpload]) -> None:
        """Warn once when pending uploads occupy most of the quota."""
        most = self._config.recordings_quota_gb * 1e9
        if not most:
            return
        size = sum(
            entry.size for entry, one in zip(entries, states, strict=True) if one.state in ("waiting", "uploading")
        )
        if size >= WARN_SHARE * most and not self._backlog_reported:
            self._backlog_reported = True
            words = (
                f"Recordings that wait for their upload take {size / 1e9:.2g} GB of the quota of {most / 1e9:g} GB. "
                "They are kept beyond it until the disk is short."
            )
            self._bus.event("", "device", "warning", words)
        elif size < AGAIN_SHARE * most:
            self._backlog_reported = False

    # ── in the background ────────────────────────────────────────────────────────────────────────────────────────────

    async def _work(self) -> None:
        await asyncio.to_thread(self._log.load)
        while True:
            self._changed.clear()
            try:
                pause = await self._turn()
            except Exception as error:
                log.exception("uploading failed")
                pause = self._fail(f"{type(error).__name__}: {error}")
            if pause is not None:
                await asyncio.sleep(pause)
                continue
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(CHECK_S):
                    await self._changed.wait()

    async def _turn(self) -> float | None:
        """Upload the next recording.

        Returns:
            pause before the next turn, s; None: until something changes.
        """
        entries = await self._finished()
        self._log.keep_only({entry.path.name for entry in entries})
        states = [self._state_of(entry) for entry in entries]
        self._states = Counter(state.state for state in states)
        self._warn_backlog(entries, states)
        waiting = [entry for entry, state in zip(entries, states, strict=True) if state.state == "waiting"]
        if not waiting or self._compactor.is_busy or pause_until(self.settings, datetime.now()):
            return 0.0 if await self._clean(entries) else None
        now = time.time()
        due = [entry for entry in waiting if now - entry.modified >= SETTLED_S]
        if not due:
            settled_s = min(SETTLED_S - now + entry.modified for entry in waiting)
            return min(max(0.1, settled_s), CHECK_S)  # a clock that was set back made it years
        entry = min(due, key=lambda one: (self._failures[one.path.name], one.began))
        return await self._upload(entry)

    async def _finished(self) -> list[LibraryEntry]:
        entries = await self._catalogue.entries()

        def find() -> list[LibraryEntry]:
            live = (entry for entry in entries if entry.deleted is None)
            return [entry for entry in live if not any(map(file_lock.is_written, entry.files))]

        return [entry for entry in await asyncio.to_thread(find) if not self._catalogue.is_recording(entry)]

    def _state_of(self, entry: LibraryEntry) -> RecordingUpload:
        if entry.path.name == self._current:
            return RecordingUpload(entry.id, "uploading", progress=self._progress)
        end = self._log.of(entry)
        if end is not None:
            stored_at = end.time if end.state == "stored" else None
            return RecordingUpload(
                *(entry.id, end.state, end.reason, float(end.state == "stored")),
                *(end.recording, end.object, end.checksum, stored_at),
            )
        if why := refusal(entry, self.settings):
            return RecordingUpload(entry.id, "refused", why)
        if until := pause_until(self.settings, datetime.now()):
            return RecordingUpload(entry.id, "waiting", f"Uploads begin at {until}.")
        return RecordingUpload(entry.id, "waiting", self.problem or self._delay_of(entry))

    def _delay_of(self, entry: LibraryEntry) -> str:
        """Reason for which a recording waits, as one sentence; "" if it is next."""
        if self._current:
            return "Another recording is being uploaded."
        if self._compactor.is_busy:
            return "Uploads begin when finished recordings are compacted."
        if time.time() - entry.modified < SETTLED_S:
            return f"Its upload begins when the file has not changed for {SETTLED_S:g} s."
        return ""

    async def _upload(self, entry: LibraryEntry) -> float:
        name = entry.path.name
        self._current, self._progress = name, 0.0
        self._states["waiting"] -= 1
        self._states["uploading"] += 1
        edits = await asyncio.to_thread(edits_of, entry)
        try:
            answer = await self._answer_of(entry.path)
        finally:
            self._current = ""
        if not answer:
            self._crashes[name] += 1
            if self._crashes[name] < MAX_CRASHES:
                self._failures[name] += 1
                return self._fail(f"{name}: the process that uploads it ended without an answer.")
            words = f"The process that uploads it ended {MAX_CRASHES} times without an answer: see the server's log."
            answer = {"failed": "file", "words": words}
        if answer.get("failed") == "store":
            self._failures[name] += 1
            return self._fail(answer["words"])
        await self._end(entry, answer, edits)
        return 0.0

    async def _clean(self, entries: list[LibraryEntry]) -> bool:
        """Move the next recording that the rules let go to the bin; returns whether there was one."""
        settings = self.settings
        if not (settings.keep_days or settings.keep_gb) or time.monotonic() < self._doubt_until:
            return False
        played = [info.source for info in self._bus.devices.latest.values()]
        entry = await asyncio.to_thread(next_to_go, entries, self._log.of, settings, time.time(), played)
        outcome = None if entry is None else self._log.of(entry)
        if entry is None or outcome is None:
            return False
        name = entry.path.name
        answer = await self._answer_of(entry.path, recording=outcome.recording, checksum=outcome.checksum)
        if not answer.get("confirmed"):
            self._doubt_until = time.monotonic() + DOUBT_S
            words = answer.get("words", "the process that asks ended without an answer.")
            self._bus.event("", "device", "warning", f"The store does not confirm {name}, which stays: {words}")
            if answer.get("confirmed") is False:
                self._log.remove(entry)  # it is uploaded again
            return False
        try:
            now = await asyncio.to_thread(self._catalogue.library.get, entry.id)
            if self._log.of(now) != outcome or await asyncio.to_thread(edits_of, now) != outcome.edits:
                return False  # it was changed during the upload
            await asyncio.to_thread(self._catalogue.library.delete, entry.id)
        except (KeyError, RecordingError) as error:
            log.warning("%s cannot be moved to the bin: %s", name, error)
            self._doubt_until = time.monotonic() + DOUBT_S
            return False
        self._bus.event("", "device", "info", f"The recording {name} is in the store and was moved to the bin.")
        self._bus.library_changed()
        return True

    async def _answer_of(self, path: Path, **more: str) -> dict[str, Any]:
        """Last message of the worker process for a file; empty if there was none.

        Args:
            more: of the request.
        """
        worker = await Worker.start("imuscope.server.extensions.fleet.upload.upload_worker")
        answer: dict[str, Any] = {}
        try:
            worker.request(
                {
                    "path": str(path),
                    "store": self.settings.url,
                    "rate": self.settings.upload_kb_s * 1000,
                    "robot": self.robot,
                    "options": dict(self._config.reading().values),
                    "folder": str(self._config.data / FOLDER),
                    **more,
                }
            )
            async for message in worker:
                if "progress" in message:
                    self._progress = message["progress"]
                else:
                    answer = message
            await worker.wait()
        finally:
            await worker.end()
        return answer

    async def _end(self, entry: LibraryEntry, answer: dict[str, Any], edits: int) -> None:
        name, now = entry.path.name, time.time()
        self._failures.pop(name, None)
        self._crashes.pop(name, None)
        if "stored" in answer:
            edits = edits if answer["stored"].pop("is_first") else 0  # else the store has the words of another upload
            outcome = UploadOutcome(entry.size, entry.modified, "stored", now, **answer["stored"], edits=edits)
            self._recover()
        else:
            outcome = UploadOutcome(entry.size, entry.modified, "refused", now, reason=answer["words"])
            self._bus.event("", "device", "warning", f"The recording {name} is not uploaded: {outcome.reason}")
        self._log.add(entry, outcome)
        try:
            await asyncio.to_thread(self._log.save)
        except OSError as error:  # after a restart it is checked again
            log.warning("the list of uploads cannot be written: %s", error.strerror)
        self._bus.library_changed()

    def _fail(self, words: str) -> float:
        """Report the first of consecutive failures; returns the retry delay, s."""
        self._failed += 1
        if not self.problem:
            self._bus.event("", "device", "warning", f"Recordings cannot be uploaded at present: {words}")
        self.problem = words
        return self._backoff.next()

    def _recover(self) -> None:
        self._backoff.reset()
        if self.problem:
            self.problem = ""
            self._bus.event("", "device", "info", "Recordings are uploaded again.")
