"""Atomic writes that survive a power cut: a temporary file is synced and renamed, then its folder is synced.

A reader finds the old text or the new one, never a part; when `write_atomic` returns, a power cut leaves the new one.
No other code in the project replaces one file by another (tests/rules/test_architecture.py).
"""

from __future__ import annotations

import os

TYPE_CHECKING = False  # the holder of a shared port has no room for typing and pathlib
if TYPE_CHECKING:
    from pathlib import Path
    from typing import BinaryIO

PRIVATE, SHARED = 0o600, 0o666
"""Permissions of files of a server, which may hold secrets and positions; and of files that a user requested."""


def write_atomic(path: Path, data: str | bytes, mode: int = PRIVATE) -> None:
    """Make `path` hold `data`.

    Args:
        mode: permissions at any moment, less the process's umask.

    Raises:
        OSError: writing failed; the old file is unchanged.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name[:100]}.{os.urandom(4).hex()}")
    try:
        with os.fdopen(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode), "wb") as file:
            file.write(data.encode() if isinstance(data, str) else data)
            file.flush()
            os.fsync(file.fileno())
        replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def open_private(path: Path, *, exclusive: bool = False) -> BinaryIO:
    """Open a file that only its owner can read, to write it."""
    return open(path, "xb" if exclusive else "wb", opener=lambda name, flags: os.open(name, flags, PRIVATE))


def replace(temporary: str | Path, path: str | Path, *, durable: bool = True) -> None:
    """Move a finished temporary file of the same file system to its place.

    Args:
        durable: also after a power cut.
    """
    os.replace(temporary, path)
    if durable:
        sync(os.path.dirname(path) or ".")


def remove(path: Path) -> None:
    """Remove `path`, durably."""
    path.unlink(missing_ok=True)
    sync(path.parent)


def sync(path: str | Path) -> None:
    """Bring a file or a folder to the disk, as far as that is possible."""
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:
        return  # a file system whose folders cannot be opened has nothing to sync
    try:
        os.fsync(handle)
    except OSError:
        return
    finally:
        os.close(handle)
