"""Decoded columns as tables: the formats whose writers take longer to import, which they are on first use."""

from imuscope.recordings.exporters.registry import ExportFormat, lazy, register_exporter

for _place, (_name, _title, _suffix, _module, _label, _words, _per_byte) in enumerate(
    (
        ("csv", "CSV", ".csv", "csv_tables", "", "full precision, units, one table per message", 1.4),
        (
            "csv-aligned",
            "CSV, aligned",
            ".csv",
            "csv_aligned",
            "CSV, one table",
            "rows aligned to the fastest message",
            4.4,
        ),
        ("parquet", "Parquet", ".parquet", "parquet", "", "one table per message", 1.3),
        ("mcap", "MCAP, decoded", ".mcap", "mcap_decoded", "MCAP", "decoded, with schemas, for other viewers", 4.4),
    )
):
    _write = lazy(f"imuscope.recordings.exporters.{_module}")
    register_exporter(
        ExportFormat(
            _name,
            _title,
            _suffix,
            _write,
            10 * _place,
            _label,
            _words,
            takes_units=True,
            per_byte=_per_byte,
        )
    )
