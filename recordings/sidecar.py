"""Sidecar file: changes to the metadata of a recording, kept in a small file beside it.

    20261121T044324Z-MTi-630.mcap
    20261121T044324Z-MTi-630.mcap.json    {"imuscope": 1, "title": …, "tags": […], "notes": …, "pinned": …,
                                           "markers": [{"id", "time", "kind", "text", "device"}],
                                           "reading": {…}}  how it is read (recordings/tables/options.py)

Anything not in it stays as in the recording: in the metadata `edit` of an MCAP file, with the same fields as strings
(lists as JSON), so that a download carries them to another imuscope; a CSV file has them in a comment line. The sidecar
wins.

It is written completely or not at all. An unreadable one is ignored; it is kept under another name when it is replaced.
"""

from __future__ import annotations

import contextlib
import functools
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from imuscope.recordings.errors import RecordingError, check_format_version
from imuscope.recordings.system import atomic_write
from imuscope.recordings.system.regular_file import open_regular, read_regular
from imuscope.recordings.system.tolerant_json import loads
from imuscope.recordings.tables.options import FileReading, reading_from

SUFFIX = ".json"
VERSION = 1
MAX_BYTES = 4 << 20


@dataclass(frozen=True, slots=True)
class MarkerInfo:
    """A marker or note that was added later."""

    time: float  # unix s
    kind: Literal["marker", "note"] = "marker"
    text: str = ""
    device: str = ""
    id: int = 0


@dataclass(frozen=True, slots=True)
class Edits:
    """Changes to a recording; None: unchanged."""

    title: str | None = None
    tags: tuple[str, ...] | None = None
    notes: str | None = None
    pinned: bool | None = None
    markers: tuple[MarkerInfo, ...] = field(default=())
    reading: FileReading | None = None

    def over(self, older: Edits) -> Edits:
        """These edits, filled up from older ones."""
        known = {marker.id for marker in self.markers}
        return Edits(
            older.title if self.title is None else self.title,
            older.tags if self.tags is None else self.tags,
            older.notes if self.notes is None else self.notes,
            older.pinned if self.pinned is None else self.pinned,
            (*(marker for marker in older.markers if marker.id not in known), *self.markers),
            older.reading if self.reading is None else self.reading,
        )

    def with_marker(self, marker: MarkerInfo) -> Edits:
        """These edits with one more marker, which gets a new id."""
        number = max((one.id for one in self.markers), default=FIRST_MARKER - 1) + 1
        return replace(self, markers=(*self.markers, replace(marker, id=number)))

    def as_metadata(self) -> dict[str, str]:
        """Changes as written to the metadata `edit` of an MCAP file."""
        out = {}
        if self.title is not None:
            out["title"] = self.title
        if self.tags is not None:
            out["tags"] = json.dumps(self.tags, ensure_ascii=False)
        if self.notes is not None:
            out["notes"] = self.notes
        if self.pinned is not None:
            out["pinned"] = "true" if self.pinned else "false"
        if self.markers:
            out["markers"] = json.dumps([_plain(marker) for marker in self.markers], ensure_ascii=False)
        if self.reading:
            out["reading"] = json.dumps(self.reading.as_json(), ensure_ascii=False)
        return out


class ChangedError(RecordingError):
    """Change of what is to be replaced since it was read."""


def expect_notes(edits: Edits, before: str | None) -> None:
    """Raise ChangedError unless the notes are those that the client read; None: any."""
    if before is not None and (edits.notes or "") != before:
        raise ChangedError("The notes were changed elsewhere.", "Read them again, and add your words to them.")


CSV_EDIT = "# imuscope edit: "  # starts the first line of an exported CSV file
FIRST_MARKER = 1_000_001  # ids of markers added later start here: those of the file itself are counted from 1


def sidecar_path(path: Path) -> Path:
    """The sidecar file of a recording."""
    return path.with_name(path.name + SUFFIX)


def read(path: Path) -> Edits:
    """Changes to the recording at `path`; empty if there is no readable sidecar."""
    return from_plain(_load(sidecar_path(path)))


def stored_reading(path: Path) -> FileReading | None:
    """Choices on how the recording at `path` is read, in its sidecar; None without any.

    A sidecar that has not changed is not read again: a list of recordings asks for each.
    """
    try:
        stamp = sidecar_path(path).stat()
    except OSError:
        return None
    return _reading_in(path, stamp.st_size, stamp.st_mtime_ns)


@functools.lru_cache(maxsize=4096)
def _reading_in(path: Path, size: int, changed_ns: int) -> FileReading | None:
    return read(path).reading


def chosen_reading(path: Path, head: bytes) -> FileReading:
    """Choices on how the file at `path` is read: in its sidecar, else in the comment of an exported CSV file.

    Args:
        head: its first bytes.
    """
    reading = stored_reading(path)
    if reading is None and CSV_EDIT.encode() in head[: len(CSV_EDIT) + 3]:
        with contextlib.suppress(OSError), open_regular(path) as file:
            reading = from_csv(file.readline(MAX_BYTES)).reading
    return reading or FileReading()


def write(path: Path, edits: Edits) -> None:
    """Store the edits beside the recording at `path`.

    Raises:
        OSError: it cannot be written; the old one stays.
        RecordingError: the old one was written by a newer imuscope, and stays.
    """
    target = sidecar_path(path)
    if why := refused(path):
        raise why
    body: dict[str, Any] = {"imuscope": VERSION}
    for name in ("title", "tags", "notes", "pinned"):
        value = getattr(edits, name)
        if value is not None:
            body[name] = list(value) if name == "tags" else value
    if edits.markers:
        body["markers"] = [_plain(marker) for marker in edits.markers]
    if edits.reading is not None:
        body["reading"] = edits.reading.as_json()
    if target.exists() and not _load(target):
        atomic_write.replace(target, target.with_name(f".{target.name}.unreadable"))
    atomic_write.write_atomic(target, json.dumps(body, ensure_ascii=False, indent=1))


def refused(path: Path) -> RecordingError | None:
    """Reason why the edits of the recording at `path` are refused; None if they are read, or absent."""
    target = sidecar_path(path)
    try:
        body = json.loads(read_regular(target)) if 0 < target.stat().st_size <= MAX_BYTES else {}
    except (OSError, ValueError, RecursionError):
        return None
    return check_format_version(target.name, body.get("imuscope"), VERSION) if isinstance(body, dict) else None


def error_of(path: Path) -> RecordingError | None:
    """Reason why the edits of the recording at `path` are not shown: damaged, or of a newer imuscope; else None."""
    target = sidecar_path(path)
    if why := refused(path):
        return why
    if not target.exists() or _load(target):
        return None
    words = f"{target.name} is damaged, so the title, tags, notes and pin kept in it are not shown."
    return RecordingError(words, "It is kept under another name when you change one of them.")


def from_plain(body: Mapping[str, Any]) -> Edits:
    """Edits of parsed JSON; a value of the wrong type is ignored."""
    tags = body.get("tags")
    markers = body.get("markers")
    return Edits(
        _text(body.get("title")),
        tuple(tag for tag in tags if isinstance(tag, str)) if isinstance(tags, list) else None,
        _text(body.get("notes")),
        body["pinned"] if isinstance(body.get("pinned"), bool) else None,
        tuple(filter(None, map(_marker, markers))) if isinstance(markers, list) else (),
        reading_from(body.get("reading")),
    )


def from_metadata(values: Mapping[str, str]) -> Edits:
    """Edits of the metadata `edit` of an MCAP file."""
    body: dict[str, Any] = {name: values[name] for name in ("title", "notes") if name in values}
    for name in ("tags", "markers", "reading"):
        with contextlib.suppress(ValueError, RecursionError, KeyError):
            body[name] = loads(values[name])
    if "pinned" in values:
        body["pinned"] = values["pinned"].lower() in ("true", "1")
    return from_plain(body)


def from_csv(first: bytes) -> Edits:
    """Edits of the first line of a CSV file; empty if it is not such a line."""
    line = first.decode("utf-8-sig", errors="replace")
    if not line.startswith(CSV_EDIT):
        return Edits()
    try:
        values = loads(line.removeprefix(CSV_EDIT))
    except (ValueError, RecursionError):
        return Edits()
    known = values.items() if isinstance(values, dict) else ()
    return from_metadata({name: value for name, value in known if isinstance(value, str)})


def _load(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > MAX_BYTES:
            return {}
        body = loads(read_regular(path).decode())
    except (OSError, ValueError, RecursionError):
        return {}
    return body if isinstance(body, dict) and body.get("imuscope") == VERSION else {}


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) else None


def _marker(values: Any) -> MarkerInfo | None:
    if not isinstance(values, dict):
        return None
    time, number = values.get("time"), values.get("id")
    if isinstance(time, bool) or not isinstance(time, int | float) or not math.isfinite(time):
        return None
    kind: Literal["marker", "note"] = "note" if values.get("kind") == "note" else "marker"
    text, device = _text(values.get("text")) or "", _text(values.get("device")) or ""
    return MarkerInfo(float(time), kind, text, device, number if isinstance(number, int) else FIRST_MARKER)


def _plain(marker: MarkerInfo) -> dict[str, Any]:
    return {
        "id": marker.id,
        "time": marker.time,
        "kind": marker.kind,
        "text": marker.text,
        "device": marker.device,
    }
