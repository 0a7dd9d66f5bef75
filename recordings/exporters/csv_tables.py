"""CSV: one file per message, a line per moment, numbers in full.

    time (s),arrival (s),PacketCounter,Acceleration.x (m/s²),…
    1760000000.012300000,1760000000.015100000,17,-0.03421,…

A number has as many digits as needed to read back the same float32 or float64; NaN is `nan`, infinity `inf`; a cell for
which the device sent nothing is empty. Times are unix seconds, to the nanosecond. Units are those of the request.
Undescribed payloads are hex digits.
"""

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv

from imuscope.recordings.exporters.file_names import write_tables
from imuscope.recordings.exporters.message_table import MessageTable, batches, headings
from imuscope.recordings.exporters.request import ExportRequest, ExportStep

FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")  # starts a formula in a spreadsheet. Source: OWASP, "CSV Injection"


def write(request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """One file per message beside `out`."""

    def write_table(table: MessageTable, path: Path, step: ExportStep) -> None:
        with path.open("wb") as file:
            heading(file, headings(table))
            for batch in batches(request, table, step):
                lines(file, batch)

    return write_tables(request, out, step, write_table)


def heading(file: BinaryIO, names: Sequence[str]) -> None:
    """The first line."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow([_inert(name) for name in names])
    file.write(text.getvalue().encode())


def _inert(name: str) -> str:
    """A heading that no spreadsheet takes for a formula: a recording may come from a stranger."""
    return f"'{name}" if name.startswith(FORMULA) else name


_PLAIN = pa.csv.WriteOptions(include_header=False, quoting_style="none", batch_size=1 << 14)


def lines(file: BinaryIO, batch: pa.RecordBatch) -> None:
    plain = pa.RecordBatch.from_arrays([_plain(column) for column in batch.columns], names=batch.schema.names)
    pa.csv.write_csv(plain, file, _PLAIN)


def _plain(column: pa.Array) -> pa.Array:
    """Times as unix s to the ns, bytes as hex digits; anything else as it is."""
    if pa.types.is_timestamp(column.type):
        ns = column.cast(pa.int64()).fill_null(0).to_numpy(zero_copy_only=False)
        wide = np.column_stack((ns, ns >> 63))  # 128-bit integers
        decimal = pa.Array.from_buffers(pa.decimal128(38, 9), len(ns), [None, pa.py_buffer(wide)])
        return pc.if_else(column.is_valid(), decimal, None) if column.null_count else decimal
    if not pa.types.is_binary(column.type):
        return column
    return pa.array([None if one is None else one.hex() for one in column.to_pylist()], pa.string())
