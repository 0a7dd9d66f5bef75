"""Files of the library: grouped by recording, named, with the files that belong to them."""

import os
from pathlib import Path

from imuscope.recordings import sidecar
from imuscope.recordings.readers import vendor_logs
from imuscope.recordings.readers.file_suffixes import suffixes
from imuscope.recordings.system.regular_file import readable_name

COMPANIONS = (".idx",)


def free_path(path: Path) -> Path:
    """The path, or a similar one that is not taken."""
    count, free = 1, path
    while free.exists():
        count += 1
        free = path.with_name(f"{path.stem}-{count}{path.suffix}")
    return free


def grouped_files(files: dict[Path, tuple[int, int]]) -> list[dict[Path, tuple[int, int]]]:
    """The files grouped by recording: the parts of a log in order, any other file alone."""
    groups: dict[tuple[str, str], list[tuple[int, Path]]] = {}
    of_logs = vendor_logs.log_suffixes()
    for path in files:
        name = vendor_logs.log_name(path) if path.suffix.lower() in of_logs else None
        key = (name.stem if name is not None else path.name, path.suffix)
        groups.setdefault(key, []).append((name.part if name is not None else 0, path))
    return [{path: files[path] for _, path in sorted(group)} for group in groups.values()]


def state_of(path: Path) -> tuple[int, int, int] | None:
    """Number, size and time of change, ns, of a file; None if it is not there. Another content has another state."""
    try:
        stat = os.stat(path)
    except OSError:
        return None
    return stat.st_ino, stat.st_size, stat.st_mtime_ns


def is_file(entry: os.DirEntry[str]) -> bool:
    """Whether an entry of a folder is a file, or a link to one."""
    try:
        return entry.is_file()
    except OSError:  # a link in a circle
        return False


def named_groups(groups: list[dict[Path, tuple[int, int]]]) -> list[tuple[str, dict[Path, tuple[int, int]]]]:
    """Each group with its id, as recordings/library/library.py defines it."""

    def id_of(name: str) -> str:
        while name in by_name:  # of two that differ only in bytes that are not UTF-8
            name = f"{name}-"
        return name

    kinds = suffixes()

    def rank(group: dict[Path, tuple[int, int]]) -> tuple[int, str]:
        first = next(iter(group))
        suffix = first.suffix.lower()
        return (kinds.index(suffix) if suffix in kinds else len(kinds)), first.name

    by_name: dict[str, dict[Path, tuple[int, int]]] = {}
    for group in sorted(groups, key=rank):
        name = readable_name(next(iter(group)))
        stem = Path(name).stem
        by_name[stem if stem not in by_name else id_of(name)] = group
    return list(by_name.items())


def belonging_files(files: list[Path]) -> list[Path]:
    """A recording's files and their companions."""
    companions = []
    for file in files:
        others = (sidecar.sidecar_path(file), *(file.with_suffix(suffix) for suffix in COMPANIONS))
        companions += [file, *(other for other in others if other.is_file())]
    return companions


def move_files(files: list[Path], target: Path) -> None:
    """Move files into a folder."""
    for file in files:
        os.rename(file, target / file.name)
