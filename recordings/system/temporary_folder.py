"""Temporary folders of which none is left behind.

    <tmp>/imuscope-tmp-<random>/    locked by the process that made it until that ends, however it ends

A process that is killed cannot remove its folder. That may hold an unpacked archive of gigabytes, and in memory, where
the system has its temporary files there. The process that makes the next folder removes those that none holds any more.

Source: flock(2).
"""

import os
import shutil
import tempfile
import time
from pathlib import Path

from imuscope.recordings.system.file_lock import hold, is_in_use

PREFIX = "imuscope-tmp-"
NEW_S = 60.0  # a younger folder may be about to be locked


class TemporaryFolder:
    """A folder of this process, until `remove` or the end of a `with` block."""

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX))
        self._lock = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        hold(self._lock)
        if is_in_use(self.path):  # else the file system has no locks
            _remove_abandoned()

    def remove(self) -> None:
        """Remove it with everything in it. Idempotent."""
        shutil.rmtree(self.path, ignore_errors=True)
        lock, self._lock = self._lock, -1
        if lock >= 0:
            os.close(lock)

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *_: object) -> None:
        self.remove()


def _remove_abandoned() -> None:
    """Remove the folders of processes that have ended."""
    with os.scandir(tempfile.gettempdir()) as entries:
        ours = [one for one in entries if one.name.startswith(PREFIX) and one.is_dir(follow_symlinks=False)]
    for entry in ours:
        try:
            status = entry.stat(follow_symlinks=False)
        except FileNotFoundError:  # removed by its process
            continue
        is_old = status.st_mtime < time.time() - NEW_S
        if is_old and status.st_uid == os.getuid() and not is_in_use(Path(entry.path)):
            shutil.rmtree(entry.path, ignore_errors=True)
