"""Parquet: one file per message, for pandas, polars, DuckDB and the like.

The columns are those of the CSV (time, arrival, then the message's), with the types of the wire; a cell for which the
device sent nothing is null, which is not NaN. Each field's metadata gives its unit, label and meaning; the file's
metadata the recording, device and message. Undescribed payloads are binary.

    import pyarrow.parquet as pq
    table = pq.read_table("run_MTData2.parquet")
    table.schema.field("Acceleration.x").metadata[b"unit"].decode()    # m/s²
"""

from pathlib import Path

import pyarrow.parquet as pq

from imuscope.recordings.exporters.file_names import write_tables
from imuscope.recordings.exporters.message_table import MessageTable, batches, schema
from imuscope.recordings.exporters.request import ExportRequest, ExportStep


def write(request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    def write_table(table: MessageTable, path: Path, step: ExportStep) -> None:
        metadata = {"recording": request.title, "device": request.device_name(table.device), "message": table.name}
        metadata |= {"simulated": "true"} if request.is_simulated(table.device) else {}
        with pq.ParquetWriter(path, schema(table).with_metadata(metadata), compression="zstd") as writer:
            for batch in batches(request, table, step):
                writer.write_batch(batch.replace_schema_metadata(metadata))

    return write_tables(request, out, step, write_table)
