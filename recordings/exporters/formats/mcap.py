"""MCAP: decoded values as JSON with schemas, for other viewers (recordings/exporters/mcap_decoded.py)."""

from __future__ import annotations

from imuscope.recordings.exporters.registry import ExportFormat, lazy, register_exporter

register_exporter(
    ExportFormat(
        "mcap",
        "MCAP, decoded",
        ".mcap",
        lazy("imuscope.recordings.exporters.mcap_decoded"),
        order=30,
        label="MCAP",
        words="decoded, with schemas, for other viewers",
        per_byte=4.4,
    )
)
