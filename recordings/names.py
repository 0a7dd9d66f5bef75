"""What is a recording's file called? After when it began and what was recorded: 20261121T044324Z-MTi-630.mcap.

The name is the recording's id. Words from outside (a device's name) give letters, digits, dash and underscore, never a
path; a name that is taken gets a number.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from pathlib import Path

from recordings.container import SUFFIX

_LONGEST = 40


def slug(text: str) -> str:
    """Letters, digits, dash and underscore of a text."""
    return re.sub(r"[^A-Za-z0-9_-]+", "-", text)[:_LONGEST].strip("-")


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
