"""Advisory locks on recordings, so that a file that somebody writes belongs to that writer alone.

    writer      holds the file exclusively from its making until it is closed     recordings/mcap_writer.py
    compaction  shares the file it reads and the file it makes beside it          recordings/compaction.py
    others      ask `is_written` before they rename, delete or rewrite a file, and `is_in_use` before they take away
                what looks like a leftover

The kernel releases a lock with the process that holds it, however that ended; so no lock is ever left behind, and a
second process on the same folder sees what the first one writes. On a file system without locks nothing counts as
held: there the one process that records leaves its own file alone by its name.
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path


def hold(handle: int) -> None:
    """Lock an open file exclusively; nothing happens where that cannot be."""
    _locked(handle, fcntl.LOCK_EX)


def share(handle: int) -> bool:
    """Lock an open file together with others who share it.

    Returns:
        False while a writer holds it.
    """
    return _locked(handle, fcntl.LOCK_SH)


def is_written(path: Path) -> bool:
    """Whether a writer holds this file; False where there is none, or where it cannot be opened."""
    return _is_held(path, fcntl.LOCK_SH)


def is_in_use(path: Path) -> bool:
    """Whether anybody holds or shares this file."""
    return _is_held(path, fcntl.LOCK_EX)


def _is_held(path: Path, kind: int) -> bool:
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        return not _locked(handle, kind)
    finally:
        os.close(handle)  # and the lock goes


def _locked(handle: int, kind: int) -> bool:
    try:
        fcntl.flock(handle, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True
