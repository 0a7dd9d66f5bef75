"""Evidence as an output of `imuscope decode`: OUT.html."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

from imuscope.recordings.exporters import ExportRequest
from imuscope.server.extensions.evidence.content import About, all_plots
from imuscope.server.extensions.evidence.request import EvidenceRequest
from imuscope.server.extensions.evidence.worker import write
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
