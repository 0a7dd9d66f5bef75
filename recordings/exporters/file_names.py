"""File names of exports. OUT's stem, the device where there are several, the message."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from imuscope.recordings.exporters.message_table import MessageTable
from imuscope.recordings.exporters.request import ExportRequest


def table_paths(request: ExportRequest, out: Path, tables: Sequence[MessageTable]) -> list[Path]:
    """A path for each table: run_MTData2.csv, run_MTi-630_MTData2.csv."""
    several = request.has_several_devices
    names: set[str] = set()
    paths = []
    for table in tables:
        words = [out.stem, *([request.device_name(table.device)] if several else []), table.name]
        stem = "_".join([words[0], *(plain(word) for word in words[1:])])
        name, count = f"{stem}{out.suffix}", 1
        while name.lower() in names:
            count += 1
            name = f"{stem}_{count}{out.suffix}"
        names.add(name.lower())
        paths.append(out.with_name(name))
    return paths


def plain(text: str) -> str:
    """Letters, digits, dot, dash and underscore of a text."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("-.") or "x"
