"""`python -m server.library.export_worker`: one export written in a process of its own, for export_jobs.py.

A wish comes on standard input, one JSON object: format, store, source, title, t0, t1, channels, device, base, out. What
goes out are JSON lines: {"progress": 0..1} as it goes on, then {"files": […]}, or {"message", "hint"} when it cannot.
A process that is told to end (SIGTERM) leaves nothing behind.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import sys
from pathlib import Path
from typing import Any, NoReturn

from recordings.bounds import TooLong, bounded
from recordings.column_store import ColumnStore
from recordings.exporters import ExportRequest, export
from recordings.mcap_writer import RecordingError
from recordings.parent_death import die_with_parent

STEP = 0.005


def main() -> int:
    """Export what standard input asks for; 0, or 1 when it could not be done and was told."""
    with contextlib.suppress(OSError):
        os.nice(10)  # live devices come first, and opening recordings
    signal.signal(signal.SIGTERM, _end)
    die_with_parent()
    bounded()
    told = json.loads(sys.stdin.read())
    shown = 0.0

    def step(share: float) -> None:
        nonlocal shown
        if share >= shown + STEP:
            shown = share
            _say(progress=round(min(share, 1.0), 3))

    try:
        files = export(told["format"], wish_of(told), Path(told["out"]), step)
    except RecordingError as error:
        _say(message=error.message, hint=error.hint)
        return 1
    except MemoryError:
        _say(message="Exporting it takes more memory than it may have.", hint="Export a shorter stretch.")
        return 1
    except TooLong:
        _say(message="Exporting it takes more time than it may have.", hint="Export a shorter stretch.")
        return 1
    except (OSError, ValueError, KeyError):
        _say(message="The recording changed while it was exported.", hint="Export it again.")
        return 1
    _say(files=[str(file) for file in files])
    return 0


def wish_of(told: dict[str, Any]) -> ExportRequest:
    """The wish that standard input tells."""
    return ExportRequest(
        ColumnStore(Path(told["store"])),
        Path(told["source"]),
        told["title"],
        -math.inf if told["t0"] is None else told["t0"],
        math.inf if told["t1"] is None else told["t1"],
        None if told["channels"] is None else tuple(told["channels"]),
        told["device"],
        told["base"],
    )


def _end(number: int, frame: object) -> NoReturn:
    raise SystemExit(143)


def _say(**words: object) -> None:
    print(json.dumps(words), flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
