"""Route of evidence."""

from collections.abc import Sequence
from dataclasses import asdict

from imuscope.recordings.sidecar import MarkerInfo
from imuscope.server import wire
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import recording_errors, responses
from imuscope.server.api.exports import check_range, check_time
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.extensions.evidence.request import EvidenceRequest
from imuscope.server.library.api_models import RecordingInfo
from imuscope.server.library.export_jobs import ExportWork, file_stem

router = lazy_router(prefix="/api/recordings", tags=["exports"])


@router.post("/{recording}/evidence", status_code=202, responses=responses(404, 409, 422))
async def add_evidence(recording: str, body: EvidenceRequest, services: TheServices) -> wire.ExportJob:
    """Begin to make evidence: one HTML file with plots, figures, notes, events and settings; a job like an export."""
    check_range(body.t0, body.t1)
    for name, cursor in (("cursor_a", body.cursor_a), ("cursor_b", body.cursor_b)):
        check_time(name, cursor)
    with recording_errors(recording):
        await services.catalogue.entry(recording)
        info, markers = services.catalogue.info(recording), services.catalogue.markers(recording)
        return services.exports.add_work(recording, evidence_work(info, markers, body))


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
