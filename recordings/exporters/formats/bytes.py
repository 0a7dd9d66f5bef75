"""Bytes of one device: unchanged, and as logs of the vendors' own formats (recordings/exporters/raw_bytes.py).

Also a part of a recording as one of its own (recordings/exporters/kept_range.py).
"""

from imuscope.protocols.registry.families import log_formats
from imuscope.recordings.exporters.raw_bytes import log_writer, write_bytes
from imuscope.recordings.exporters.registry import ExportFormat, lazy, register_exporter

for family, log in log_formats():
    if log.exported:
        register_exporter(
            ExportFormat(
                log.name,
                log.title,
                log.suffix,
                log_writer(family, log),
                order=50,
                label=log.name.upper(),
                words=log.words,
                needs_source=True,
                protocol=family.name,
            )
        )
register_exporter(
    ExportFormat(
        "bytes",
        "Original bytes",
        ".bin",
        write_bytes,
        order=60,
        label="Bytes",
        words="as received",
        needs_source=True,
    )
)
register_exporter(
    ExportFormat(
        "recording",
        "Recording of imuscope",
        ".imuscope.mcap",
        lazy("imuscope.recordings.exporters.kept_range"),
        order=55,
        label="Recording",
        words="its bytes, events and markers: opens here again",
        per_byte=0.6,
    )
)
