"""Evidence: a range of a recording with all that belongs to it, as one HTML file that opens without a network.

    request.py   what a person chose ──┐
    series.py    samples, thinned ─────┤
    figures.py   over all samples ─────┼──> content.py ──> position.py: left out? ──> document.py ──> FILE.html
    settings, events, notes, versions ─┘                                               + server/page/evidence/viewer.js

It is written in a subprocess (worker.py) as a job of server/library/export_jobs.py.
"""
