"""Cache of decoded recordings. A recording is decoded once, in a subprocess, and its columns are stored until something
changes.

    open(id) ── columns there? ──> ColumnStore                      milliseconds, whatever the length
                └─ no ──> a subprocess decodes ──> progress 0..1, and the part decoded so far ──> ColumnStore

Decoding an hour takes seconds of a core, so it runs in a subprocess: live devices are not affected, nor is the server
by a crash of a decoder. The process takes a second to start; while the library is viewed it is started in advance
(`prepare`). The name of a store is derived from all of its inputs (the file's name, size and time, the decoder's
sources, the decode options, the choices on how the recording is read): stale stores are never found. Before another
recording is decoded, those are deleted whose recording is gone, has changed or is read otherwise, and then the least
recently used, until the rest takes no more than its share of the disk: a robot that records all the time, with a quota,
would otherwise fill it with columns of what it has deleted.
"""

import asyncio
import contextlib
import hashlib
import json
import os
import shutil
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from imuscope.recordings.columns.store import VERSION, ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.sidecar import stored_reading
from imuscope.recordings.system.resource_limits import seconds_for
from imuscope.recordings.tables.options import FileReading
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.library.cache_provenance import CHANGED, is_stale
from imuscope.server.library.decoder_fingerprint import decoding_mark
from imuscope.server.library.foreign_files import MALICIOUS
from imuscope.server.system.workers import Worker

KEPT_OPEN = 16
MAX_DECODING = (
    2  # recordings decoded at a time: each may use a large part of the memory (recordings/system/resource_limits.py)
)
CACHE_BYTES = 20 << 30
SHARE_OF_DISK = 4  # the cache takes at most one part in so many of what the disk has besides
WAIT_SHARE = 5  # opening may take so many times the processor time that it may take
OPEN_ATTEMPTS = 3  # a file may be compacted, and so replaced, while it is opened
SPARE_S = 120.0  # lifetime of a process started in advance
FAILED_FOR_S = 5.0  # an error is returned again for this long before another attempt
CACHE = "cache"
OPENER = "imuscope.server.library.decode_worker"


@dataclass(slots=True)
class DecodeJob:
    """A recording that is being decoded; `partial`: the part decoded so far, if it can be read."""

    path: Path
    progress: float = 0.0
    partial: ColumnStore | None = None
    error: RecordingError | None = None
    task: asyncio.Task[None] | None = None
    failed_at: float = 0.0

    @property
    def is_current(self) -> bool:
        """Whether it runs, or failed a moment ago; one that is done has left its columns, unless they were deleted."""
        if self.task is not None:
            return not self.task.done()
        return self.error is not None and time.monotonic() - self.failed_at <= FAILED_FOR_S


class ColumnCache:
    """The opened recordings of one data folder.

    Args:
        data: the data folder.
        path_of: file of a recording's id; KeyError for an unknown id.
        usual: decode options for recordings without their own, as texts for another process.
    """

    def __init__(
        self,
        data: Path,
        path_of: Callable[[str], Path],
        usual: DecodeOptions = DecodeOptions(),  # noqa: B008 - frozen
    ) -> None:
        self._cache = data / CACHE / "columns"
        self._path_of = path_of
        self._usual = dict(usual.values)
        self._open: OrderedDict[Path, ColumnStore] = OrderedDict()
        self._opening: dict[Path, DecodeJob] = {}
        self._slots = asyncio.Semaphore(MAX_DECODING)
        self._spare: Worker | None = None
        self._spare_ends: asyncio.TimerHandle | None = None
        self._preparing = False

    def warm(self) -> None:
        """Compute the inputs that all names of stores depend on."""
        decoding_mark()

    def store_of(self, recording: str) -> Path:
        """The folder for the columns of a recording, which may not exist yet.

        Raises:
            KeyError: unknown recording.
        """
        path = self._path_of(recording)
        stamp = path.stat()
        stored = stored_reading(path)
        how = json.dumps([self._usual, stored.as_json()] if stored else self._usual, sort_keys=True)
        key = (path.name, stamp.st_size, stamp.st_mtime_ns, VERSION, decoding_mark(), how)
        return self._cache / hashlib.sha256(repr(key).encode()).hexdigest()[:24]

    def cached(self, recording: str) -> ColumnStore | None:
        return self._columns(self.store_of(recording))

    def open(self, recording: str) -> ColumnStore | DecodeJob:
        """The columns, or the job that decodes them, which is started by this call.

        Raises:
            KeyError: unknown recording.
        """
        store = self.store_of(recording)
        columns = self._columns(store)
        if columns is not None:
            return columns
        self._opening = {one: job for one, job in self._opening.items() if job.is_current}
        opening = self._opening.get(store)
        if opening is None:
            opening = self._opening[store] = DecodeJob(self._path_of(recording))
            work = self._decode(recording, store, opening)
            opening.task = asyncio.get_running_loop().create_task(work, name=f"opening {recording}")
        return opening

    async def opened(self, recording: str) -> ColumnStore:
        """The columns; waits until they are decoded.

        Raises:
            KeyError: unknown recording.
            RecordingError: it cannot be opened.
        """
        for _ in range(OPEN_ATTEMPTS):
            store = self.open(recording)
            if isinstance(store, ColumnStore):
                return store
            if store.task is not None:
                await asyncio.wait({store.task})
            if store.error is not None:
                raise store.error
            columns = self.cached(recording)
            if columns is not None:
                return columns
        raise RecordingError(*CHANGED)

    async def partial_or_wait(self, recording: str) -> ColumnStore:
        """The columns, or the part decoded so far. Raises as `opened`."""
        columns = self.open(recording)
        if isinstance(columns, DecodeJob) and columns.partial is not None and columns.error is None:
            return columns.partial
        return await self.opened(recording)

    async def prepare(self) -> None:
        """Start a process in advance for a recording that may be opened soon."""
        if self._spare is None and not self._preparing:
            self._preparing = True
            try:
                self._spare = await Worker.start(OPENER)
            finally:
                self._preparing = False
        if self._spare_ends is not None:
            self._spare_ends.cancel()
        self._spare_ends = asyncio.get_running_loop().call_later(SPARE_S, self._dismiss)

    def _dismiss(self) -> None:
        """Dismiss the spare process; it ends when its input is closed."""
        if self._spare is not None:
            self._spare.dismiss()
        self._spare = None

    async def _take_worker(self) -> Worker:
        """The spare process, or a new one."""
        if self._spare_ends is not None:
            self._spare_ends.cancel()
        spare, self._spare = self._spare, None
        if spare is not None and spare.is_running:
            return spare
        return await Worker.start(OPENER)

    async def close(self) -> None:
        """Stop all decoding."""
        if self._spare_ends is not None:
            self._spare_ends.cancel()
        spare, self._spare = self._spare, None
        if spare is not None:
            await spare.end()
        tasks = [opening.task for opening in self._opening.values() if opening.task is not None]
        await end_tasks(*tasks)

    def _columns(self, store: Path) -> ColumnStore | None:
        columns = self._open.get(store)
        if columns is None:
            try:
                columns = ColumnStore(store)
            except (OSError, ValueError, KeyError):
                return None
            self._open[store] = columns
            self._opening.pop(store, None)
            with contextlib.suppress(OSError):
                os.utime(store)  # time of last use
        self._open.move_to_end(store)
        while len(self._open) > KEPT_OPEN:
            self._open.popitem(last=False)
        return columns

    async def _decode(self, recording: str, store: Path, opening: DecodeJob) -> None:
        try:
            self._cache.mkdir(parents=True, exist_ok=True)
            for gone in await asyncio.to_thread(_sweep, self._cache, CACHE_BYTES):
                self._open.pop(gone, None)  # its mapped files would keep their place on the disk
            async with self._slots:
                await self._run(recording, store, opening)
        except RecordingError as error:
            opening.error, opening.failed_at = error, time.monotonic()
        except asyncio.CancelledError:
            opening.error, opening.failed_at, opening.task = RecordingError(*CHANGED), time.monotonic(), None
            raise
        except KeyError:  # it was deleted while it waited; it may be restored
            opening.error, opening.failed_at = RecordingError(*CHANGED), time.monotonic()
        except OSError as error:
            words = (error.strerror or "it cannot be written").lower()
            hint = "Free some space, or choose another folder with --data."
            opening.error = RecordingError(f"Its columns cannot be stored: {words}.", hint)
            opening.failed_at = time.monotonic()
        opening.task = None

    async def _run(self, recording: str, store: Path, opening: DecodeJob) -> None:
        path = self._path_of(recording)
        request = {"path": str(path), "store": str(store), "reading": self._usual}
        request["chosen"] = (stored_reading(path) or FileReading()).as_json()
        if self.store_of(recording) != store:
            raise RecordingError(*CHANGED)
        worker = await self._take_worker()
        try:
            async with asyncio.timeout(WAIT_SHARE * seconds_for(path.stat().st_size)):
                worker.request(request)
                async for key in worker:
                    if "progress" in key:
                        opening.progress = key["progress"]
                    elif "shown" in key:
                        with contextlib.suppress(OSError, ValueError, KeyError):  # it may be done by now
                            opening.partial = ColumnStore(Path(key["shown"]))
                if await worker.wait() != 0:
                    raise RecordingError("Opening it failed.", "The log has details.")
        except TimeoutError:
            raise RecordingError("Opening the recording takes too long.", MALICIOUS) from None
        finally:
            await worker.end()

    def end_orphans(self) -> None:
        """End the opening of recordings whose files are gone."""
        for opening in self._opening.values():
            if opening.task is not None and not opening.path.exists():
                opening.task.cancel()


def _sweep(cache: Path, most: int) -> list[Path]:
    """Delete stale stores, and the least recently used ones until the rest is within `most` bytes and its share of the
    disk; returns the deleted stores.

    Hidden folders are being made: they are left alone, and vanish or get their name while this looks.
    """
    stores, deleted = [], []
    for folder in cache.iterdir():
        if not folder.name.startswith("."):
            with contextlib.suppress(OSError):  # deleted in the meantime
                size = sum(file.stat().st_size for file in folder.iterdir())
                stores.append((not is_stale(folder), folder.stat().st_mtime, folder, size))
    total = sum(size for *_, size in stores)
    budget = min(most, (shutil.disk_usage(cache).free + total) // SHARE_OF_DISK)
    for is_used, _, folder, size in sorted(stores):
        if is_used and total <= budget:
            break
        shutil.rmtree(folder, ignore_errors=True)
        deleted.append(folder)
        total -= size
    return deleted
