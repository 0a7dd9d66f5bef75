"""What a person changed about a recording, where the file itself stays as it is: a small file beside it.

    20261121T044324Z-MTi-630.mcap
    20261121T044324Z-MTi-630.mcap.json    {"imuscope": 1, "title": …, "tags": […], "notes": …, "pinned": …,
                                           "markers": [{"id", "time", "kind", "text", "device"}]}

What is not in it stays as the recording has it: in the metadata `edit` of an MCAP file, where the same words stand as
strings (lists as JSON), so that a download carries them to another imuscope; a CSV file has them in a line of comment.
The file beside wins.

It is written whole or not at all. One that cannot be read counts as none; it is kept under another name when something
is written in its place.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from recordings import atomic_write
from recordings.mcap_writer import RecordingError, check_format_version
from recordings.tolerant_json import loads

SUFFIX = ".json"
VERSION = 1
MOST_BYTES = 4 << 20


@dataclass(frozen=True, slots=True)
class Marker:
    """A marker or note that was put in later; `time` in unix s."""

    time: float
    kind: str = "marker"
    text: str = ""
    device: str = ""
    id: int = 0


@dataclass(frozen=True, slots=True)
class Edits:
    """What a person changed; None: nothing was said."""

    title: str | None = None
    tags: tuple[str, ...] | None = None
    notes: str | None = None
    pinned: bool | None = None
    markers: tuple[Marker, ...] = field(default=())

    def over(self, older: Edits) -> Edits:
        """These, and where nothing was said, the older ones."""
        known = {marker.id for marker in self.markers}
        return Edits(
            older.title if self.title is None else self.title,
            older.tags if self.tags is None else self.tags,
            older.notes if self.notes is None else self.notes,
            older.pinned if self.pinned is None else self.pinned,
            (*(marker for marker in older.markers if marker.id not in known), *self.markers),
        )

    def with_marker(self, marker: Marker) -> Edits:
        """One more; it gets an id of its own."""
        number = max((one.id for one in self.markers), default=FIRST_MARKER - 1) + 1
        return replace(self, markers=(*self.markers, replace(marker, id=number)))

    def as_metadata(self) -> dict[str, str]:
        """As they stand in the metadata `edit` of an MCAP file."""
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
        return out


CSV_EDIT = "# imuscope edit: "  # begins the first line of a CSV file that was handed over
FIRST_MARKER = 1_000_001  # ids of markers put in later begin here: those of the file itself are counted from 1


def sidecar_path(path: Path) -> Path:
    """The file that belongs to a recording."""
    return path.with_name(path.name + SUFFIX)


def read(path: Path) -> Edits:
    """What was changed about the recording at `path`; nothing where there is no file, or none that can be read."""
    return from_plain(_load(sidecar_path(path)))


def write(path: Path, edits: Edits) -> None:
    """Keep it beside the recording at `path`.

    Raises:
        OSError: it cannot be written; what was there stays.
        RecordingError: what is there was written by a newer imuscope, and stays.
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
    if target.exists() and not _load(target):
        os.replace(target, target.with_name(f".{target.name}.unreadable"))
    atomic_write.write_atomic(target, json.dumps(body, ensure_ascii=False, indent=1))


def refused(path: Path) -> RecordingError | None:
    """Why what was changed about the recording at `path` is not read; None where it is, and where there is nothing."""
    target = sidecar_path(path)
    try:
        body = json.loads(target.read_text(encoding="utf-8")) if 0 < target.stat().st_size <= MOST_BYTES else {}
    except (OSError, ValueError, RecursionError):
        return None
    return check_format_version(target.name, body.get("imuscope"), VERSION) if isinstance(body, dict) else None


def trouble(path: Path) -> RecordingError | None:
    """Why what was changed about the recording at `path` is not shown: damaged, or of a newer imuscope; else None."""
    target = sidecar_path(path)
    if why := refused(path):
        return why
    if not target.exists() or _load(target):
        return None
    words = f"{target.name} is damaged, so the title, tags, notes and pin kept in it are not shown."
    return RecordingError(words, "It is kept under another name when you change one of them.")


def from_plain(body: Mapping[str, Any]) -> Edits:
    """Edits of parsed JSON; what has another type than it should was not said."""
    tags = body.get("tags")
    markers = body.get("markers")
    return Edits(
        _text(body.get("title")),
        tuple(tag for tag in tags if isinstance(tag, str)) if isinstance(tags, list) else None,
        _text(body.get("notes")),
        body["pinned"] if isinstance(body.get("pinned"), bool) else None,
        tuple(filter(None, map(_marker, markers))) if isinstance(markers, list) else (),
    )


def from_metadata(told: Mapping[str, str]) -> Edits:
    """Edits of the metadata `edit` of an MCAP file."""
    body: dict[str, Any] = {name: told[name] for name in ("title", "notes") if name in told}
    for name in ("tags", "markers"):
        with contextlib.suppress(ValueError, RecursionError, KeyError):
            body[name] = loads(told[name])
    if "pinned" in told:
        body["pinned"] = told["pinned"].lower() in ("true", "1")
    return from_plain(body)


def from_csv(first: bytes) -> Edits:
    """Edits of the first line of a CSV file; nothing where it is any other line."""
    line = first.decode("utf-8-sig", errors="replace")
    if not line.startswith(CSV_EDIT):
        return Edits()
    try:
        told = loads(line.removeprefix(CSV_EDIT))
    except (ValueError, RecursionError):
        return Edits()
    known = told.items() if isinstance(told, dict) else ()
    return from_metadata({name: value for name, value in known if isinstance(value, str)})


def _load(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > MOST_BYTES:
            return {}
        body = loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return body if isinstance(body, dict) and body.get("imuscope") == VERSION else {}


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) else None


def _marker(told: Any) -> Marker | None:
    if not isinstance(told, dict):
        return None
    time, number = told.get("time"), told.get("id")
    if isinstance(time, bool) or not isinstance(time, int | float) or not math.isfinite(time):
        return None
    kind = "note" if told.get("kind") == "note" else "marker"
    text, device = _text(told.get("text")) or "", _text(told.get("device")) or ""
    return Marker(float(time), kind, text, device, number if isinstance(number, int) else FIRST_MARKER)


def _plain(marker: Marker) -> dict[str, Any]:
    return {
        "id": marker.id,
        "time": marker.time,
        "kind": marker.kind,
        "text": marker.text,
        "device": marker.device,
    }
