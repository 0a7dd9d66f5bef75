"""Evidence as a job of server/library/export_jobs.py."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from imuscope.recordings.sidecar import MarkerInfo
from imuscope.server.extensions.evidence.request import EvidenceRequest
from imuscope.server.library.api_models import RecordingInfo
from imuscope.server.library.export_jobs import ExportWork, file_stem


def evidence_work(info: RecordingInfo, markers: Sequence[MarkerInfo], request: EvidenceRequest) -> ExportWork:
    """The work of a request.

    Args:
        markers: those added after recording.
    """
    about = {
        "title": info.title,
        "notes": info.notes,
        "tags": info.tags,
        "markers": [asdict(marker) for marker in markers],
        "file": info.file,
        "format": info.format,
    }
    words = ["Evidence"]
    if request.t0 is not None and request.t1 is not None:
        words.append(f"{request.t1 - request.t0:.3f} s")
    if not request.with_position:
        words.append("without position")
    name = info.title if request.with_position else "evidence"  # a title may be the name of a place
    stem = file_stem(name, request.t0, request.t1)
    if request.with_position:
        stem += "-evidence"
    message = {"about": about, "request": asdict(request)}
    return ExportWork(
        "evidence", ", ".join(words), "imuscope.server.extensions.evidence.worker", message, stem, ".html"
    )
