"""CSV in one file, a line for each sample of the fastest channel (recordings/exporters/csv_aligned.py)."""

from __future__ import annotations

from imuscope.recordings.exporters.registry import ExportFormat, lazy, register_exporter

register_exporter(
    ExportFormat(
        "csv-aligned",
        "CSV, aligned",
        ".csv",
        lazy("imuscope.recordings.exporters.csv_aligned"),
        order=10,
        label="CSV, one table",
        words="rows aligned to the fastest message",
        per_byte=4.4,
    )
)
