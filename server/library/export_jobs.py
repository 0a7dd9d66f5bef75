"""Exports: jobs that turn recordings into files of other formats, in the background, one after the other.

    add ──> waiting ──> running: a subprocess (server/library/export_worker.py) ──> done: a file for download
                        │ cancel: the process is ended, and its files are deleted

The subprocess has low priority, so that live devices are not affected. Its result is in
`<data>/exports/<run>-<job>/`; several files become one zip. At most `MAX_RESULTS` results are stored, for a day.
They are deleted with the end of the server; those of a killed server are deleted at the first export of a later run
after that day.
"""

import asyncio
import contextlib
import re
import shutil
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.exporters import FORMATS
from imuscope.recordings.file_names import SUFFIX
from imuscope.recordings.library.entry import LibraryEntry
from imuscope.server import wire
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.errors import DomainError
from imuscope.server.library.api_models import ExportJobRequest, ExportSelection, ExportSizes, KeepRequest
from imuscope.server.library.catalogue import Catalogue
from imuscope.server.library.column_cache import ColumnCache
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.system.workers import Worker

FOLDER = "exports"
LAST_DATE = 253_402_300_800.0  # the year 10000
MAX_RESULTS = 50
FREE_SPACE_DIVISOR = 4  # results take at most this part of the space free without them; the newest always stays
KEPT_S = 86_400.0
MAX_WAITING = 20
PROGRESS_INTERVAL_S = 0.25  # between two progress reports
STOP_S = 0.8  # from SIGTERM to SIGKILL; less than the time for a shutdown of the server (server/http/shutdown.py)


@dataclass(frozen=True, slots=True)
class ExportWork:
    """Work of a job.

    Args:
        format, words: as published.
        module: of the subprocess, which writes like server/library/export_worker.py.
        message: its request; `store`, `source`, `title`, `stem` and `out` are added.
        stem, suffix: of the file; several files become one zip.
    """

    format: str
    words: str
    module: str
    message: Mapping[str, Any]
    stem: str
    suffix: str


@dataclass(slots=True)
class _Job:
    published: wire.ExportJob
    work: ExportWork
    folder: Path
    file: Path | None = None
    ended_at: float | None = None  # by the clock of the event loop
    task: asyncio.Task[None] | None = field(default=None, repr=False)


class ExportJobs:
    """Queue of exports, which run one at a time in subprocesses."""

    def __init__(self, bus: TelemetryBus, catalogue: Catalogue, columns: ColumnCache, data: Path) -> None:
        self._bus = bus
        self._catalogue = catalogue
        self._columns = columns
        self._folder = data / FOLDER
        self._jobs: dict[int, _Job] = {}
        self._next = 1
        self._slot = asyncio.Lock()
        self._measuring = asyncio.Lock()
        self._published_at = 0.0

    @property
    def jobs(self) -> list[wire.ExportJob]:
        """All jobs, newest first."""
        return [job.published for job in reversed(self._jobs.values())]

    def add(self, recording: str, request: ExportJobRequest) -> wire.ExportJob:
        """Queue an export; it starts after the earlier ones.

        Raises:
            KeyError: unknown recording.
            DomainError: unknown format, or too many exports are waiting.
        """
        info = self._catalogue.info(recording)
        if request.format not in FORMATS:
            raise DomainError(
                "bad-format", f"Unknown format {request.format:.40}.", f"Available: {', '.join(FORMATS)}."
            )
        stem, suffix = file_stem(info.title, request.t0, request.t1), FORMATS[request.format].suffix
        if any(device.simulated for device in info.devices):
            stem += "-simulated"  # of the formats that have no place for it
        work = ExportWork(
            request.format, _words(request), "imuscope.server.library.export_worker", asdict(request), stem, suffix
        )
        return self.add_work(recording, work)

    def add_work(self, recording: str, work: ExportWork) -> wire.ExportJob:
        """Queue what makes files of a recording; it starts after the earlier ones.

        Raises:
            KeyError: unknown recording.
            DomainError: it is still being recorded, or too many exports are waiting.
        """
        info = self._catalogue.info(recording)
        if info.recording:
            raise DomainError("busy", "The recording is still running.", "Stop the recording first.")
        if sum(job.published.state in ("waiting", "running") for job in self._jobs.values()) >= MAX_WAITING:
            raise DomainError("full", f"The maximum of {MAX_WAITING} exports is waiting.", "Wait, or cancel one.")
        if self._next == 1:
            self._remove_expired()
        number = self._next
        self._next += 1
        published = wire.ExportJob(number, recording, work.format, work.words, "waiting")
        job = self._jobs[number] = _Job(published, work, self._folder / f"{self._bus.run[:8]}-{number}")
        job.task = asyncio.get_running_loop().create_task(self._work(job, info.title), name=f"export {number}")
        self._tidy()
        self._publish()
        return published

    def file(self, number: int) -> Path:
        """Result file of a job.

        Raises:
            KeyError: unknown job.
            DomainError: it is not done.
        """
        job = self._jobs[number]
        if job.file is None or not job.file.is_file():
            raise DomainError("not-now", "This export has no file.", job.published.message or "Wait until it is done.")
        return job.file

    async def sizes(self, recording: str, request: ExportSelection) -> ExportSizes:
        """Estimate sizes of exports by writing samples, in a subprocess.

        Raises:
            KeyError: unknown recording.
            RecordingError: it cannot be opened.
        """
        async with self._measuring:
            await self._columns.opened(recording)
            self._folder.mkdir(parents=True, exist_ok=True)
            inputs = {
                "store": str(self._columns.store_of(recording)),
                "title": recording,
                "folder": str(self._folder),
            }
            worker = await Worker.start("imuscope.server.library.export_sizes")
            try:
                worker.request({**inputs, **asdict(request)})
                answers = [answer async for answer in worker]
                is_done = await worker.wait() == 0
            finally:
                await worker.end(STOP_S)
        return ExportSizes(**answers[0]) if is_done else ExportSizes()

    async def keep(self, recording: str, request: KeepRequest, user: str = "") -> LibraryEntry:
        """Make a recording of a part of another one (recordings/exporters/kept_range.py), and add it to the library.

        Raises:
            KeyError: unknown recording.
            DomainError: it is still being recorded.
            RecordingError, OSError: it cannot be made.
        """
        if self._catalogue.info(recording).recording:
            raise DomainError("busy", "The recording is still running.", "Stop the recording first.")
        begun = datetime.fromtimestamp(request.t0, UTC).strftime("%Y%m%dT%H%M%SZ")
        stem = f"{begun}-{re.sub(r'^[0-9]{8}T[0-9]{6}Z-?', '', recording) or 'kept'}"
        message = {**asdict(ExportJobRequest("recording", t0=request.t0, t1=request.t1, base=request.base)), "stem": ""}
        work = ExportWork("recording", "", "imuscope.server.library.export_worker", message, stem, SUFFIX)
        path = await asyncio.to_thread(self._catalogue.library.incoming, f"{stem}{SUFFIX}")
        job = _Job(wire.ExportJob(0, recording, "recording", "", "running"), work, path.parent)
        try:
            [made] = await self._written(job, request.title)
            return await self._catalogue.add_upload(made, user)
        finally:
            await asyncio.to_thread(self._catalogue.library.refuse, path)

    async def drop(self, number: int) -> None:
        """Cancel a job, or delete it and its result; KeyError for an unknown job."""
        job = self._jobs[number]
        if job.task is not None and not job.task.done():
            await end_tasks(job.task)
        self._jobs.pop(number, None)
        await asyncio.to_thread(shutil.rmtree, job.folder, ignore_errors=True)
        self._publish()

    async def close(self) -> None:
        """Stop all jobs and delete their files."""
        tasks = [job.task for job in self._jobs.values() if job.task is not None]
        await end_tasks(*tasks)
        for job in self._jobs.values():
            await asyncio.to_thread(shutil.rmtree, job.folder, ignore_errors=True)

    # ── one job ──────────────────────────────────────────────────────────────────────────────────────────────────────

    async def _work(self, job: _Job, title: str) -> None:
        published = job.published
        try:
            async with self._slot:
                published.state = "running"
                self._publish()
                files = await self._written(job, title)
                job.file = files[0]
                published.state, published.progress, published.size = "done", 1.0, job.file.stat().st_size
                published.file = job.file.name
                self._make_room()
        except asyncio.CancelledError:
            published.state = "cancelled"
            shutil.rmtree(job.folder, ignore_errors=True)
            raise
        except RecordingError as error:
            published.state, published.message, published.hint = "failed", error.message, error.hint
        except KeyError:
            published.state, published.message = "failed", "The recording no longer exists."
        except OSError as error:
            published.state, published.message = (
                "failed",
                f"It cannot be written: {(error.strerror or 'it failed').lower()}.",
            )
            published.hint = "Free some space, or export a shorter time range."
        finally:
            loop = asyncio.get_running_loop()
            job.ended_at = loop.time()
            loop.call_later(KEPT_S + 1, self._expire)
            if published.state == "failed":
                shutil.rmtree(job.folder, ignore_errors=True)
            self._publish()

    async def _written(self, job: _Job, title: str) -> list[Path]:
        """Write the export; again if the server has compacted the recording since the first attempt began."""
        recording = job.published.recording
        for attempts_left in (2, 1, 0):
            await self._columns.opened(recording)
            store = self._columns.store_of(recording)
            try:
                return await self._run(job, title)
            except RecordingError:
                if not attempts_left or self._columns.store_of(recording) == store:
                    raise
            await asyncio.to_thread(shutil.rmtree, job.folder, ignore_errors=True)
        raise AssertionError("the last attempt returns or raises")

    async def _run(self, job: _Job, title: str) -> list[Path]:
        """Write the export in a subprocess."""
        job.folder.mkdir(parents=True, exist_ok=True)
        recording = job.published.recording
        worker_request = {
            **job.work.message,
            "store": str(self._columns.store_of(recording)),
            "source": str(self._catalogue.library.known_path(recording)),
            "title": title,
            "stem": f"{job.work.stem}-{job.work.format}",
            "out": str(job.folder / f"{job.work.stem}{job.work.suffix}"),
        }
        worker = await Worker.start(job.work.module)
        try:
            worker.request(worker_request)
            return await self._follow(worker, job)
        finally:
            await worker.end(STOP_S)

    async def _follow(self, worker: Worker, job: _Job) -> list[Path]:
        files: list[Path] | None = None
        async for published in worker:  # until the end of its output, when the process has ended by itself
            files = [Path(file) for file in published["files"]] if "files" in published else files
            job.published.progress = published.get("progress", job.published.progress)
            if time.monotonic() >= self._published_at + PROGRESS_INTERVAL_S:
                self._publish()
        if files is None or await worker.wait() != 0:
            raise RecordingError("The export failed.", "The log has details.")
        return files

    # ── all jobs ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def _publish(self) -> None:
        self._published_at = time.monotonic()
        self._bus.exports.publish(wire.Exports(self.jobs))

    def _remove_expired(self) -> None:
        """Remove exports of previous runs."""
        with contextlib.suppress(OSError):
            for folder in self._folder.iterdir():
                if time.time() - folder.stat().st_mtime > KEPT_S:
                    shutil.rmtree(folder, ignore_errors=True)

    def _expire(self) -> None:
        self._tidy()
        self._publish()

    def _tidy(self) -> None:
        over = [(job, job.ended_at) for job in self._jobs.values() if job.ended_at is not None]
        late = asyncio.get_running_loop().time() - KEPT_S
        too_many = len(over) - MAX_RESULTS
        for job in [job for place, (job, ended_at) in enumerate(over) if place < too_many or ended_at < late]:
            self._forget(job)

    def _make_room(self) -> None:
        """Delete the oldest results until the rest leaves enough space for recordings."""
        results = [job for job in self._jobs.values() if job.published.state == "done"]
        total = sum(job.published.size for job in results)
        room = (shutil.disk_usage(self._folder).free + total) // FREE_SPACE_DIVISOR
        for job in results[:-1]:
            if total <= room:
                return
            total -= job.published.size
            self._forget(job)

    def _forget(self, job: _Job) -> None:
        if self._jobs.pop(job.published.id, None) is not None:
            shutil.rmtree(job.folder, ignore_errors=True)


def file_stem(title: str, t0: float | None, t1: float | None) -> str:
    """File name from a title, and for a part its range: run-20260101T120000Z-20260101T120130Z."""
    plain = "".join(c if c.isalnum() or c in "._-" else "-" for c in title)
    stem = plain.encode()[:80].decode(errors="ignore").strip("-.") or "recording"
    within = (t if t is not None and 0 <= t < LAST_DATE else None for t in (t0, t1))  # as far as the calendar goes
    ends = [datetime.fromtimestamp(t, UTC).strftime("%Y%m%dT%H%M%SZ") if t is not None else "" for t in within]
    return f"{stem}-{ends[0] or 'begin'}-{ends[1] or 'end'}" if any(ends) else stem


def _words(request: ExportJobRequest) -> str:
    parts = [FORMATS[request.format].title]
    if request.t0 is not None and request.t1 is not None:
        parts.append(f"{request.t1 - request.t0:.3f} s")
    elif request.t0 is not None or request.t1 is not None:
        parts.append("a part")
    if request.channels is not None:
        parts.append(f"{len(request.channels)} channel{'s' * (len(request.channels) != 1)}")
    return ", ".join(parts)
