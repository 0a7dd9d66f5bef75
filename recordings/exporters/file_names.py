"""Files of exports that have one for each message: OUT's stem, the device where there are several, the message."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from imuscope.recordings.exporters.message_table import MessageTable, tables
from imuscope.recordings.exporters.request import ExportRequest, ExportStep


def write_tables(
    request: ExportRequest, out: Path, step: ExportStep, write: Callable[[MessageTable, Path, ExportStep], None]
) -> list[Path]:
    """Write a file for each message beside `out`; returns them."""
    message_tables = tables(request)
    paths = table_paths(request, out, message_tables)
    for number, (table, path) in enumerate(zip(message_tables, paths, strict=True)):

        def part(share: float, number: int = number) -> None:
            step((number + share) / len(message_tables))

        write(table, path, part)
    return paths


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
