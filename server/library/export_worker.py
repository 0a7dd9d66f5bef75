"""`python -m imuscope.server.library.export_worker`: write one export in a subprocess, for export_jobs.py.

The request comes on standard input, one JSON object: format, store, source, title, t0, t1, channels, device, base, out,
and stem, of the zip if there are several files. The output are JSON lines: {"progress": 0..1}, then {"files": […]}, or
{"message", "hint"} for an error. A process that is stopped (SIGTERM) leaves no files behind.
"""

import math
import shutil
import signal
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.exporters import ExportRequest, export
from imuscope.recordings.exporters.request import ExportStep
from imuscope.recordings.system.parent_death import report_to_parent
from imuscope.server.system.worker_process import begin, progress_reports, reporting


def one_file(files: Sequence[Path], folder: Path, stem: str) -> Path:
    """The file, or a zip into which several files or folders are moved."""
    if len(files) == 1 and files[0].is_file():
        return files[0]
    path = folder / f"{stem}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for file in files:
            for inner in sorted(file.rglob("*")) if file.is_dir() else [file]:
                is_compressed = inner.suffix == ".parquet"  # has its own compression
                way = zipfile.ZIP_STORED if is_compressed else zipfile.ZIP_DEFLATED
                archive.write(inner, inner.relative_to(file.parent), way)
            shutil.rmtree(file) if file.is_dir() else file.unlink()
    return path


def run(work: Callable[[dict[str, Any], ExportStep], list[Path]]) -> None:
    """Run the work that standard input requests.

    Args:
        work: takes the request and a `step` that is called with the progress; returns the files written.
    """
    signal.signal(signal.SIGTERM, _end)
    request = begin(10)
    with reporting("The export", "Export a shorter time range.", _failed):
        files = work(request, progress_reports())
        if request.get("stem"):
            files = [one_file(files, Path(request["out"]).parent, request["stem"])]
    report_to_parent(files=[str(file) for file in files])


def _failed(error: OSError) -> tuple[str, str]:
    words = f"{error.strerror or error}: {Path(error.filename or '').name}".rstrip(": ")
    return f"The export failed. {words}.", "Export it again."


def request_of(message: dict[str, Any]) -> ExportRequest:
    """The export request of a message on standard input."""
    return ExportRequest(
        ColumnStore(Path(message["store"])).in_units(message.get("units", "shown")),
        Path(message["source"]),
        message["title"],
        -math.inf if message["t0"] is None else message["t0"],
        math.inf if message["t1"] is None else message["t1"],
        None if message["channels"] is None else tuple(message["channels"]),
        message["device"],
        message["base"],
    )


def _end(number: int, frame: object) -> NoReturn:
    raise SystemExit(143)


if __name__ == "__main__":
    run(lambda message, step: export(message["format"], request_of(message), Path(message["out"]), step))
