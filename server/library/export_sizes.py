"""`python -m server.library.export_sizes`: how large exports will be, found by writing a sample of each.

How well numbers pack depends on the numbers: columns of a sensor at rest shrink to a tenth of those of a drive. So a
stretch out of the middle is written, and one twice as long, exactly as an export would be, zip and all; what the second
has more than the first is what rows cost, and the rest is there once.

    size ≈ second + (rows of all - rows of second) · (second - first) / (rows of second - rows of first)

A short recording is written whole. A wish comes on standard input, one JSON object: store, title, t0, t1, channels,
base; what goes out is a line of JSON, {"sizes": {format: bytes}, "devices": {device: bytes as they came}}.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from recordings.bounds import TooLong, bounded
from recordings.exporters import FORMATS, ExportRequest, export
from recordings.mcap_writer import RecordingError
from recordings.parent_death import die_with_parent
from server.library.export_worker import wish_of
from server.library.one_file import one_file

SAMPLED = tuple(name for name, one in FORMATS.items() if not one.needs_source)
WHOLE = 12_000  # up to so many rows of channels all is written
SAMPLE = 6_000  # rows of channels in the first sample


def sizes(wish: ExportRequest, folder: Path) -> dict[str, int]:
    """About how many bytes an export has, format by format; those that cannot be written are left out.

    Args:
        wish: of which channels and which stretch; its device and source are of no interest.
        folder: where samples are written; they are removed again.
    """
    total = _rows(wish)
    if total == 0:
        return {}
    samples = [wish] if total <= WHOLE else _samples(wish, total)
    counts = [_rows(one) for one in samples]
    found: dict[str, int] = {}
    for format in SAMPLED:
        with contextlib.suppress(RecordingError):
            first, *more = [_written(format, one, folder) for one in samples]
            if more and counts[1] > counts[0]:
                per_row = max(0.0, more[0] - first) / (counts[1] - counts[0])
                found[format] = round(more[0] + per_row * (total - counts[1]))
            else:
                found[format] = round(first * total / max(1, counts[0]))
    return found


def came(wish: ExportRequest) -> dict[str, int]:
    """About how many bytes came of each device in the stretch, as far as that was counted."""
    told = wish.columns.manifest
    whole = replace(wish, t0=-np.inf, t1=np.inf, channels=None)
    part = replace(wish, channels=None)
    found: dict[str, int] = {}
    for device, figures in told["figures"].items():
        of_all = _rows(replace(whole, device=device))
        if figures.get("bytes") and of_all:
            found[device] = round(figures["bytes"] * _rows(replace(part, device=device)) / of_all)
    return found


def _samples(wish: ExportRequest, total: int) -> list[ExportRequest]:
    """Two stretches about the middle, the second twice as long as the first."""
    first, last = wish.columns.span(base=wish.base) or (0.0, 0.0)
    first, last = max(first, wish.t0), min(last, wish.t1)
    middle, half = (first + last) / 2, (last - first) / 2 * SAMPLE / total
    return [replace(wish, t0=middle - half * times, t1=middle + half * times) for times in (1, 2)]


def _rows(wish: ExportRequest) -> int:
    """Rows of all chosen channels together."""
    return sum(past - at for at, past in (wish.rows(info["id"]) for info in wish.infos))


def _written(format: str, wish: ExportRequest, folder: Path) -> int:
    with tempfile.TemporaryDirectory(dir=folder) as name:
        files = export(format, wish, Path(name) / f"sample{FORMATS[format].suffix}")
        return one_file(files, Path(name), "sample-zip").stat().st_size


def main() -> int:
    """Measure what standard input asks for; 0, or 1 when it could not be done."""
    with contextlib.suppress(OSError):
        os.nice(10)  # live devices come first
    die_with_parent()
    bounded()
    told = json.loads(sys.stdin.read())
    wish = wish_of({"source": "", "device": "", **told})
    try:
        with tempfile.TemporaryDirectory(dir=told["folder"]) as folder:
            answer: Mapping[str, Mapping[str, int]] = {"sizes": sizes(wish, Path(folder)), "devices": came(wish)}
    except (RecordingError, MemoryError, TooLong, OSError, ValueError, KeyError):
        return 1
    print(json.dumps(answer), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
