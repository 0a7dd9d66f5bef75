"""Route of evidence."""

from __future__ import annotations

from imuscope.server import wire
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.errors import recording_errors, responses
from imuscope.server.api.exports import check_range, check_time
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.extensions.evidence.job import evidence_work
from imuscope.server.extensions.evidence.request import EvidenceRequest

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
