"""What is a recording's file called? After when it began and what was recorded: 20261121T044324Z-MTi-630.mcap.

The name is the recording's id. Words from outside (a device's name) give letters, digits, dash and underscore, never a
path; a name that is taken gets a number.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from recordings.mcap_writer import SUFFIX

_LONGEST = 40


def slug(text: str) -> str:
    """Letters, digits, dash and underscore of a text."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", text)[:_LONGEST].strip("-")


def device_names(devices: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """What each device is called where names must differ: entities, topics, frames, files. By id.

    Args:
        devices: with "id" and "name"; the first of a name keeps it, the second is "MTi-630-2" by its id.
    """
    names: dict[str, str] = {}
    for device in devices:
        name = str(device["name"]) or str(device["id"])
        names[str(device["id"])] = f"{name}-{device['id']}" if name in names.values() else name
    return names


def free_path(folder: Path, time_s: float, words: str) -> Path:
    """A path in `folder` that is not taken.

    Args:
        time_s: when it began, unix s.
        words: what it holds; may be empty.
    """
    stamp = datetime.fromtimestamp(time_s, UTC).strftime("%Y%m%dT%H%M%SZ")
    stem = "-".join(part for part in (stamp, slug(words)) if part)
    path, count = folder / f"{stem}{SUFFIX}", 1
    while path.exists():
        count += 1
        path = folder / f"{stem}-{count}{SUFFIX}"
    return path
