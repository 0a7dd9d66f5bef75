"""Evidence: a range of a recording with all that belongs to it, as one HTML file that opens without a network.

    request.py   what a user chose ──┐
    series.py    samples, thinned ─────┼──> content.py ──> position.py: left out? ──> document.py ──> FILE.html
    settings, events, notes, versions ─┘                                               + server/page/evidence/viewer.js

Figures are those of every sample (server/extensions/analysis). Times in notes lead to the plots (document.py). The
file is written in a subprocess (worker.py) as a job of server/library/export_jobs.py.
"""

from imuscope.server.services.extension import Extension, FileOutput

EXTENSION = Extension(
    "evidence",
    "Evidence",
    routes=("imuscope.server.extensions.evidence.routes",),
    outputs=(
        FileOutput(
            ".html",
            "evidence: plots, figures, events and settings in one file",
            "imuscope.server.extensions.evidence.worker:write_part",
            hides_position=True,
        ),
    ),
    requires=("analysis",),
)
