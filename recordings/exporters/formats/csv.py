"""CSV: a file per message, full precision, units in the header (recordings/exporters/csv_tables.py)."""

from __future__ import annotations

from imuscope.recordings.exporters.registry import ExportFormat, lazy, register_exporter

register_exporter(
    ExportFormat(
        "csv",
        "CSV",
        ".csv",
        lazy("imuscope.recordings.exporters.csv_tables"),
        order=0,
        words="full precision, units, one table per message",
        per_byte=1.4,
    )
)
