"""Which recordings are open? A recording is decoded once, aside, and its columns are kept until something changes.

    open(id) ── columns there? ──> ColumnStore                      milliseconds, whatever the length
                └─ no ──> a process of its own decodes ──> progress 0..1, and what is there so far ──> ColumnStore

A process of its own, because decoding an hour takes seconds of a core: live devices must not feel it, and a decoder
that falls over takes nothing with it. It takes a second to start; where somebody looks at the library it is started
ahead (`prepare`) and waits for what will be opened. A store is named after everything that it follows from (the file's
name, size and time, the decoder's sources, what a person said about how to read it): what is stale is never found, and
is swept when the folder has grown too large.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import logging
import os
import shutil
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from recordings.column_store import VERSION, ColumnStore
from recordings.mcap_writer import RecordingError
from server.devices.decode_options import DecodeOptions, words_of
from server.library.sources import decoding_mark
from server.library.worker import Worker

log = logging.getLogger("imuscope.shelf")

KEPT_OPEN = 16
AT_ONCE = 2  # decoded at a time: each may take a good part of the machine's memory (recordings/bounds.py)
CACHE_BYTES = 20 << 30
TRIES = 3  # a file may be packed while it is opened: then it is another file
SPARE_S = 120.0  # a process that was started ahead waits so long
FAILED_FOR_S = 5.0  # a file that could not be opened is not tried again at every request
CACHE = "cache"
OPENER = "server.library.decode_worker"


@dataclass(slots=True)
class DecodeJob:
    """A recording that is being decoded; `partial`: what is decoded so far, where that can be read."""

    progress: float = 0.0
    partial: ColumnStore | None = None
    error: RecordingError | None = None
    task: asyncio.Task[None] | None = None
    failed_at: float = 0.0


class ColumnCache:
    """The opened recordings of one data folder.

    Args:
        data: the data folder.
        path_of: file of a recording's id; KeyError when there is none.
        usual: how recordings are read that do not say it themselves, as words for another process.
    """

    def __init__(
        self,
        data: Path,
        path_of: Callable[[str], Path],
        usual: DecodeOptions = DecodeOptions(),  # noqa: B008 - frozen
    ) -> None:
        self._cache = data / CACHE / "columns"
        self._path_of = path_of
        self._usual = words_of(usual)
        self._open: OrderedDict[Path, ColumnStore] = OrderedDict()
        self._opening: dict[Path, DecodeJob] = {}
        self._turns = asyncio.Semaphore(AT_ONCE)
        self._spare: Worker | None = None
        self._spare_ends: asyncio.TimerHandle | None = None
        self._preparing = False

    def warm(self) -> None:
        """Find out what all stores are named after."""
        decoding_mark()

    def store_of(self, recording: str) -> Path:
        """The folder in which the columns of a recording are, or would be.

        Raises:
            KeyError: there is no such recording.
        """
        path = self._path_of(recording)
        stamp = path.stat()
        how = json.dumps(self._usual, sort_keys=True)
        told = (path.name, stamp.st_size, stamp.st_mtime_ns, VERSION, decoding_mark(), how)
        return self._cache / hashlib.sha256(repr(told).encode()).hexdigest()[:24]

    def peek(self, recording: str) -> ColumnStore | None:
        """The columns, if they are there."""
        return self._columns(self.store_of(recording))

    def open(self, recording: str) -> ColumnStore | DecodeJob:
        """The columns, or how far their making is; making begins with this call.

        Raises:
            KeyError: there is no such recording.
        """
        store = self.store_of(recording)
        found = self._columns(store)
        if found is not None:
            return found
        opening = self._opening.get(store)
        if opening is not None and opening.error is not None and time.monotonic() - opening.failed_at > FAILED_FOR_S:
            opening = None
        if opening is None:
            opening = self._opening[store] = DecodeJob()
            work = self._decode(recording, store, opening)
            opening.task = asyncio.get_running_loop().create_task(work, name=f"opening {recording}")
        return opening

    async def opened(self, recording: str) -> ColumnStore:
        """The columns, waited for.

        Raises:
            KeyError: there is no such recording.
            RecordingError: it cannot be opened.
        """
        for _ in range(TRIES):
            found = self.open(recording)
            if isinstance(found, ColumnStore):
                return found
            if found.task is not None:
                await asyncio.shield(found.task)
            if found.error is not None:
                raise found.error
            made = self.peek(recording)
            if made is not None:
                return made
        raise RecordingError("The recording changed while it was opened.", "Open it again.")

    async def so_far(self, recording: str) -> ColumnStore:
        """The columns, or as much of them as is decoded. Raises as `opened` does."""
        found = self.open(recording)
        if isinstance(found, DecodeJob) and found.partial is not None and found.error is None:
            return found.partial
        return await self.opened(recording)

    async def prepare(self) -> None:
        """Somebody may open something soon: have a process ready for it, for a while."""
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
        """Let the process go that waits for nothing: it ends when there is no wish to come."""
        if self._spare is not None:
            self._spare.dismiss()
        self._spare = None

    async def _taken(self) -> Worker:
        """A process that waits for a wish."""
        if self._spare_ends is not None:
            self._spare_ends.cancel()
        spare, self._spare = self._spare, None
        if spare is not None and spare.is_running:
            return spare
        return await Worker.start(OPENER)

    async def close(self) -> None:
        """Stop what is being decoded."""
        if self._spare_ends is not None:
            self._spare_ends.cancel()
        spare, self._spare = self._spare, None
        if spare is not None:
            await spare.end()
        tasks = [opening.task for opening in self._opening.values() if opening.task is not None]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _columns(self, store: Path) -> ColumnStore | None:
        found = self._open.get(store)
        if found is None:
            try:
                found = ColumnStore(store)
            except (OSError, ValueError, KeyError):
                return None
            self._open[store] = found
            self._opening.pop(store, None)
            with contextlib.suppress(OSError):
                os.utime(store)  # when it was last used
        self._open.move_to_end(store)
        while len(self._open) > KEPT_OPEN:
            self._open.popitem(last=False)
        return found

    async def _decode(self, recording: str, store: Path, opening: DecodeJob) -> None:
        try:
            self._cache.mkdir(parents=True, exist_ok=True)
            await asyncio.to_thread(_sweep, self._cache, CACHE_BYTES)
            async with self._turns:
                await self._run(recording, store, opening)
        except RecordingError as error:
            opening.error, opening.failed_at = error, time.monotonic()
        except OSError as error:
            words = (error.strerror or "it cannot be written").lower()
            hint = "Free some space, or choose another folder with --data."
            opening.error = RecordingError(f"Its columns cannot be kept: {words}.", hint)
            opening.failed_at = time.monotonic()
        opening.task = None

    async def _run(self, recording: str, store: Path, opening: DecodeJob) -> None:
        wish = {"path": str(self._path_of(recording)), "store": str(store), "reading": self._usual}
        worker = await self._taken()
        try:
            worker.ask(wish)
            async for told in worker:
                if "progress" in told:
                    opening.progress = told["progress"]
                elif "shown" in told:
                    with contextlib.suppress(OSError, ValueError, KeyError):  # it may be done by now
                        opening.partial = ColumnStore(Path(told["shown"]))
            if await worker.wait() != 0:
                raise RecordingError("Opening it failed.", "The log has details.")
        finally:
            await worker.end()


def _sweep(cache: Path, budget: int) -> None:
    """Delete what was not used for longest until the rest is within the budget."""
    stores = [(folder.stat().st_mtime, folder) for folder in cache.iterdir() if folder.is_dir()]
    sizes = {folder: sum(file.stat().st_size for file in folder.iterdir()) for _, folder in stores}
    total = sum(sizes.values())
    for _, folder in sorted(stores):
        if total <= budget:
            return
        shutil.rmtree(folder, ignore_errors=True)
        total -= sizes[folder]
