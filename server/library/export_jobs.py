"""Exports: jobs that turn recordings into files of other formats, in the background, one after the other.

    add ──> waiting ──> running: a process of its own (server/library/export_worker.py) ──> done: a file to be fetched
                        │ cancel: the process is ended, and nothing is left

A process of its own and of low priority, because live devices must not feel it. What it made lies under
`<data>/exports/<run>-<job>/`; several files become one zip. Files are kept for a day, and at most `KEPT` of them, and
go with the server; of one that was killed they go when a later one makes its first export after that day.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import shutil
import time
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from recordings.exporters import FORMATS
from recordings.mcap_writer import RecordingError
from server import wire
from server.library.api_models import Export, ExportPart, ExportSizes
from server.library.catalogue import Catalogue
from server.library.column_cache import ColumnCache
from server.library.one_file import one_file
from server.library.worker import Worker
from server.streaming.hub import Hub

log = logging.getLogger("imuscope.exports")

FOLDER = "exports"
LAST_DATE = 253_402_300_800.0  # the year 10000
KEPT = 50
KEPT_S = 86_400.0
MOST_WAITING = 20
TELL_S = 0.25  # between two tellings of progress
PATIENCE_S = 0.8  # from being told to end to being killed; less than a server that ends has (server/shutdown.py)


class ExportsError(Exception):
    """It cannot be done now; kind as in the one shape of errors."""

    def __init__(self, kind: str, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.kind, self.message, self.hint = kind, message, hint


@dataclass(slots=True)
class _Job:
    told: wire.ExportJob
    wish: Export
    folder: Path
    file: Path | None = None
    ended: float = 0.0
    task: asyncio.Task[None] | None = field(default=None, repr=False)


class Exports:
    """All exports of a server."""

    def __init__(self, hub: Hub, catalogue: Catalogue, shelf: ColumnCache, data: Path) -> None:
        self._hub = hub
        self._catalogue = catalogue
        self._shelf = shelf
        self._folder = data / FOLDER
        self._jobs: dict[int, _Job] = {}
        self._next = 1
        self._turn = asyncio.Lock()
        self._measuring = asyncio.Lock()
        self._told_at = 0.0

    @property
    def jobs(self) -> list[wire.ExportJob]:
        """Newest first."""
        return [job.told for job in reversed(self._jobs.values())]

    def add(self, recording: str, wish: Export) -> wire.ExportJob:
        """Begin, as soon as those before it are through.

        Raises:
            KeyError: there is no such recording.
            ExportsError: no such format, or too many wait.
        """
        info = self._catalogue.info(recording)
        if wish.format not in FORMATS:
            raise ExportsError(
                "bad-format", f"{wish.format} cannot be written yet.", f"There are: {', '.join(FORMATS)}."
            )
        if info.recording:
            raise ExportsError("busy", "It is being recorded.", "Stop the recording first.")
        if sum(job.told.state in ("waiting", "running") for job in self._jobs.values()) >= MOST_WAITING:
            raise ExportsError("full", f"{MOST_WAITING} exports are waiting already.", "Wait, or cancel one.")
        if self._next == 1:
            self._sweep()
        number = self._next
        self._next += 1
        told = wire.ExportJob(number, recording, wish.format, _words(wish), "waiting")
        job = self._jobs[number] = _Job(told, wish, self._folder / f"{self._hub.run[:8]}-{number}")
        job.task = asyncio.get_running_loop().create_task(self._work(job, info.title), name=f"export {number}")
        self._tidy()
        self._tell()
        return told

    def file(self, number: int) -> Path:
        """What a job made.

        Raises:
            KeyError: there is no such job.
            ExportsError: it is not done.
        """
        job = self._jobs[number]
        if job.file is None or not job.file.is_file():
            raise ExportsError("not-now", "This export has no file.", job.told.message or "Wait until it is done.")
        return job.file

    async def sizes(self, recording: str, wish: ExportPart) -> ExportSizes:
        """About how large exports of a stretch would be: samples are written, in a process of its own.

        Raises:
            KeyError: there is no such recording.
            RecordingError: it cannot be opened.
        """
        async with self._measuring:
            await self._shelf.opened(recording)
            self._folder.mkdir(parents=True, exist_ok=True)
            told = {"store": str(self._shelf.store_of(recording)), "title": recording, "folder": str(self._folder)}
            worker = await Worker.start("server.library.export_sizes")
            try:
                worker.ask({**told, **asdict(wish)})
                answers = [answer async for answer in worker]
                is_done = await worker.wait() == 0
            finally:
                await worker.end(PATIENCE_S)
        return ExportSizes(**answers[0]) if is_done else ExportSizes()

    async def drop(self, number: int) -> None:
        """Cancel it, or forget it and what it made. KeyError: there is no such job."""
        job = self._jobs[number]
        if job.task is not None and not job.task.done():
            job.task.cancel()
            await asyncio.gather(job.task, return_exceptions=True)
        self._jobs.pop(number, None)
        await asyncio.to_thread(shutil.rmtree, job.folder, ignore_errors=True)
        self._tell()

    async def close(self) -> None:
        """End all that runs, and leave nothing."""
        tasks = [job.task for job in self._jobs.values() if job.task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for job in self._jobs.values():
            await asyncio.to_thread(shutil.rmtree, job.folder, ignore_errors=True)

    # ── one job ──────────────────────────────────────────────────────────────────────────────────────────────────────

    async def _work(self, job: _Job, title: str) -> None:
        told = job.told
        try:
            async with self._turn:
                told.state = "running"
                self._tell()
                await self._shelf.opened(told.recording)
                files = await self._run(job, title)
                job.file = await asyncio.to_thread(
                    one_file, files, job.folder, f"{_stem(title, job.wish)}-{told.format}"
                )
                told.state, told.progress, told.size = "done", 1.0, job.file.stat().st_size
                told.file = job.file.name
        except asyncio.CancelledError:
            told.state = "cancelled"
            shutil.rmtree(job.folder, ignore_errors=True)
            raise
        except RecordingError as error:
            told.state, told.message, told.hint = "failed", error.message, error.hint
        except KeyError:
            told.state, told.message = "failed", "The recording is not there any more."
        except OSError as error:
            told.state, told.message = "failed", f"It cannot be written: {(error.strerror or 'it failed').lower()}."
            told.hint = "Free some space, or export a shorter stretch."
        finally:
            job.ended = time.monotonic()
            if told.state == "failed":
                shutil.rmtree(job.folder, ignore_errors=True)
            self._tell()

    async def _run(self, job: _Job, title: str) -> list[Path]:
        """Have a process write it."""
        job.folder.mkdir(parents=True, exist_ok=True)
        recording = job.told.recording
        asked = {
            **asdict(job.wish),
            "store": str(self._shelf.store_of(recording)),
            "source": str(self._catalogue.path(recording)),
            "title": title,
            "out": str(job.folder / f"{_stem(title, job.wish)}{FORMATS[job.wish.format].suffix}"),
        }
        worker = await Worker.start("server.library.export_worker")
        try:
            worker.ask(asked)
            return await self._follow(worker, job)
        finally:
            await worker.end(PATIENCE_S)

    async def _follow(self, worker: Worker, job: _Job) -> list[Path]:
        files: list[Path] | None = None
        async for told in worker:  # to its end: then the process has ended by itself
            files = [Path(file) for file in told["files"]] if "files" in told else files
            job.told.progress = told.get("progress", job.told.progress)
            if time.monotonic() >= self._told_at + TELL_S:
                self._tell()
        if files is None or await worker.wait() != 0:
            raise RecordingError("The export failed.", "The log has details.")
        return files

    # ── all of them ──────────────────────────────────────────────────────────────────────────────────────────────────

    def _tell(self) -> None:
        self._told_at = time.monotonic()
        self._hub.set_exports(wire.Exports(self.jobs))

    def _sweep(self) -> None:
        """What servers before this one left."""
        with contextlib.suppress(OSError):
            for folder in self._folder.iterdir():
                if time.time() - folder.stat().st_mtime > KEPT_S:
                    shutil.rmtree(folder, ignore_errors=True)

    def _tidy(self) -> None:
        """Forget what is old."""
        over = [job for job in self._jobs.values() if job.ended]
        late = time.monotonic() - KEPT_S
        for job in over[: max(0, len(over) - KEPT)] + [job for job in over if job.ended < late]:
            if self._jobs.pop(job.told.id, None) is not None:
                shutil.rmtree(job.folder, ignore_errors=True)


def _stem(title: str, wish: Export) -> str:
    """A file's name out of a title, and where it is a part its ends: run-20260101T120000Z-20260101T120130Z."""
    plain = "".join(c if c.isalnum() or c in "._-" else "-" for c in title)
    stem = plain.encode()[:80].decode(errors="ignore").strip("-.") or "recording"
    ends = [datetime.fromtimestamp(t, UTC).strftime("%Y%m%dT%H%M%SZ") if t is not None else "" for t in _ends(wish)]
    return f"{stem}-{ends[0] or 'begin'}-{ends[1] or 'end'}" if any(ends) else stem


def _ends(wish: Export) -> tuple[float | None, float | None]:
    """The stretch, as far as a calendar has it."""
    t0, t1 = (t if t is not None and 0 <= t < LAST_DATE else None for t in (wish.t0, wish.t1))
    return t0, t1


def _words(wish: Export) -> str:
    """What it is, in words."""
    parts = [FORMATS[wish.format].title]
    if wish.t0 is not None and wish.t1 is not None:
        parts.append(f"{wish.t1 - wish.t0:.3f} s")
    elif wish.t0 is not None or wish.t1 is not None:
        parts.append("a part")
    if wish.channels is not None:
        parts.append(f"{len(wish.channels)} channel{'s' * (len(wish.channels) != 1)}")
    return ", ".join(parts)
