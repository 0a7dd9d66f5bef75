"""Index of the library: findings of the first opening of each recording, for the list. It may be deleted.

    <folder>/.index/<file>.json    {"size", "modified_ns", "reading", "decoder", …summary}

It is valid as long as the file and the choices on how it is read stay the same. Findings of another decoder are listed
until this one has opened the file.

    motion   |rate of turn|, or |acceleration|, or else the busiest quantity: in each of 64 buckets the least and the
             greatest, divided by the greatest of all; 0, 0 without samples

A summary is computed from those of the columns, so it costs the same at any length. In these the norm of a vector is
bounded by those of its components: the picture may be slightly too wide, never too narrow.
"""

import contextlib
import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.protocols.registry.families import counts_losses
from imuscope.recordings import sidecar
from imuscope.recordings.columns.rows import ExactRows
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.library.recording_probe import RecordedDevice, RecordingProbe
from imuscope.recordings.system import atomic_write
from imuscope.recordings.system.regular_file import read_regular

BUCKETS = 64
FINE = 32  # summaries for each bucket
MAX_LOSSES = 200
MOST_REMARKS = 5
_PREFERRED = (("rate", "turn"), ("gyro",), ("angular",), ("pqr",), ("acceleration",), ("acc",))


def thumbnail(columns: ColumnStore) -> list[list[float]]:
    """(least, greatest) of 64 buckets, 0..1; [] without motion."""
    number = _moving(columns)
    span = columns.span(number) if number is not None else None
    if number is None or span is None or span[1] <= span[0]:
        return []
    fine = columns.query(number, *span, BUCKETS * FINE, columns=_axes(columns, number))
    if isinstance(fine, ExactRows):
        t = np.where(np.isnan(fine.time), fine.arrival, fine.time)
        low = high = np.array(fine.columns, np.float64)
    else:
        t, low, high = fine.t, np.array(fine.low, np.float64), np.array(fine.high, np.float64)
    inside = (low <= 0) & (high >= 0)
    nearest = np.where(inside, 0.0, np.minimum(np.abs(low), np.abs(high)))
    least = np.sqrt((nearest**2).sum(axis=0))
    greatest = np.sqrt((np.maximum(np.abs(low), np.abs(high)) ** 2).sum(axis=0))
    finite = np.isfinite(greatest)
    scale = float(greatest[finite].max()) if finite.any() else 0.0
    if scale <= 0:
        return []
    place = np.clip(((t - span[0]) * (BUCKETS / (span[1] - span[0]))).astype(np.int64), 0, BUCKETS - 1)
    out: list[list[float]] = []
    for bucket in range(BUCKETS):
        selected = finite & (place == bucket)
        out.append(
            [round(float(least[selected].min()) / scale, 3), round(float(greatest[selected].max()) / scale, 3)]
            if selected.any()
            else [0.0, 0.0]
        )
    return out


def losses(manifest: Mapping[str, Any]) -> list[float]:
    """Positions of lost samples, 0..1 of the recording, ascending."""
    start, end = manifest.get("started"), manifest.get("ended")
    if start is None or end is None or end <= start:
        return []
    places = {
        round(min(max((event["t0"] - start) / (end - start), 0.0), 1.0), 3)
        for event in manifest.get("events", ())
        if event.get("kind") == "gap" and event.get("t0") is not None
    }
    times = sorted(places)
    return times[:: -(-len(times) // MAX_LOSSES)] if times else []


def recorded_devices(manifest: Mapping[str, Any]) -> list[RecordedDevice]:
    """The devices of an opened recording, with the counts from its decoding."""
    devices = []
    for device in manifest.get("devices", ()):
        counted = manifest.get("figures", {}).get(device["id"], {})
        channels = {info["name"] for info in manifest.get("channels", ()) if info["device"] == device["id"]}
        devices.append(
            RecordedDevice(
                **{name: device.get(name, "") for name in ("id", "name", "protocol", "product", "serial_number")},
                simulated=device.get("simulated", False),
                messages=sum(counted.get("messages", {}).values()),
                lost=counted.get("lost", 0),
                rejects=counted.get("rejects", 0),
                counts_losses=counts_losses(device.get("protocol", ""), channels),
            )
        )
    return devices


def summarize(columns: ColumnStore) -> dict[str, Any]:
    """Index entry of an opened recording for the list, as JSON-compatible values."""
    manifest = columns.manifest
    start, end = manifest.get("started"), manifest.get("ended")
    damage = [one["words"] for one in manifest.get("damage", ()) if not one.get("is_remark")]
    remarks = [one["words"] for one in manifest.get("damage", ()) if one.get("is_remark")]
    return {
        "started": start,
        "duration": end - start if start is not None and end is not None else None,
        "devices": [asdict(device) for device in recorded_devices(manifest)],
        "damaged": damage[0] if damage else "",
        "remark": " ".join(remarks[:MOST_REMARKS]),
        "markers": [marker["text"] for marker in manifest.get("markers", ())],
        "thumbnail": thumbnail(columns),
        "losses": losses(manifest),
    }


def is_summary(summary: dict[str, Any]) -> bool:
    """Whether a cached value has the types of `summarize`'s result; a damaged file may not."""

    def is_list(value: Any, *kinds: type) -> bool:
        return isinstance(value, list) and all(isinstance(one, kinds) for one in value)

    numbers = all(summary[name] is None or isinstance(summary[name], int | float) for name in ("started", "duration"))
    lists = is_list(summary["thumbnail"], list) and all(is_list(one, int, float) for one in summary["thumbnail"])
    lists = lists and is_list(summary["losses"], int, float) and is_list(summary["markers"], str)
    devices = is_list(summary["devices"], dict) and all(
        isinstance(value, int if name in ("messages", "lost", "rejects", "simulated", "counts_losses") else str)
        for one in summary["devices"]
        for name, value in one.items()
    )
    return numbers and lists and devices and all(isinstance(summary[name], str) for name in ("damaged", "remark"))


def _moving(columns: ColumnStore) -> int | None:
    """The channel whose motion is shown: the busiest of the preferred kind."""
    infos = columns.manifest.get("channels", ())
    for words in _PREFERRED:
        moving = [
            info["id"]
            for info in infos
            if info["kind"] in ("vector", "record")
            and any(all(word in text.lower() for word in words) for text in (info["name"], info["title"]))
            and columns.rows(info["id"])
        ]
        if moving:
            return int(max(moving, key=columns.rows))
    rest = [info["id"] for info in infos if info["kind"] in ("vector", "euler", "scalar") and columns.rows(info["id"])]
    return int(max(rest, key=columns.rows)) if rest else None


def _axes(columns: ColumnStore, number: int) -> list[int]:
    """The columns that are components: those with an axis, else all floating-point ones, three at most."""
    info = next(one for one in columns.manifest["channels"] if one["id"] == number)
    axes = [i for i, column in enumerate(info["columns"]) if column.get("axis")]
    floats = [i for i, column in enumerate(info["columns"]) if column["dtype"].startswith("f")]
    return (axes or floats or [0])[:3]


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
