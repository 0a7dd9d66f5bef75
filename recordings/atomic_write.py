"""How does a file survive a power cut? Written aside, forced to disk, renamed, and the folder's entry forced too.

Whoever reads it finds the old text or the new one, never a part; when `write_atomic` returns, the new one is what a
power cut leaves.
"""

from __future__ import annotations

import os
import secrets
from pathlib import Path


def write_atomic(path: Path, text: str) -> None:
    """Make `path` hold `text`. OSError: it could not; the old text is still there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name[:100]}.{secrets.token_hex(4)}")
    try:
        with aside.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(aside, path)
    except BaseException:
        aside.unlink(missing_ok=True)
        raise
    _sync(path.parent)


def remove(path: Path) -> None:
    """Make `path` be gone, also after a power cut."""
    path.unlink(missing_ok=True)
    _sync(path.parent)


def _sync(folder: Path) -> None:
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return  # a file system on which folders cannot be opened has nothing to force
    try:
        os.fsync(handle)
    except OSError:
        return
    finally:
        os.close(handle)
