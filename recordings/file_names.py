"""File names of recordings: start time and contents: 20261121T044324Z-MTi-630.mcap; names of uploads, made safe.

The name is the recording's id. External text (a device's name) is reduced to letters, digits, dash and underscore,
never a path; a name in use gets a number.
"""

import os
import re
import unicodedata
from collections.abc import Collection, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

SUFFIX = ".mcap"
_MAX_CHARS = 40
LONGEST_NAME = 120
DEVICES = re.compile(r"(CON|PRN|AUX|NUL|COM\d|LPT\d)(\.|\Z)", re.I)  # reserved names on Windows


def slug(text: str) -> str:
    """Letters, digits, dash and underscore of a text."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", text)[:_MAX_CHARS].strip("-")


def device_names(devices: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Unique name of each device, by id; used for entities, topics, frames and files.

    Args:
        devices: with "id" and "name"; the first with a name keeps it, the second is "MTi-630-2" by its id.
    """
    names: dict[str, str] = {}
    for device in devices:
        name = str(device["name"]) or str(device["id"])
        names[str(device["id"])] = f"{name}-{device['id']}" if name in names.values() else name
    return names


def free_path(folder: Path, time_s: float, words: str) -> Path:
    """An unused path in `folder`.

    Args:
        time_s: start time, unix s.
        words: contents; may be empty.
    """
    stamp = datetime.fromtimestamp(time_s, UTC).strftime("%Y%m%dT%H%M%SZ")
    stem = "-".join(part for part in (stamp, slug(words)) if part)
    path, count = folder / f"{stem}{SUFFIX}", 1
    while path.exists():
        count += 1
        path = folder / f"{stem}-{count}{SUFFIX}"
    return path


def clean_name(name: str, suffixes: Collection[str]) -> str:
    """A safe file name from any name: no folder, not hidden, printable, not a command-line option or a Windows
    device.

    Args:
        suffixes: of the files that the library lists; another file gets ".bin".

    >>> clean_name("../../etc/passwd\\x00", (".csv",))
    'passwd.bin'
    """
    last = re.split(r"[/\\]", unicodedata.normalize("NFC", name))[-1]
    text = "".join(c for c in last if c.isprintable() and c not in '<>:"|?*').rstrip(" .").lstrip(" .-")
    stem, suffix = os.path.splitext(text)
    if suffix.lower() not in suffixes:
        stem, suffix = text, ".bin"
    stem = stem.encode()[: LONGEST_NAME - len(suffix)].decode(errors="ignore").rstrip(" .").lstrip(" .-")
    if DEVICES.match(stem):
        stem = f"_{stem}"
    return f"{stem or 'upload'}{suffix}"
