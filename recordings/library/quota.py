"""Storage quota: deletes the oldest unpinned recordings.

    counted    imuscope's recordings with their companion files, pinned or not; everything in the bin
    deleted    first recordings in the bin, longest there first; then imuscope's recordings, oldest first
    neither    files put there by others: captures, logs, tables, other programs' MCAP files

Recordings in the bin go before kept ones, although they could be restored for 7 days.
"""

import logging
import shutil
from collections.abc import Callable, Collection
from pathlib import Path

from imuscope.recordings import sidecar
from imuscope.recordings.file_names import SUFFIX
from imuscope.recordings.library.index import remove_index
from imuscope.recordings.mcap.own_recordings import is_ours
from imuscope.recordings.system import file_lock

BIN = ".bin"
RESERVE_BYTES, RESERVE_SHARE = 2 * 10**9, 20  # a disk with less of it free, and less than one part in so many, is short

log = logging.getLogger("imuscope.quota")
PinnedInFile = Callable[[Path], bool]
"""Whether a recording whose user changed nothing here was pinned where it comes from (recordings/library/probe.py)."""


def is_pinned(path: Path, in_file: PinnedInFile) -> bool:
    """Whether the recording is pinned. One whose changes cannot be read is kept: it may be pinned."""
    pinned = sidecar.read(path).pinned
    return pinned if pinned is not None else sidecar.error_of(path) is not None or in_file(path)


def excess_bytes(folder: Path, quota_bytes: int) -> int:
    """Bytes by which the recordings of a folder exceed the quota; negative if there is room."""
    return sum(size for _, _, size in (*_deleted(folder), *_recordings(folder))) - quota_bytes


def is_short(folder: Path) -> bool:
    """Whether less than the reserve of its disk is free."""
    disk = shutil.disk_usage(folder)
    return disk.free < min(RESERVE_BYTES, disk.total // RESERVE_SHARE)


def cull(
    folder: Path,
    quota_bytes: int,
    in_file: PinnedInFile,
    spare: Collection[Path] = (),
    *,
    only_if_short: bool = False,
) -> list[Path]:
    """Delete until the recordings of a folder are within the quota, or only pinned and spared ones are left.

    Args:
        spare: recordings that stay: those in progress, for one.
        only_if_short: stop as soon as the disk is not short.

    Returns:
        Deleted paths, in that order; for the bin the recordings in it.
    """
    deleted = sorted(_deleted(folder))
    files = sorted(_recordings(folder))
    excess = sum(size for _, _, size in (*deleted, *files)) - quota_bytes
    gone: list[Path] = []
    for _, path, size in deleted:
        if excess <= 0 or (only_if_short and not is_short(folder)):
            return gone
        gone += [one for one in sorted(path.glob("*")) if one.suffix != sidecar.SUFFIX]
        for one in path.glob("*"):
            if not (folder / one.name).exists():
                remove_index(folder, one.name)
        shutil.rmtree(path, ignore_errors=True)
        excess -= size
    for _, path, size in files:
        if excess <= 0 or (only_if_short and not is_short(folder)):
            break
        if path in spare or file_lock.is_written(path) or is_pinned(path, in_file):
            continue
        try:
            path.unlink()
            sidecar.sidecar_path(path).unlink(missing_ok=True)
        except OSError as error:
            log.warning("%s is over the quota and cannot be deleted: %s", path.name, error)
            continue
        remove_index(folder, path.name)
        gone.append(path)
        excess -= size
    return gone


def _recordings(folder: Path) -> list[tuple[int, Path, int]]:
    """Recordings made here: time of the last write, path, bytes with companion files."""
    files = []
    for path in folder.glob(f"*{SUFFIX}"):
        try:
            stat = path.stat()
        except OSError:
            continue
        if is_ours(path):
            files.append((stat.st_mtime_ns, path, stat.st_size + _size(sidecar.sidecar_path(path))))
    return files


def _deleted(folder: Path) -> list[tuple[int, Path, int]]:
    """The folders of the bin: time of deletion (ms), path, bytes."""
    try:
        folders = [one for one in (folder / BIN).iterdir() if one.name.isdecimal()]
        return [(int(one.name), one, sum(map(_size, one.iterdir()))) for one in folders]
    except OSError:
        return []


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
