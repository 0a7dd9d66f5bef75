"""A part of a recording as a recording of its own (recordings/exporters/kept_range.py)."""

from imuscope.recordings.exporters.registry import ExportFormat, lazy, register_exporter

SUFFIX = ".imuscope.mcap"

register_exporter(
    ExportFormat(
        "recording",
        "Recording of imuscope",
        SUFFIX,
        lazy("imuscope.recordings.exporters.kept_range"),
        order=55,
        label="Recording",
        words="its bytes, events and markers: opens here again",
        per_byte=0.6,
    )
)
