"""`python -m imuscope.server.library.export_worker`: write one export in a subprocess, for export_jobs.py.

The request comes on standard input, one JSON object: format, store, source, title, t0, t1, channels, device, base, out.
The output are JSON lines: {"progress": 0..1}, then {"files": […]}, or {"message", "hint"} for an error. A process that
is stopped (SIGTERM) leaves no files behind.
"""

from __future__ import annotations

import json
import math
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

from imuscope.recordings.column_store import ColumnStore
from imuscope.recordings.exporters import ExportRequest, export
from imuscope.recordings.exporters.request import ExportStep
from imuscope.recordings.mcap_writer import RecordingError
from imuscope.recordings.parent_death import die_with_parent, report_to_parent
from imuscope.recordings.priority import lower_priority
from imuscope.recordings.resource_limits import TooLong, bounded

STEP = 0.005


def run(work: Callable[[dict[str, Any], ExportStep], list[Path]]) -> int:
    """Run the work that standard input requests. Returns 0, or 1 after a reported error.

    Args:
        work: takes the request and a `step` that is called with the progress; returns the files written.
    """
    lower_priority(10)  # live devices and opening of recordings come first
    signal.signal(signal.SIGTERM, _end)
    die_with_parent()
    bounded()
    message = json.loads(sys.stdin.read())
    shown = 0.0

    def step(share: float) -> None:
        nonlocal shown
        if share >= shown + STEP:
            shown = share
            report_to_parent(progress=round(min(share, 1.0), 3))

    try:
        files = work(message, step)
    except RecordingError as error:
        report_to_parent(message=error.message, hint=error.hint)
        return 1
    except MemoryError:
        report_to_parent(message="The export exceeds the memory limit.", hint="Export a shorter time range.")
        return 1
    except TooLong:
        report_to_parent(message="The export exceeds the time limit.", hint="Export a shorter time range.")
        return 1
    except OSError as error:
        words = f"{error.strerror or error}: {Path(error.filename or '').name}".rstrip(": ")
        report_to_parent(message=f"The export failed. {words}.", hint="Export it again.")
        return 1
    report_to_parent(files=[str(file) for file in files])
    return 0


def main() -> int:
    """Write the export that standard input requests. Returns 0, or 1 after a reported error."""
    return run(lambda message, step: export(message["format"], request_of(message), Path(message["out"]), step))


def request_of(message: dict[str, Any]) -> ExportRequest:
    """The export request of a message on standard input."""
    return ExportRequest(
        ColumnStore(Path(message["store"])),
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
    raise SystemExit(main())
