"""The library as shown on the page: the folder's recordings, their state, and notification of changes.

    recordings/library/library.py            files in the folder
    server/library/foreign_files.py  their metadata         ──> RecordingInfo, and the op `library` on every change
    server/library/column_cache.py   decoded recordings
    bus.recorder                     the running recording

Information beyond the file (motion, losses, counts) is stored when the columns of a recording are first found. A
recording made here is opened for that as soon as it is compacted; others, and those that only an earlier decoder has
opened, are one after the other while the library is viewed and nothing is recorded. A file copied into the folder is
reported within `CHECK_INTERVAL_S` while the library is viewed.
"""

import asyncio
import contextlib
import logging
import shutil
import time
from collections.abc import Coroutine, Sequence
from pathlib import Path
from typing import Any

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.library.entry import LibraryEntry
from imuscope.recordings.library.index import places
from imuscope.recordings.library.library import Library
from imuscope.recordings.library.recording_probe import TABLE_FORMATS, RecordingProbe
from imuscope.recordings.sidecar import MarkerInfo
from imuscope.server.concurrency.heartbeat import beat
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.library.api_models import LibraryStorage, RecordingInfo
from imuscope.server.library.column_cache import ColumnCache
from imuscope.server.library.foreign_files import ForeignFiles
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.streaming.clients import ClientFanout

log = logging.getLogger("imuscope.library")

CHECK_INTERVAL_S = 2.0
LISTS_EVERY = 15  # checks: a listing reads a file of each recording, and most checks find nothing new
VIEWED_S = 60.0  # after a listing the library counts as viewed
MAX_BYTES = 500_000_000  # of a file opened only for its thumbnail: half a minute of a core, at low priority


class Catalogue:
    """The library of one server.

    Args:
        library: the folder.
        columns: its decoded recordings.
        files: reads their contents.
    """

    def __init__(
        self, bus: TelemetryBus, clients: ClientFanout, library: Library, columns: ColumnCache, files: ForeignFiles
    ) -> None:
        self.library = library
        self.files = files
        self._columns = columns
        self._bus, self._clients = bus, clients
        self._reading = asyncio.Lock()
        self._stamp: object = None
        self._listing: list[LibraryEntry] | None = None  # of an earlier check; None once it may be out of date
        self._checks = 0
        self._watcher: asyncio.Task[None] | None = None
        self._reader: asyncio.Task[None] | None = None
        self._refreshing: set[asyncio.Task[None]] = set()
        self._listed = -VIEWED_S
        self._tried: set[tuple[object, ...]] = set()

    async def all(self, search: str = "") -> list[RecordingInfo]:
        """All recordings, newest first; then those in the bin."""
        entries = await self.entries(search)
        if await self._index(entries):
            entries = await asyncio.to_thread(self.library.all, search)
        if self._clients.browsers:  # the user will probably open one
            self._listed = time.monotonic()
            self._cache(self._columns.prepare(), "preparing to open")
            self._cache(self.files.prepare(), "preparing to read files")
        return await asyncio.to_thread(lambda: [self.to_api(entry) for entry in entries])

    async def entries(self, search: str = "") -> list[LibraryEntry]:
        """As Library.all, after new files have been read."""
        async with self._reading:
            await self._read()
        return await asyncio.to_thread(self.library.all, search)

    async def entry(self, recording: str) -> LibraryEntry:
        """As Library.get, after it has been read, if it is new. KeyError: not found."""
        await self._read(recording)
        return await asyncio.to_thread(self.library.get, recording)

    async def _read(self, recording: str = "") -> None:
        """Read new files, or those of one recording."""
        unread = await asyncio.to_thread(self.library.unread, recording, self._written)
        if not unread:
            return
        probes = await self.files.probe(list(unread))
        tables = [path for path, probe in zip(unread, probes, strict=True) if probe and probe.format in TABLE_FORMATS]
        headings = await self.headings(tables) if self.library.tables else {}
        for (path, stamp), probe in zip(unread.items(), probes, strict=True):
            self.library.learn(path, stamp, probe, headings.get(path, ()))

    async def headings(self, tables: Sequence[Path]) -> dict[Path, list[str]]:
        """Headings of tables; [] for one that has none."""
        headings: dict[Path, list[str]] = {}
        for path in tables:
            with contextlib.suppress(RecordingError, OSError):
                function = "imuscope.recordings.library.table_preview:heading_of"
                headings[path] = await self.files.call(function, path, returns=list[str], user="the library")
        return headings

    async def add_upload(self, path: Path, user: str = "") -> LibraryEntry:
        """Check a complete upload and add it to the list.

        Raises:
            RecordingError, DomainError: it is not a recording that can be opened.
            OSError: it cannot be read.
        """
        function = "imuscope.recordings.library.table_preview:check_upload"
        probe: RecordingProbe | None
        probe = await self.files.call(function, path, returns=RecordingProbe | None, user=user)
        tables = [path] if probe is not None and probe.format in TABLE_FORMATS and self.library.tables else []
        heading = (await self.headings(tables)).get(path, ())
        return await asyncio.to_thread(self.library.add_file, path, probe, heading)

    def info(self, recording: str) -> RecordingInfo:
        """Information about one recording that was listed; KeyError for an unknown id."""
        return self.to_api(self.library.get(recording))

    def markers(self, recording: str) -> list[MarkerInfo]:
        """Markers added after recording; KeyError for an unknown id."""
        return list(self.library.get(recording).edits.markers)

    def to_api(self, entry: LibraryEntry) -> RecordingInfo:
        """An entry in the form of the API."""
        probe, edits = entry.probe, entry.edits
        recording = self.is_recording(entry)
        duration = probe.duration
        if recording and probe.started is not None:
            now = self._bus.recorder.latest
            duration = max(0.0, self._bus.now() - now.started) if now is not None and now.started is not None else 0.0
        return RecordingInfo(
            id=entry.id,
            title=entry.title,
            file=entry.name,
            format=probe.format,
            size=entry.size,
            started=probe.started,
            duration=duration,
            devices=list(probe.devices),
            tags=list(edits.tags or ()),
            notes=edits.notes or "",
            pinned=bool(edits.pinned),
            recording=recording,
            opened=entry.deleted is None and not recording and self._is_open(entry),
            damaged="" if recording else probe.damaged,
            remark="" if recording else probe.remark,
            markers=entry.markers,
            read=entry.indexed,
            motion=entry.motion,
            thumbnail=entry.thumbnail,
            losses=entry.losses,
            marks=sorted({*entry.marks, *places((one.time for one in edits.markers), probe.started, probe.duration)}),
            deleted=entry.deleted,
        )

    async def storage(self, quota_bytes: int) -> LibraryStorage:
        """Disk space of the library. OSError: the disk does not answer."""
        folder = self.library.folder
        place = folder if folder.is_dir() else folder.parent
        used, disk = await asyncio.gather(
            asyncio.to_thread(self.library.used_bytes), asyncio.to_thread(shutil.disk_usage, place)
        )
        return LibraryStorage(used, disk.free, quota_bytes)

    def rename(self, recording: str, name: str) -> LibraryEntry:
        """Rename its file, and keep its decoded columns. Raises as Library.rename."""
        was, before = self.library.get(recording), self._store(recording)
        entry = self.library.rename(recording, name)
        after = self._store(entry.id)
        # Recordings that name a device after the file are decoded again.
        is_same = entry.probe.format == "mcap" and all(one.name != was.path.name for one in was.probe.devices)
        if is_same and before is not None and after is not None:
            with contextlib.suppress(OSError):
                before.rename(after)
        return entry

    def _store(self, recording: str) -> Path | None:
        try:
            return self._columns.store_of(recording)
        except (KeyError, OSError):
            return None

    def is_recording(self, entry: LibraryEntry) -> bool:
        """Whether the recording is being written."""
        now = self._bus.recorder.latest
        return now is not None and now.running and entry.deleted is None and entry.path.stem == now.id

    def changed(self) -> None:
        """Publish a change of the library."""
        self._listing = None
        self._columns.end_orphans()
        self._bus.library_changed()

    def finished(self, path: Path) -> None:
        """Open a compacted recording once in a subprocess, so that the list shows its motion and losses."""
        self.changed()
        self._cache(self._open_for_list(path.stem), f"looking at {path.name}")

    def _cache(self, work: Coroutine[Any, Any, None], name: str) -> None:
        task = asyncio.get_running_loop().create_task(work, name=name)
        self._refreshing.add(task)
        task.add_done_callback(self._refreshing.discard)

    async def _open_for_list(self, recording: str) -> None:
        if await self._read_contents(recording):
            self.changed()

    async def _read_contents(self, recording: str) -> bool:
        """Open a recording for its summary; returns whether it has one now."""
        try:
            await self._summarize(recording, await self._columns.opened(recording))
        except (KeyError, OSError):
            return False  # deleted by now
        except RecordingError as error:
            log.info("%s cannot be opened: %s", recording, error)
            return False
        return True

    async def _summarize(self, recording: str, columns: ColumnStore) -> None:
        """Store the summary of an opened recording for the list. KeyError, OSError: deleted or renamed by now."""
        function = "imuscope.recordings.library.index:summary_in"
        user = "the library"
        summary: dict[str, Any] = await self.files.call(function, columns.folder, returns=dict[str, Any], user=user)
        await asyncio.to_thread(self.library.index, recording, summary)

    def _read_further(self, entries: list[LibraryEntry]) -> None:
        """Begin to read the recordings that this decoder never opened, the newest first, unless that has begun."""
        if self._may_read and (self._reader is None or self._reader.done()):
            self._reader = asyncio.get_running_loop().create_task(self._read_unread(entries), name="reading recordings")

    @property
    def _may_read(self) -> bool:
        """Whether recordings may be read for the list: it is viewed, and the machine has nothing better to do."""
        is_busy = self._refreshing or self._written
        is_viewed = time.monotonic() - self._listed <= VIEWED_S
        return not is_busy and is_viewed and self._clients.shedding.draws_pictures

    async def _read_unread(self, entries: list[LibraryEntry]) -> None:
        marks = [(entry.path, entry.size, entry.modified, str(entry.edits.reading)) for entry in entries]
        self._tried &= set(marks)
        reported, has_more = time.monotonic(), False
        for entry, mark in zip(entries, marks, strict=True):
            if entry.is_current or entry.deleted is not None or not 0 < entry.size <= MAX_BYTES or mark in self._tried:
                continue
            if not self._may_read:
                break
            self._tried.add(mark)
            has_more = await self._read_contents(entry.id) or has_more
            if has_more and time.monotonic() - reported > CHECK_INTERVAL_S:  # pages load the list at each report
                self.changed()
                reported, has_more = time.monotonic(), False
        if has_more:
            self.changed()

    # ── watching ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def start(self) -> None:
        """Start watching the folder."""
        self._watcher = asyncio.get_running_loop().create_task(self._watch(), name="library")

    def prepare(self) -> None:
        """Prepare in the background what the first view of the library needs: 0.1 s of a processor."""
        self._cache(asyncio.to_thread(self._columns.warm), "preparing the library")

    async def close(self) -> None:
        """Stop watching the folder, and reading files."""
        await end_tasks(*self._refreshing, *filter(None, (self._watcher, self._reader)))
        await self.files.close()

    async def _watch(self) -> None:
        while True:
            await beat(CHECK_INTERVAL_S)
            if not self._clients.browsers:
                continue
            try:
                await self._refresh()
            except Exception:
                log.exception("checking the library failed")

    @property
    def _written(self) -> str:
        """Id of the recording that is being written; "" for none."""
        now = self._bus.recorder.latest
        return now.id if now is not None and now.running else ""

    async def _refresh(self) -> None:
        stamp = await asyncio.to_thread(self.library.stamp, self._written)
        self._checks += 1
        entries = self._listing
        if entries is None or stamp != self._stamp or self._checks % LISTS_EVERY == 0:
            entries = self._listing = await self.entries()
        has_changed = await self._index(entries)
        if has_changed or (self._stamp is not None and stamp != self._stamp):
            self.changed()
        self._stamp = stamp
        self._read_further(entries)

    async def _index(self, entries: list[LibraryEntry]) -> bool:
        """Store information on recordings opened since the last call; returns whether the entries are out of date."""
        has_changed = False
        for entry in entries:
            if entry.is_current or entry.deleted is not None or not self._is_open(entry):
                continue
            columns = self._columns.cached(entry.id)
            if columns is not None:
                with contextlib.suppress(KeyError, OSError, RecordingError):
                    await self._summarize(entry.id, columns)
                has_changed = True
        return has_changed

    def _is_open(self, entry: LibraryEntry) -> bool:
        store = self._store(entry.id)
        return store is not None and store.is_dir()
