"""Files of recordings in progress, and the data in them."""

from __future__ import annotations

import os
from pathlib import Path

from imuscope.recordings.mcap.writer import McapWriter


def recording(path: Path, frames_: bytes, size: int = 2000) -> None:
    """A recording of these bytes."""
    writer = McapWriter(path, {"title": path.stem})
    writer.device("1", {"protocol": "xbus", "source": "/dev/ttyUSB0"})
    for k in range(0, len(frames_), size):
        writer.chunk("1", "rx", frames_[k : k + size], 1_700_000_000_000_000_000 + 40_000 * k)
    writer.close()


def hidden(folder: Path) -> list[str]:
    """Unfinished files, and files that resemble them."""
    results = [Path(place, name) for place, folders, files in os.walk(folder) for name in (*folders, *files)]
    names = [path for path in results if path.name.endswith((".making", ".packing", ".export"))]
    return [str(path.relative_to(folder)) for path in (*names, *(folder / "exports").glob("*"))]
