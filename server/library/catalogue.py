"""The library as the page is told it: the folder's recordings, which are open, which is being recorded, what changed.

    recordings/library.py           what lies in the folder
    server/library/column_cache.py  which of it is decoded   ──> RecordingInfo, and the op `library` on every change
    hub.recorder                    what is being written now

What the list wants to know of a recording beyond its file (motion, losses, counts) is kept when its columns are first
found; one that was recorded here is opened for that as soon as it is packed, and others one after the other while
somebody looks at the library and nothing is recorded. A file that somebody drops into the folder is told of within
`LOOK_S` where somebody watches.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Coroutine
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from starlette.concurrency import run_in_threadpool

from recordings.library import Library, LibraryEntry
from recordings.mcap_writer import RecordingError
from server.library.api_models import Marker, RecordedDevice, RecordingInfo
from server.streaming.hub import Hub

if TYPE_CHECKING:
    from server.library.column_cache import ColumnCache

log = logging.getLogger("imuscope.library")

FOLDER = "recordings"
LOOK_S = 2.0
LOOKED_AT_S = 60.0  # after it was listed somebody is thought to look at the library
MOST_BYTES = 100_000_000  # of a file that is opened only to show its motion: seconds of a core, at low priority


class Catalogue:
    """The library of one server.

    Args:
        data: the data folder.
    Attributes:
        shelf: set when it is there; without one nothing counts as opened.
    """

    def __init__(self, hub: Hub, data: Path) -> None:
        self.library = Library(data / FOLDER)
        self.shelf: ColumnCache | None = None
        self._hub = hub
        self._paths: dict[str, Path] = {}
        self._stamp: object = None
        self._watcher: asyncio.Task[None] | None = None
        self._looking: set[asyncio.Task[None]] = set()
        self._listed = -LOOKED_AT_S
        self._tried: set[tuple[Path, int, float]] = set()

    def path(self, recording: str) -> Path:
        """The file of a recording. KeyError: there is none of that id."""
        known = self._paths.get(recording)
        if known is None or not known.exists():
            known = self._paths[recording] = self.library.path(recording)
        return known

    async def all(self, search: str = "") -> list[RecordingInfo]:
        """Newest first; then those in the bin."""
        entries = await asyncio.to_thread(self.library.all, search)
        self._paths.update({entry.id: entry.path for entry in entries if entry.deleted is None})
        if await self._learn(entries):
            entries = await asyncio.to_thread(self.library.all, search)
        if self.shelf is not None and self._hub.browsers:  # a person looks, and will open one
            self._listed = time.monotonic()
            self._keep(self.shelf.prepare(), "preparing to open")
        return [self.told(entry) for entry in entries]

    def info(self, recording: str) -> RecordingInfo:
        """One of them. KeyError: there is none of that id."""
        return self.told(self.library.get(recording))

    def markers(self, recording: str) -> list[Marker]:
        """Those that were put in later. KeyError: there is none of that id."""
        return [Marker(**asdict(marker)) for marker in self.library.get(recording).edits.markers]

    def told(self, entry: LibraryEntry) -> RecordingInfo:
        """An entry as the API tells it."""
        found, edits = entry.peek, entry.edits
        recording = self.is_recording(entry)
        duration = found.duration
        if recording and found.started is not None:
            now = self._hub.recorder
            duration = max(0.0, self._hub.now() - now.started) if now is not None and now.started is not None else 0.0
        return RecordingInfo(
            id=entry.id,
            title=entry.title,
            file=entry.path.name,
            format=found.format,
            size=entry.size,
            started=found.started,
            duration=duration,
            devices=[RecordedDevice(**asdict(device)) for device in found.devices],
            tags=list(edits.tags or ()),
            notes=edits.notes or "",
            pinned=bool(edits.pinned),
            recording=recording,
            opened=entry.deleted is None and not recording and self._is_open(entry),
            damaged="" if recording else found.damaged,
            markers=entry.markers,
            thumbnail=entry.thumbnail,
            losses=entry.losses,
            deleted=entry.deleted,
        )

    def rename(self, recording: str, name: str) -> LibraryEntry:
        """Give its file another name; what was decoded of it goes on to be found. Raises as Library.rename does."""
        was, before = self.library.get(recording), self._store(recording)
        entry = self.library.rename(recording, name)
        after = self._store(entry.id)
        # What tells a device by its file's name is decoded anew.
        is_same = entry.peek.format == "mcap" and all(one.name != was.path.name for one in was.peek.devices)
        if is_same and before is not None and after is not None:
            with contextlib.suppress(OSError):
                before.rename(after)
        return entry

    def _store(self, recording: str) -> Path | None:
        try:
            return self.shelf.store_of(recording) if self.shelf is not None else None
        except (KeyError, OSError):
            return None

    def is_recording(self, entry: LibraryEntry) -> bool:
        """Is it being written now?"""
        now = self._hub.recorder
        return now is not None and now.running and entry.deleted is None and entry.path.stem == now.id

    def changed(self) -> None:
        """Tell everybody."""
        self._hub.library_changed()

    def finished(self, path: Path) -> None:
        """A recording of ours is packed: open it once, aside, so that the list shows its motion and losses."""
        self.changed()
        if self.shelf is not None:
            self._keep(self._look_at(path.stem), f"looking at {path.name}")

    def _keep(self, work: Coroutine[Any, Any, None], name: str) -> None:
        task = asyncio.get_running_loop().create_task(work, name=name)
        self._looking.add(task)
        task.add_done_callback(self._looking.discard)

    async def _look_at(self, recording: str) -> None:
        assert self.shelf is not None
        try:
            columns = await self.shelf.opened(recording)
            await asyncio.to_thread(self.library.learn, recording, columns)
        except (KeyError, OSError):
            return  # it is gone by now
        except RecordingError as error:
            log.info("%s cannot be opened: %s", recording, error)
            return
        self.changed()

    def _look_into_one(self, entries: list[LibraryEntry]) -> None:
        """The newest of those that nobody opened is opened for the list, unless one is already."""
        busy = self._looking or (self._hub.recorder is not None and self._hub.recorder.running)
        if self.shelf is None or busy or time.monotonic() - self._listed > LOOKED_AT_S:
            return
        for entry in entries:
            mark = (entry.path, entry.size, entry.modified)
            if entry.indexed or entry.deleted is not None or not 0 < entry.size <= MOST_BYTES or mark in self._tried:
                continue
            self._tried.add(mark)
            self._keep(self._look_at(entry.id), f"looking at {entry.path.name}")
            return

    # ── watching ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def start(self) -> None:
        """Begin to look for what comes and goes."""
        self._keep(self._warm(), "warming the library")
        self._watcher = asyncio.get_running_loop().create_task(self._watch(), name="library")

    async def _warm(self) -> None:
        """Have ready what the first look at the library would wait for: 0.1 s of imports, and of reading sources."""
        if self.shelf is not None:
            await run_in_threadpool(self.shelf.warm)  # which also has the threads that routes run in

    async def close(self) -> None:
        """Look no more."""
        tasks = [*self._looking, *([self._watcher] if self._watcher is not None else [])]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(LOOK_S)
            if not self._hub.browsers:
                continue
            try:
                await self._look()
            except Exception:
                log.exception("looking into the library failed")

    async def _look(self) -> None:
        now = self._hub.recorder
        written = now.id if now is not None and now.running else ""
        stamp = await asyncio.to_thread(self.library.stamp, written)
        entries = await asyncio.to_thread(self.library.all)
        learned = await self._learn(entries)
        if learned or (self._stamp is not None and stamp != self._stamp):
            self.changed()
        self._stamp = stamp
        self._look_into_one(entries)

    async def _learn(self, entries: list[LibraryEntry]) -> bool:
        """Keep what is to be known of recordings that were opened since; whether there was one."""
        learned = False
        for entry in entries:
            if entry.indexed or entry.deleted is not None or not self._is_open(entry) or self.shelf is None:
                continue
            columns = self.shelf.peek(entry.id)
            if columns is not None:
                await asyncio.to_thread(self.library.learn, entry.id, columns)
                learned = True
        return learned

    def _is_open(self, entry: LibraryEntry) -> bool:
        store = self._store(entry.id)
        return store is not None and store.is_dir()
