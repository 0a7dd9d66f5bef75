"""Subprocess that writes evidence, for server/library/export_jobs.py.

    python -m imuscope.server.extensions.evidence.worker

The request comes on standard input, one JSON object: store, out, about (content.py) and request (request.py); the
output is as that of server/library/export_worker.py.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.exporters import ExportRequest
from imuscope.recordings.system.atomic_write import SHARED, write_atomic
from imuscope.server.extensions.evidence.content import About, all_plots, content_of
from imuscope.server.extensions.evidence.document import document
from imuscope.server.extensions.evidence.request import EvidenceRequest, request_of
from imuscope.server.http.page_files import FOLDER
from imuscope.server.library.export_worker import run
from imuscope.server.library.recording_detail import channels_of


def write_part(request: ExportRequest, out: Path, with_position: bool, step: Callable[[float], None]) -> list[Path]:
    """Write one HTML file with the plots of a part, its figures, events and settings; see FileOutput.writes."""
    columns = request.columns
    infos = [
        info
        for info in channels_of(columns).values()
        if request.device in ("", info.device) and (request.channels is None or info.id in request.channels)
    ]
    is_part = request.device != "" or request.channels is not None
    plots = all_plots(infos, len(columns.manifest["devices"])) if is_part else None
    t0, t1 = (None if math.isinf(time) else time for time in (request.t0, request.t1))
    evidence_request = EvidenceRequest(t0, t1, plots=plots, with_position=with_position)
    name = request.title
    about = About(Path(name).stem, file=name, format=str(columns.manifest.get("format", "")))
    if not with_position:
        about.title = "Recording"  # a name may be that of a place
    return write(columns, about, evidence_request, out, step)


MAX_BYTES = 20_000_000  # of a file: what mail and ticket systems take
PER_BYTE = 3 / 4  # of base64
MAX_ATTEMPTS = 4
TARGET_SHARE = 0.95  # of the room: sizes are known exactly only afterwards


def write(
    store: ColumnStore, about: About, request: EvidenceRequest, out: Path, step: Callable[[float], None]
) -> list[Path]:
    """Write the file.

    Raises:
        RecordingError: there is nothing to show, or the page has not been built.
    """
    script, style = _viewer("viewer.js"), _viewer("viewer.css")
    room = MAX_BYTES - len(script.encode()) - len(style.encode())
    share = TARGET_SHARE
    for _ in range(MAX_ATTEMPTS):
        content, blocks = content_of(store, about, request, round(room * share * PER_BYTE), step)
        pieces = [piece.encode() for piece in document(content, blocks, script, style)]
        size = sum(map(len, pieces))
        if size <= MAX_BYTES:
            break
        share *= TARGET_SHARE * (room * share) / (room * share + size - MAX_BYTES) if blocks.size else 0.5
    else:
        raise RecordingError("The file would exceed 20 MB.", "Choose a shorter range or fewer plots.")
    write_atomic(out, b"".join(pieces), SHARED)
    return [out]


def _viewer(name: str) -> str:
    try:
        return (FOLDER / "evidence" / name).read_text(encoding="utf-8")
    except OSError:
        raise RecordingError("The page has not been built.", "Run python web/build.py.") from None


def _work(message: dict[str, Any], step: Callable[[float], None]) -> list[Path]:
    return write(
        ColumnStore(Path(message["store"])),
        About(**message["about"]),
        request_of(message["request"]),
        Path(message["out"]),
        step,
    )


if __name__ == "__main__":
    run(_work)
