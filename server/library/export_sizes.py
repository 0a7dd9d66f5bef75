"""`python -m imuscope.server.library.export_sizes`: estimate sizes of exports by writing a sample of each.

Compression depends on the data: columns of a sensor at rest shrink to a tenth of those of a drive. So a range from the
middle and one twice as long are written exactly like an export, including the zip; their difference is the cost of
rows, and the rest is constant.

    size ≈ second + (rows of all - rows of second) · (second - first) / (rows of second - rows of first)

A short recording is written completely. The request comes on standard input, one JSON object: store, title, t0, t1,
channels, base; the output is a line of JSON, {"sizes": {format: bytes}, "devices": {device: received bytes}}.
"""

import contextlib
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.exporters import FORMATS, ExportRequest, export
from imuscope.recordings.system.parent_death import report_to_parent
from imuscope.recordings.system.resource_limits import TooLong
from imuscope.server.library.export_worker import one_file, request_of
from imuscope.server.system.worker_process import begin

SAMPLED = tuple(name for name, one in FORMATS.items() if not one.needs_source)
MAX_WHOLE_ROWS = 12_000  # rows of channels up to which everything is written
SAMPLE_ROWS = 6_000  # rows of channels in the first sample


def sizes(request: ExportRequest, folder: Path) -> dict[str, int]:
    """Estimated size of an export, bytes, by format, without formats that cannot be written.

    Args:
        request: channels and time range; device and source are ignored.
        folder: folder for the samples, which are deleted again.
    """
    total = _rows(request)
    if total == 0:
        return {}
    samples = [request] if total <= MAX_WHOLE_ROWS else _samples(request, total)
    counts = [_rows(one) for one in samples]
    by_format: dict[str, int] = {}
    for export_format in SAMPLED:
        with contextlib.suppress(RecordingError):
            first, *more = [_written(export_format, one, folder) for one in samples]
            if more and counts[1] > counts[0]:
                per_row = max(0.0, more[0] - first) / (counts[1] - counts[0])
                by_format[export_format] = round(more[0] + per_row * (total - counts[1]))
            else:
                by_format[export_format] = round(first * total / max(1, counts[0]))
    return by_format


def received_bytes(request: ExportRequest) -> dict[str, int]:
    """Estimated number of bytes received from each device in the time range, as far as counted."""
    message = request.columns.manifest
    whole = replace(request, t0=-np.inf, t1=np.inf, channels=None)
    part = replace(request, channels=None)
    counts: dict[str, int] = {}
    for device, figures in message["figures"].items():
        of_all = _rows(replace(whole, device=device))
        if figures.get("bytes") and of_all:
            counts[device] = round(figures["bytes"] * _rows(replace(part, device=device)) / of_all)
    return counts


def _samples(request: ExportRequest, total: int) -> list[ExportRequest]:
    """Two time ranges around the middle, the second twice as long as the first."""
    first, last = request.columns.span(base=request.base) or (0.0, 0.0)
    first, last = max(first, request.t0), min(last, request.t1)
    middle, half = (first + last) / 2, (last - first) / 2 * SAMPLE_ROWS / total
    return [replace(request, t0=middle - half * times, t1=middle + half * times) for times in (1, 2)]


def _rows(request: ExportRequest) -> int:
    """Total number of rows of all chosen channels."""
    return sum(past - at for at, past in (request.rows(info["id"]) for info in request.infos))


def _written(export_format: str, request: ExportRequest, folder: Path) -> int:
    with tempfile.TemporaryDirectory(dir=folder) as name:
        files = export(export_format, request, Path(name) / f"sample{FORMATS[export_format].suffix}")
        return one_file(files, Path(name), "sample-zip").stat().st_size


def main() -> int:
    """Measure the export that standard input requests. Returns 0, or 1 on failure."""
    message = begin(10)
    request = request_of({"source": "", "device": "", **message})
    try:
        with tempfile.TemporaryDirectory(dir=message["folder"]) as folder:
            answer: Mapping[str, Mapping[str, int]] = {
                "sizes": sizes(request, Path(folder)),
                "devices": received_bytes(request),
            }
    except (RecordingError, MemoryError, TooLong, OSError, ValueError, KeyError):
        return 1
    report_to_parent(**answer)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
