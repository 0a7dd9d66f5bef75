"""Which recordings have to go so that the folder stays within its quota? The oldest that nobody pinned."""

from __future__ import annotations

import logging
from collections.abc import Collection
from pathlib import Path

from recordings import sidecar
from recordings.blocks import Recording
from recordings.container import EDIT, SUFFIX, RecordingError

log = logging.getLogger("imuscope.quota")


def is_pinned(path: Path) -> bool:
    """Does a person want to keep it? One that cannot be read is kept: nobody has looked at it."""
    said = sidecar.read(path).pinned
    if said is not None:
        return said
    try:
        with Recording(path) as recording:
            return bool(sidecar.from_metadata(recording.meta(EDIT)).pinned)
    except RecordingError:
        return True


def cull(folder: Path, quota_bytes: int, spare: Collection[Path] = ()) -> list[Path]:
    """Delete until the recordings of a folder are within the quota, or only pinned and spared ones are left.

    Args:
        spare: what is being recorded.
    Returns:
        What was deleted, oldest first.
    """
    found = []
    for path in folder.glob(f"*{SUFFIX}"):
        try:
            stat = path.stat()
        except OSError:
            continue
        found.append((stat.st_mtime_ns, path, stat.st_size))
    excess = sum(size for _, _, size in found) - quota_bytes
    gone: list[Path] = []
    for _, path, size in sorted(found):
        if excess <= 0:
            break
        if path in spare or is_pinned(path):
            continue
        try:
            path.unlink()
            sidecar.beside(path).unlink(missing_ok=True)
        except OSError as error:
            log.warning("%s is over the quota and cannot be deleted: %s", path.name, error)
            continue
        gone.append(path)
        excess -= size
    return gone
