"""Index of the library: findings of the first opening of each recording, for the list. It may be deleted.

    <folder>/.index/<file>.json    {"size", "modified_ns", "reading", "decoder", …summary}

It is valid as long as the file and the choices on how it is read stay the same. Findings of another decoder are listed
until this one has opened the file.

    thumbnail       |a|, or attitude (roll and pitch), or |rate of turn|, or else the busiest quantity: in each of 64
                    buckets the least and the greatest, between the least and the greatest of all
    motion          the name of that
    losses, marks   where samples are missing, and where markers are, 0..1 of the recording

A summary is made once, in the process that makes the columns or in one for files from outside, and kept with them
(`summary_in`): the server's own process only passes it on. It is computed from the summaries of the columns, so it
costs the same at any length. In these the norm of a vector is bounded by those of its components: the picture may be
slightly too wide, never too narrow.
"""

import contextlib
import json
from collections.abc import Callable, Collection, Iterable, Mapping
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
STILL_SHARE, STILL_DEG = 0.1, 10.0  # smallest extent of a thumbnail, as a share of the greatest norm, and of angles
ATTITUDE = "attitude"
SUMMARY = "summary.json"
MAX_PLACES = 200
MOST_REMARKS = 5
_ACCELERATION = (("acceleration",), ("acc",))
_RATE = (("rate", "turn"), ("gyro",), ("angular",), ("pqr",))


def thumbnail(columns: ColumnStore) -> tuple[str, list[list[float]]]:
    """Name of the motion, and (least, greatest) of 64 buckets, 0..1, [] without samples; "", [] without motion."""
    number, motion = _moving(columns)
    span = columns.span(number) if number is not None else None
    if number is None or span is None or span[1] <= span[0]:
        return "", []
    fine = columns.query(number, *span, BUCKETS * FINE, columns=_axes(columns, number, motion))
    if isinstance(fine, ExactRows):
        t = np.where(np.isnan(fine.time), fine.arrival, fine.time)
        low = high = np.array(fine.columns, np.float64)
    else:
        t, low, high = fine.t, np.array(fine.low, np.float64), np.array(fine.high, np.float64)
    if motion == ATTITUDE:
        least, greatest = low.min(axis=0), high.max(axis=0)
    else:
        inside = (low <= 0) & (high >= 0)
        nearest = np.where(inside, 0.0, np.minimum(np.abs(low), np.abs(high)))
        least = np.sqrt((nearest**2).sum(axis=0))
        greatest = np.sqrt((np.maximum(np.abs(low), np.abs(high)) ** 2).sum(axis=0))
    finite = np.isfinite(least) & np.isfinite(greatest)
    if not finite.any():
        return "", []
    bottom, top = float(least[finite].min()), float(greatest[finite].max())
    extent = max(top - bottom, STILL_DEG if motion == ATTITUDE else STILL_SHARE * top) or 1.0
    bottom -= (extent - (top - bottom)) / 2  # what stands still is a line in the middle, not its noise enlarged
    place = np.clip(((t - span[0]) * (BUCKETS / (span[1] - span[0]))).astype(np.int64), 0, BUCKETS - 1)
    out: list[list[float]] = []
    for bucket in range(BUCKETS):
        selected = finite & (place == bucket)
        ends = (least[selected].min(), greatest[selected].max()) if selected.any() else ()
        out.append([round((float(one) - bottom) / extent, 3) for one in ends])
    return motion, out


def places(times: Iterable[float], started: float | None, duration: float | None) -> list[float]:
    """Positions of moments, 0..1 of the recording, ascending; of very many some."""
    if started is None or not duration:
        return []
    shares = sorted({round(min(max((time - started) / duration, 0.0), 1.0), 3) for time in times})
    return shares[:: -(-len(shares) // MAX_PLACES)] if shares else []


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
    duration = end - start if start is not None and end is not None else None
    gaps = [event.get("t0") for event in manifest.get("events", ()) if event.get("kind") == "gap"]
    motion, pairs = thumbnail(columns)
    return {
        "started": start,
        "duration": duration,
        "devices": [asdict(device) for device in recorded_devices(manifest)],
        "damaged": damage[0] if damage else "",
        "remark": " ".join(remarks[:MOST_REMARKS]),
        "markers": [marker["text"] for marker in manifest.get("markers", ())],
        "motion": motion,
        "thumbnail": pairs,
        "losses": places((t0 for t0 in gaps if t0 is not None), start, duration),
        "marks": places((marker["time"] for marker in manifest.get("markers", ())), start, duration),
    }


def summary_in(store: Path) -> dict[str, Any]:
    """The summary kept with the columns in a folder; made if there is none.

    Raises:
        OSError, ValueError: there are no columns.
    """
    try:
        summary: dict[str, Any] = json.loads(read_regular(store / SUMMARY))
    except (OSError, ValueError, RecursionError):
        summary = summarize(ColumnStore(store))
        with contextlib.suppress(OSError):
            atomic_write.write_atomic(store / SUMMARY, json.dumps(summary, ensure_ascii=False))
    return summary


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
    texts = all(isinstance(summary[name], str) for name in ("damaged", "remark"))
    texts = texts and isinstance(summary.setdefault("motion", ""), str)  # an earlier version had neither
    return numbers and lists and devices and texts and is_list(summary.setdefault("marks", []), int, float)


def _moving(columns: ColumnStore) -> tuple[int | None, str]:
    """The channel whose motion is shown, the busiest of the preferred kind, and the name of that motion."""
    infos = [info for info in columns.manifest.get("channels", ()) if columns.rows(info["id"])]

    def named(words_of: tuple[tuple[str, ...], ...]) -> list[int]:
        for words in words_of:
            moving = [
                info["id"]
                for info in infos
                if info["kind"] in ("vector", "record")
                and any(all(word in text.lower() for word in words) for text in (info["name"], info["title"]))
            ]
            if moving:
                return moving
        return []

    angles = [info["id"] for info in infos if info["kind"] == "euler" and info["columns"][0]["unit"] == "°"]
    rest = [info["id"] for info in infos if info["kind"] in ("vector", "euler", "scalar")]
    kinds = ((named(_ACCELERATION), "|a|"), (angles, ATTITUDE), (named(_RATE), "|rate of turn|"), (rest, ""))
    some, motion = next(((some, motion) for some, motion in kinds if some), ([], ""))
    number = int(max(some, key=columns.rows)) if some else None
    title = next((info["title"] or info["name"] for info in infos if info["id"] == number), "")
    return number, motion or title


def _axes(columns: ColumnStore, number: int, motion: str) -> list[int]:
    """The columns that are components: those with an axis, else all floating-point ones, three at most; of an attitude
    roll and pitch.
    """
    info = next(one for one in columns.manifest["channels"] if one["id"] == number)
    axes = [i for i, column in enumerate(info["columns"]) if column.get("axis")]
    floats = [i for i, column in enumerate(info["columns"]) if column["dtype"].startswith("f")]
    return (floats or [0])[:2] if motion == ATTITUDE else (axes or floats or [0])[:3]


INDEX = ".index"


def write_index(folder: Path, path: Path, summary: Mapping[str, Any], decoder: str) -> None:
    """Store the index of an opened recording in the folder of the library."""
    stat = path.stat()
    key = {"size": stat.st_size, "modified_ns": stat.st_mtime_ns, "reading": _choices(path), "decoder": decoder}
    # one that has only its file's name, which may change, has none
    devices = [{**one, "name": "" if one["name"] == path.name else one["name"]} for one in summary["devices"]]
    body = {**key, **summary, "devices": devices}
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
