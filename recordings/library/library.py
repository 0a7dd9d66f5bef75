"""Library: the folder of recordings. Every recording in the folder is listed, whichever program put it there.

    <data>/recordings/20261121T044324Z-MTi-630.mcap         a recording
                      20261121T044324Z-MTi-630.mcap.json    changes made by the user (recordings/sidecar.py)
                      LOG_SN60339_…_0001.raw, _0002.raw     a split log: listed as one
                      .index/<file>.json                    findings of the first opening; may be deleted
                      .bin/<ms>/…                           deleted at that time, with all its files; kept for 7 days
                      .incoming/<token>/…                   being uploaded

A recording's id is its file's name without suffix; if several files share that, the first kind of `suffixes()` has it
and the others use their whole name. Listing reads names, sizes and times only, and the user's changes. The metadata of
a file comes from another process, which reads it (`unread`, `learn`). Until then only files whose suffix is that of a
recording are listed, without metadata. Subfolders are ignored. External names never become paths: a recording is looked
up in the list, and the name of an upload is cleaned.

Threads may share a Library; its methods wait for the disk.
"""

import contextlib
import math
import os
import secrets
import shutil
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from imuscope.recordings import sidecar
from imuscope.recordings.errors import RecordingError, disk_error
from imuscope.recordings.file_names import clean_name
from imuscope.recordings.library.entry import LibraryEntry
from imuscope.recordings.library.files import (
    COMPANIONS,
    belonging_files,
    free_path,
    grouped_files,
    is_file,
    move_files,
    named_groups,
    state_of,
)
from imuscope.recordings.library.index import INDEX, completed, index_of, remove_stale_indexes, write_index
from imuscope.recordings.library.probe_cache import ProbeCache, Stamp
from imuscope.recordings.library.quota import BIN
from imuscope.recordings.library.recording_probe import TABLE_FORMATS, RecordingProbe
from imuscope.recordings.library.remembered_tables import TableMemory
from imuscope.recordings.readers.file_suffixes import ALWAYS_LISTED, suffixes
from imuscope.recordings.sidecar import Edits, MarkerInfo
from imuscope.recordings.system import file_lock
from imuscope.recordings.tables.options import FileReading

INCOMING = ".incoming"
KEPT_S = 7 * 86_400.0  # in the bin
STALE_S = 3600.0  # age of an abandoned upload
_SWEEP_S = 600.0


class NamingError(RecordingError):
    """The name is not possible for a recording: taken, or without letters and digits."""


class Library:
    """The recordings of one folder.

    Args:
        folder: created on the first write.
        now: unix seconds.
        tables: choices by heading, for new tables.
        decoder: identifies what decodes the recordings that are indexed.
        steady: clock that does not step, s: a host without a clock of its own sets it when it finds a network. None:
            `now`.
    """

    def __init__(
        self,
        folder: Path,
        now: Callable[[], float] = time.time,
        tables: TableMemory | None = None,
        decoder: Callable[[], str] = str,
        steady: Callable[[], float] | None = None,
    ) -> None:
        self.folder = folder
        self.tables = TableMemory() if tables is None else tables
        self._now = now
        self._steady = now if steady is None else steady
        self._decoder = decoder
        self._lock = threading.RLock()
        self._probes = ProbeCache()
        self._entries: dict[Path, tuple[object, LibraryEntry]] = {}  # with the state of all that each was made of
        self._paths: dict[str, Path] = {}
        self._deleted_at: dict[Path, float] = {}  # folder in the bin → by the steady clock, of deletions in this run
        self._last_removal = -math.inf

    # ── listing ──────────────────────────────────────────────────────────────────────────────────────────────────────

    def all(self, search: str = "") -> list[LibraryEntry]:
        """Newest first; then those in the bin, newest deletion first."""
        words = search.casefold().split()
        with self._lock:
            self._remove_stale()
            entries = [entry for entry in self._live() if entry.contains(words)]
            gone = [entry for entry in self._deleted() if entry.contains(words)]
        self._paths.update({entry.id: entry.path for entry in entries})
        return [
            *sorted(entries, key=lambda entry: entry.began, reverse=True),
            *sorted(gone, key=lambda entry: entry.deleted or 0.0, reverse=True),
        ]

    def get(self, recording: str) -> LibraryEntry:
        """One that is not deleted.

        Raises:
            KeyError: not found.
        """
        with self._lock:
            return next((entry for entry in self._live(only=recording) if entry.id == recording), None) or _missing(
                recording
            )

    def path(self, recording: str) -> Path:
        """Its file, the first if there are several. KeyError: not found."""
        return self.get(recording).path

    def known_path(self, recording: str) -> Path:
        """Its file as last listed, without reading the folder again. KeyError: not found."""
        known = self._paths.get(recording)
        if known is None or not known.exists():
            with self._lock:
                groups = named_groups(grouped_files(self._files(self.folder)))
            path = next((next(iter(files)) for name, files in groups if name == recording), None)
            if path is None or not self._probes.may_be_recording(path):
                raise KeyError(recording)
            known = self._paths[recording] = path
        return known

    # ── contents of the files ────────────────────────────────────────────────────────────────────────────────────────

    def unread(self, recording: str = "", written: str = "") -> dict[Path, Stamp]:
        """Files that are new, or have changed since they were read, with their state now.

        Args:
            recording: only of this one, and not in the bin; "" for all.
            written: name, without suffix, of a file that is being written: it is read once only.
        """
        with self._lock:
            groups = [
                (name, next(iter(files.items())))
                for folder in ([self.folder] if recording else [self.folder, *self._bins()])
                for name, files in named_groups(grouped_files(self._files(folder)))
            ]
            return {
                path: stamp
                for name, (path, stamp) in groups
                if recording in ("", name) and not self._probes.has(path, stamp, written)
            }

    def learn(self, path: Path, stamp: Stamp, probe: RecordingProbe | None, heading: Sequence[str] = ()) -> None:
        """Store the metadata read from a file.

        Args:
            probe: None if the file is not a recording.
            heading: of a table.
        """
        with self._lock:
            self._probes.learn(path, stamp, probe, heading)

    def unchosen_tables(self) -> list[Path]:
        """Tables that were never opened, and for which nothing was chosen."""
        with self._lock:
            return [entry.path for entry in self._live() if self._may_recall(entry)]

    def stamp(self, written: str = "") -> int:
        """A number that changes with any file in the folder, except one being written (its name without suffix)."""
        with self._lock:
            files = sorted(self._files(self.folder).items())
        return hash(tuple((path.name, *stamp) for path, stamp in files if path.stem != written))

    def used_bytes(self) -> int:
        """Size of all recordings, also of those in the bin."""
        with self._lock:
            return sum(size for folder in (self.folder, *self._bins()) for size, _ in self._files(folder).values())

    def index(self, recording: str, summary: Mapping[str, Any]) -> None:
        """Store the summary of an opened recording for the list. KeyError: not found."""
        write_index(self.folder, self.get(recording).path, summary, self._decoder())

    def _live(self, only: str = "") -> list[LibraryEntry]:
        return [
            entry
            for name, files in named_groups(grouped_files(self._files(self.folder)))
            if (not only or name == only) and (entry := self._entry(name, files)) is not None
        ]

    def _deleted(self) -> list[LibraryEntry]:
        bins, entries = self._bins(), []
        live = {name for name, _ in named_groups(grouped_files(self._files(self.folder)))} if bins else ()
        for folder in bins:
            for name, files in named_groups(grouped_files(self._files(folder))):
                entry = self._entry(name if name not in live else f"{name}.{folder.name}", files)
                if entry is not None:
                    entries.append(replace(entry, deleted=int(folder.name) / 1000))
        return entries

    def _bins(self) -> list[Path]:
        try:
            return [folder for folder in (self.folder / BIN).iterdir() if folder.name.isdecimal()]
        except OSError:
            return []

    def _files(self, folder: Path) -> dict[Path, Stamp]:
        """Files of a folder that may be recordings: path → size, time of change."""
        files = {}
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    suffix = os.path.splitext(entry.name)[1].lower()
                    if entry.name.startswith(".") or suffix in (sidecar.SUFFIX, *COMPANIONS):
                        continue
                    with contextlib.suppress(OSError):
                        is_regular = is_file(entry)
                        if is_regular or suffix in ALWAYS_LISTED:  # other files are listed with the reason
                            stat = entry.stat() if is_regular else entry.stat(follow_symlinks=False)
                            files[Path(entry.path)] = (stat.st_size if is_regular else 0, stat.st_mtime_ns)
        except OSError:
            pass
        return files

    def _entry(self, name: str, files: dict[Path, Stamp]) -> LibraryEntry | None:
        path, stamp = next(iter(files.items()))
        probe = self._probes.of(path)
        if probe is None:
            return None
        beside = (sidecar.sidecar_path(path), self.folder / INDEX / f"{path.name}.json")
        state = (name, tuple(files.items()), probe, *map(state_of, beside), self._decoder())
        heading = self._probes.take_heading(path)
        known = self._entries.get(path)
        if not heading and known is not None and known[0] == state:
            return known[1]
        size, modified = sum(size for size, _ in files.values()), max(changed for _, changed in files.values()) / 1e9
        entry = LibraryEntry(name, list(files), size, modified, probe, Edits(), [], [], [])
        self._apply_index(entry, stamp)
        entry.edits = sidecar.read(path).over(entry.probe.edits)
        if why := sidecar.error_of(path):
            entry.probe = replace(entry.probe, damaged=why.message)
        elif heading:
            entry.edits = self._recalled(entry, heading)
        self._entries[path] = state, entry
        return entry

    def _may_recall(self, entry: LibraryEntry) -> bool:
        return not entry.indexed and entry.edits.reading is None and entry.probe.format in TABLE_FORMATS

    def _recalled(self, entry: LibraryEntry, heading: Sequence[str]) -> Edits:
        """The edits of a table that was never opened, with the choices for its heading, which are stored with it."""
        reading = self.tables.of(heading) if self.tables and self._may_recall(entry) else None
        if reading is None:
            return entry.edits
        try:
            sidecar.write(entry.path, replace(sidecar.read(entry.path), reading=reading))
        except (OSError, RecordingError):  # the folder is read-only
            return entry.edits
        return replace(entry.edits, reading=reading)

    def _apply_index(self, entry: LibraryEntry, stamp: tuple[int, int]) -> None:
        index = index_of(self.folder, entry.path, stamp)
        if index is None:
            return
        try:
            entry.probe = completed(entry.probe, index, entry.path.name)
        except TypeError:  # of a newer imuscope
            return
        entry.motion, entry.thumbnail = index["motion"], index["thumbnail"]
        entry.losses, entry.marks = index["losses"], index["marks"]
        entry.marker_texts = index["markers"]
        entry.indexed, entry.is_current = True, index.get("decoder", "") == self._decoder()

    # ── changing ─────────────────────────────────────────────────────────────────────────────────────────────────────

    def edit(self, recording: str, edits: Edits, notes_before: str | None = None) -> LibraryEntry:
        """Apply the changes that are not None; markers are added to the existing ones.

        Args:
            notes_before: notes that are replaced; None: any.

        Raises:
            KeyError: not found.
            ChangedError: the notes are others by now.
            RecordingError: they cannot be stored.
        """
        with self._lock:
            entry = self.get(recording)
            sidecar.expect_notes(entry.edits, notes_before)
            self._store(entry, edits.over(sidecar.read(entry.path)))
            return self.get(recording)

    def mark(self, recording: str, marker: MarkerInfo) -> MarkerInfo:
        """Add a marker or note after recording. Raises as `edit` does."""
        with self._lock:
            entry = self.get(recording)
            edits = entry.edits.with_marker(marker)
            self._store(entry, replace(sidecar.read(entry.path), markers=edits.markers))
            return edits.markers[-1]

    def choose(
        self,
        recording: str,
        reading: FileReading,
        heading: Sequence[str] = (),
        others: Mapping[Path, Sequence[str]] | None = None,
    ) -> LibraryEntry:
        """Choose how a recording is read, and remember it for the heading of its table. Raises as `edit` does.

        Args:
            others: headings of `unchosen_tables`: those with this one are read so too.
        """
        with self._lock:
            entry = self.get(recording)
            self._store(entry, replace(sidecar.read(entry.path), reading=reading))
            self.tables.remember(heading, reading)
            for other in self._live() if others else ():
                self._recalled(other, (others or {}).get(other.path, ()))
            return self.get(recording)

    def _store(self, entry: LibraryEntry, edits: Edits) -> None:
        try:
            sidecar.write(entry.path, edits)
        except OSError as error:
            raise disk_error(error, sidecar.sidecar_path(entry.path)) from None

    def rename(self, recording: str, name: str) -> LibraryEntry:
        """Rename its file, which changes the recording's id; its companion files are renamed too.

        Args:
            name: as entered by the user, with or without the suffix, which stays.

        Raises:
            KeyError: not found.
            NamingError: the name is not possible.
            RecordingError: it cannot be renamed.
        """
        with self._lock:
            entry = self.get(recording)
            path = entry.path
            _check_unused(entry)
            if len(entry.files) > 1:
                hint = "Give it a title instead."
                raise NamingError("Parts of a split log are identified by their names, which cannot change.", hint)
            typed = name.strip()
            typed = typed[: -len(path.suffix)] if typed.lower().endswith(path.suffix.lower()) else typed
            if not any(c.isalnum() for c in typed):
                raise NamingError("A file's name needs a letter or a digit.", "Try another name.")
            target = path.with_name(clean_name(typed + path.suffix, suffixes()))
            if target == path:
                return entry
            belonging = belonging_files([path])
            moves = [(one, target.with_name(target.stem + one.name.removeprefix(path.stem))) for one in belonging]
            existing = next((to for _, to in moves if to.exists()), None)
            if existing is not None:
                raise NamingError(f"There is a file {existing.name} already.", "Choose another name.")
            try:
                for one, to in moves:
                    os.rename(one, to)
            except OSError as error:
                raise disk_error(error, path) from None
            with contextlib.suppress(OSError):  # else it is indexed again
                os.rename(self.folder / INDEX / f"{path.name}.json", self.folder / INDEX / f"{target.name}.json")
            self._probes.move(path, target, is_renamed=True)
            return next(one for one in self._live() if one.path == target)

    def delete(self, recording: str) -> LibraryEntry:
        """Move it to the bin, with all its files. Raises as `edit` does."""
        with self._lock:
            entry = self.get(recording)
            _check_unused(entry)
            stamp = round(self._now() * 1000)
            while (self.folder / BIN / str(stamp)).exists():
                stamp += 1
            target = self.folder / BIN / str(stamp)
            try:
                target.mkdir(parents=True)
                move_files(belonging_files(entry.files), target)
            except OSError as error:
                raise disk_error(error, entry.path) from None
            self._probes.move(entry.path, target / entry.path.name)
            self._deleted_at[target] = self._steady()
            return replace(entry, deleted=stamp / 1000)

    def undelete(self, recording: str) -> LibraryEntry:
        """Restore from the bin; of several the one deleted last.

        Raises:
            KeyError: not in the bin.
            NamingError: a file of that name exists.
        """
        with self._lock:
            matches = [entry for entry in self._deleted() if recording == entry.id]
            entry = max(matches, key=lambda one: one.deleted or 0.0, default=None) or _missing(recording)
            source = entry.path.parent
            existing = next((file for file in source.iterdir() if (self.folder / file.name).exists()), None)
            if existing is not None:
                hint = "Delete or rename that one first."
                raise NamingError(f"There is a file {existing.name} already.", hint)
            try:
                move_files(list(source.iterdir()), self.folder)
                source.rmdir()
            except OSError as error:
                raise disk_error(error, entry.path) from None
            self._probes.move(entry.path, self.folder / entry.path.name)
            return next(one for one in self._live() if one.path.name == entry.path.name)

    def _remove_stale(self) -> None:
        """Remove recordings that have been in the bin for more than 7 days, and abandoned uploads."""
        steady = self._steady()
        if steady - self._last_removal < _SWEEP_S:
            return
        self._last_removal = steady
        for folder in self._bins():
            in_this_run = steady - self._deleted_at.get(folder, -math.inf)  # the host's clock may have been set since
            if min(self._now() - int(folder.name) / 1000, in_this_run) > KEPT_S:
                shutil.rmtree(folder, ignore_errors=True)
        self._deleted_at = {folder: time for folder, time in self._deleted_at.items() if folder.exists()}
        with contextlib.suppress(OSError):
            for folder in (self.folder / INCOMING).iterdir():
                changed = max(one.stat().st_mtime for one in (folder, *folder.iterdir()))  # that of the file grows
                if self._now() - changed > STALE_S:
                    shutil.rmtree(folder, ignore_errors=True)
        remove_stale_indexes(self.folder, self._names)
        there = self._files(self.folder)
        self._probes.keep(lambda path: path in there or (BIN in path.parts and path.exists()))
        self._entries = {path: known for path, known in self._entries.items() if path in there}
        self._paths = {name: path for name, path in self._paths.items() if path in there}

    def _names(self) -> list[str]:
        """Names of the files that may be recordings, also in the bin."""
        return [path.name for folder in (self.folder, *self._bins()) for path in self._files(folder)]

    # ── uploads ──────────────────────────────────────────────────────────────────────────────────────────────────────

    def incoming(self, name: str) -> Path:
        """A path to write an upload to, under its cleaned name; `add_file` or `refuse` it afterwards.

        Raises:
            RecordingError: there is no room for it.
        """
        folder = self.folder / INCOMING / secrets.token_hex(8)
        try:
            folder.mkdir(parents=True)
        except OSError as error:
            raise disk_error(error, folder) from None
        return folder / clean_name(name, suffixes())

    def add_file(self, path: Path, probe: RecordingProbe | None, heading: Sequence[str] = ()) -> LibraryEntry:
        """Add a complete upload, which was read and can be opened, to the list.

        Args:
            probe, heading: as for `learn`.

        Raises:
            RecordingError: it cannot be moved; it is removed.
        """
        try:
            with self._lock:
                target = free_path(self.folder / path.name)
                os.rename(path, target)
                stat = target.stat()
                self.learn(target, (stat.st_size, stat.st_mtime_ns), probe, heading)
                entry = next(entry for entry in self._live() if target in entry.files)
                if entry.probe.edits.reading is not None:  # the file came with it from another imuscope
                    self._store(entry, replace(sidecar.read(target), reading=entry.probe.edits.reading))
                return entry
        except OSError as error:
            raise disk_error(error, path) from None
        finally:
            self.refuse(path)

    def refuse(self, path: Path) -> None:
        """Remove an upload completely."""
        shutil.rmtree(path.parent, ignore_errors=True)


def _check_unused(entry: LibraryEntry) -> None:
    """Raise RecordingError while any process writes the recording."""
    if any(file_lock.is_written(file) for file in entry.files):
        raise RecordingError(f"{entry.path.name} is being recorded.", "Stop the recording first.")


def _missing(recording: str) -> LibraryEntry:
    raise KeyError(recording)
