"""What did a server that was killed leave unfinished, and who takes it away? The next one, when it starts.

    <data>/exports/<run>-<job>/               an export, whole or not: jobs are not kept, so nobody could fetch it
    <data>/cache/columns/.<store>.<pid>.making/   a recording that was being opened
    <data>/**/.<name>.<8 hex digits>          a small file that was being written (recordings/atomic_write.py)

Whoever works in a data folder holds a lock on it, which the kernel lets go of with the process, however that ended. A
server that does not get the lock has company in its folder, and takes nothing away. (Packings that were cut off are
the packer's, uploads the library's.)
"""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

log = logging.getLogger("imuscope.library")

LOCK = ".in-use"
_ASIDE = re.compile(r"\..+\.[0-9a-f]{8}")
_WRITTEN_ASIDE = ("recordings", "recordings/.index", "snapshots", "trials")  # where small files are


class DataFolderLock:
    """A data folder in use by this process, from `begin` until `end`."""

    def __init__(self, data: Path) -> None:
        self._data = data
        self._lock = -1
        self._has_company = False

    def begin(self) -> list[str]:
        """Take away what was left; what that was, in words, as paths within the folder. To be called in a thread."""
        try:
            self._data.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(self._data / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._has_company = True
            log.warning("another imuscope works in %s; its trials and unfinished files are left to it", self._data)
            return []
        except OSError:
            return []  # nothing can be written, so nothing can be taken away either
        gone = []
        for path in left_behind(self._data):
            with contextlib.suppress(OSError):
                shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
                gone.append(str(path.relative_to(self._data)))
        if gone:
            log.info("taken away, as a server before this one had left it unfinished: %s", ", ".join(gone))
        return gone

    @property
    def is_alone(self) -> bool:
        """Whether no other server works in the folder, as far as the kernel can tell."""
        return not self._has_company

    def end(self) -> None:
        """Let go of the folder. Idempotent."""
        lock, self._lock = self._lock, -1
        if lock >= 0:
            os.close(lock)


def left_behind(data: Path) -> Iterator[Path]:
    """What is unfinished in a data folder in which nobody works."""
    yield from _in(data / "exports")
    yield from (path for path in _in(data / "cache" / "columns") if path.name.endswith(".making"))
    for folder in _WRITTEN_ASIDE:
        yield from (path for path in _in(data / folder) if _ASIDE.fullmatch(path.name) and path.is_file())
    snapshots = (folder for folder in _in(data / "snapshots") if folder.is_dir())
    yield from (path for folder in snapshots for path in _in(folder) if _ASIDE.fullmatch(path.name))


def _in(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []
