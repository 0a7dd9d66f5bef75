"""Parquet: a file per message, units in the fields' metadata (recordings/exporters/parquet.py)."""

from __future__ import annotations

from imuscope.recordings.exporters.registry import ExportFormat, lazy, register_exporter

register_exporter(
    ExportFormat(
        "parquet",
        "Parquet",
        ".parquet",
        lazy("imuscope.recordings.exporters.parquet"),
        order=20,
        words="one table per message",
        per_byte=1.3,
    )
)
