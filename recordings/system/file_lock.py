"""Advisory locks on recordings, so that a file being written belongs to its writer alone.

    writer      holds the file exclusively from its creation until it is closed   recordings/mcap/writer.py
    compaction  shares the file it reads and the file it writes beside it         recordings/mcap/compaction.py
    others      check `is_written` before they rename, delete or rewrite a file, and `is_in_use` before they remove a
                possible leftover

The kernel releases a lock when the process that holds it ends, however it ends; so no lock is ever left behind, and a
second process on the same folder sees which files the first one writes. On a file system without locks no file counts
as held: there the one recording process excludes its own file by name.
"""

import fcntl
import os
from pathlib import Path


def hold(handle: int) -> None:
    """Lock an open file exclusively; no effect if the file system has no locks."""
    _locked(handle, fcntl.LOCK_EX)


def share(handle: int) -> bool:
    """Lock an open file shared.

    Returns:
        False while a writer holds it.
    """
    return _locked(handle, fcntl.LOCK_SH)


def is_written(path: Path) -> bool:
    """Whether a writer holds this file; False if it does not exist or cannot be opened."""
    return _is_held(path, fcntl.LOCK_SH)


def is_in_use(path: Path) -> bool:
    """Whether any process holds or shares this file."""
    return _is_held(path, fcntl.LOCK_EX)


def _is_held(path: Path, kind: int) -> bool:
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        return not _locked(handle, kind)
    finally:
        os.close(handle)  # releases the lock


def _locked(handle: int, kind: int) -> bool:
    try:
        fcntl.flock(handle, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True
