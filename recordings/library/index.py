"""Index of the library: findings of the first opening of each recording, for the list. It may be deleted.

    <folder>/.index/<file>.json    {"size", "modified_ns", "reading", "decoder", …summary}

It is valid as long as the file and the choices on how it is read stay the same. Findings of another decoder are listed
until this one has opened the file.
"""

import contextlib
import json
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

from imuscope.recordings import sidecar
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.library.recording_probe import RecordedDevice, RecordingProbe
from imuscope.recordings.library.summary import is_summary, summarize
from imuscope.recordings.system import atomic_write
from imuscope.recordings.system.regular_file import read_regular

INDEX = ".index"


def write_index(folder: Path, path: Path, columns: ColumnStore, decoder: str) -> None:
    """Store the index of an opened recording in the folder of the library."""
    stat = path.stat()
    key = {"size": stat.st_size, "modified_ns": stat.st_mtime_ns, "reading": _choices(path), "decoder": decoder}
    body = {**key, **summarize(columns)}
    for device in body["devices"]:
        if device["name"] == path.name:
            device["name"] = ""  # it has only its file's name, which may change
    with contextlib.suppress(OSError):  # a read-only folder: indexed again each time
        (folder / INDEX).mkdir(exist_ok=True)
        atomic_write.write_atomic(folder / INDEX / f"{path.name}.json", json.dumps(body, ensure_ascii=False))


def remove_index(folder: Path, name: str) -> None:
    """Remove the index of a recording that is deleted for good, by the name of its file."""
    with contextlib.suppress(OSError):
        (folder / INDEX / f"{name}.json").unlink()


def remove_stale_indexes(folder: Path, names_of_files: Callable[[], Collection[str]]) -> None:
    """Remove the indexes of recordings that are gone.

    Args:
        names_of_files: names of the files that are there; called after a look at the indexes, so that none is newer.
    """
    try:
        names = [one.name.removesuffix(".json") for one in (folder / INDEX).iterdir() if one.suffix == ".json"]
    except OSError:
        return
    for name in set(names) - set(names_of_files()) if names else ():
        remove_index(folder, name)


def index_of(folder: Path, path: Path, stamp: tuple[int, int]) -> dict[str, Any] | None:
    """The index of a recording with this size and time of change, ns; None without a valid one."""
    try:
        index = json.loads(read_regular(folder / INDEX / f"{path.name}.json"))
        is_same = (index["size"], index["modified_ns"]) == stamp and index.get("reading", {}) == _choices(path)
        return index if is_same and is_summary(index) else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def completed(known: RecordingProbe, index: dict[str, Any], file: str) -> RecordingProbe:
    """Metadata of the file, completed with the findings of the first opening."""
    return replace(
        known,
        started=index["started"] if index["started"] is not None else known.started,
        duration=index["duration"] if index["duration"] is not None else known.duration,
        devices=[RecordedDevice(**{**one, "name": one["name"] or file}) for one in index["devices"]] or known.devices,
        damaged=known.damaged or index["damaged"],  # the words stay those that the list had before it was opened
        remark=index["remark"],
    )


def _choices(path: Path) -> dict[str, Any]:
    stored = sidecar.stored_reading(path)
    return stored.as_json() if stored else {}
