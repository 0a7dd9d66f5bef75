"""Removal of unfinished files of a killed server, at the next start.

    <data>/exports/<run>-<job>/               an export; it cannot be downloaded any more, since jobs are not stored
    <data>/cache/columns/.<store>.<pid>.making/   a recording that was being opened
    <data>/**/.<name>.<8 hex digits>          a small file that was being written (recordings/system/atomic_write.py)

Each process that uses a data folder holds a lock on it, which the kernel releases when the process ends. A server that
does not get the lock shares the folder and removes nothing. (Interrupted compactions are handled by the compaction
worker, uploads by the library.)
"""

import contextlib
import fcntl
import logging
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from imuscope.recordings.system.atomic_write import PRIVATE

log = logging.getLogger("imuscope.library")

LOCK = ".in-use"
_TEMPORARY = re.compile(r"\..+\.[0-9a-f]{8}")
_TEMPORARY_FOLDERS = ("recordings", "recordings/.index", "snapshots", "rollbacks", "trials")  # where small files are


class DataFolderLock:
    """A data folder in use by this process, from `begin` until `end`."""

    def __init__(self, data: Path) -> None:
        self._data = data
        self._lock = -1
        self._is_shared = False

    def begin(self) -> list[str]:
        """Remove unfinished files; returns their paths within the folder. Call it in a thread."""
        try:
            self._data.mkdir(parents=True, exist_ok=True, mode=0o700)
            self._lock = os.open(self._data / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, PRIVATE)
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._is_shared = True
            log.warning(
                "another imuscope works in %s; its pending rollbacks and unfinished files are left to it", self._data
            )
            return []
        except OSError:
            return []  # the folder is not writable
        removed = []
        for path in unfinished_files(self._data):
            with contextlib.suppress(OSError):
                shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
                removed.append(str(path.relative_to(self._data)))
        if removed:
            log.info("removed unfinished files of a previous run: %s", ", ".join(removed))
        return removed

    @property
    def is_alone(self) -> bool:
        """Whether no other server uses the folder, as far as the kernel knows."""
        return not self._is_shared

    def end(self) -> None:
        """Release the lock. Idempotent."""
        lock, self._lock = self._lock, -1
        if lock >= 0:
            os.close(lock)


def unfinished_files(data: Path) -> Iterator[Path]:
    """Unfinished files in an unused data folder."""
    yield from _in(data / "exports")
    yield from _in(data / "recordings" / ".incoming")
    yield from (path for path in _in(data / "cache" / "columns") if path.name.endswith(".making"))
    for folder in _TEMPORARY_FOLDERS:
        yield from (path for path in _in(data / folder) if _TEMPORARY.fullmatch(path.name) and path.is_file())
    snapshots = (folder for folder in _in(data / "snapshots") if folder.is_dir())
    yield from (path for folder in snapshots for path in _in(folder) if _TEMPORARY.fullmatch(path.name))


def _in(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []
