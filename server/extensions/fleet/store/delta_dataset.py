"""Parquet files of a Delta table as an Arrow dataset that knows which files a condition excludes.

deltalake's own dataset takes a column that a file does not have for one that is never empty: `IS NOT NULL` then holds
for every row of a file that is older than the column. It also takes milliseconds a file to list the statistics of all
its columns. So it is taken from the log here: the partition of each file, the bounds of the columns that questions are
narrowed by, and the signals that it does not have.
"""

from collections.abc import Mapping
from typing import Any
from urllib.parse import unquote

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
import pyarrow.fs as fs
from deltalake import DeltaTable
from deltalake.fs import DeltaStorageHandler
from deltalake.table import MAX_SUPPORTED_READER_VERSION, SUPPORTED_READER_FEATURES

from imuscope.server.extensions.fleet.store.store import StoreError, StoreLocation
from imuscope.server.extensions.fleet.store.tables import SAMPLES, SIGNAL, StoreTable

BOUNDED = ("recording", "robot", "time", "minute", "started", "signal")


def dataset_of(store: StoreLocation, table: DeltaTable, kind: StoreTable) -> ds.Dataset:
    """The rows of a table, read from its files as they are requested."""
    actions = pa.table(table.get_add_actions(flatten=True))
    names = [unquote(name) for name in actions.column("path").to_pylist()]  # the log has them as URLs
    schema = pa.schema(table.schema().to_arrow())
    file_format = ds.ParquetFileFormat(default_fragment_scan_options=ds.ParquetFragmentScanOptions(pre_buffer=True))
    files = _files(store, kind, dict(zip(names, actions.column("size_bytes").to_pylist(), strict=True)))
    guarantees = _Guarantees(actions, schema, kind)
    fragments = [
        file_format.make_fragment(name, filesystem=files, partition_expression=guarantees.of(row))
        for row, name in enumerate(names)
    ]
    return ds.FileSystemDataset(fragments, schema, file_format, files)


def check_readable(store: StoreLocation, table: DeltaTable) -> None:
    """Refuse a table that another engine has given features that change what its files mean.

    Raises:
        StoreError: it has deletion vectors, mapped columns or the like.
    """
    protocol = table.protocol()
    unknown = sorted({*(protocol.reader_features or ())} - SUPPORTED_READER_FEATURES)
    if protocol.min_reader_version > MAX_SUPPORTED_READER_VERSION or unknown:
        words = ", ".join(unknown) or f"reader version {protocol.min_reader_version}"
        raise StoreError(f"{store.url}: a table needs {words}", "Update imuscope, or take the feature from the table.")


def _files(store: StoreLocation, kind: StoreTable, sizes: dict[str, int]) -> fs.FileSystem:
    """The folder of a table. That of the machine is Arrow's own: it needs no call of Python for each read."""
    if store.folder is not None:
        return fs.SubTreeFileSystem(str(store.folder / "tables" / kind.name), fs.LocalFileSystem())
    return fs.PyFileSystem(DeltaStorageHandler(store.table(kind.name), store.options, sizes))


class _Guarantees:
    """Conditions that every row of a file fulfils, from partitions and statistics in the log."""

    def __init__(self, actions: pa.Table, schema: pa.Schema, kind: StoreTable) -> None:
        self._columns: Mapping[str, Any] = {name: actions.column(name) for name in actions.column_names}
        self._schema = schema
        self._kind = kind

    def of(self, row: int) -> pc.Expression:
        """That of the file in a row of the log."""
        holds = pc.scalar(True)
        for name in self._kind.partitions:
            if (value := self._value(f"partition.{name}", row)) is not None:
                holds = holds & (pc.field(name) == value.cast(self._schema.field(name).type))
        for name in BOUNDED:
            low, high = self._value(f"min.{name}", row), self._value(f"max.{name}", row)
            empty = self._value(f"null_count.{name}", row)
            if low is not None and high is not None and empty is not None and empty.as_py() == 0:
                column_type = self._schema.field(name).type
                holds = holds & (pc.field(name) >= low.cast(column_type)) & (pc.field(name) <= high.cast(column_type))
        if self._kind is SAMPLES and self._value("num_records", row) is not None:
            for field in self._schema:  # the log counts the values of every column of a file: others are not there
                if (field.metadata or {}).get(SIGNAL) and self._value(f"null_count.{field.name}", row) is None:
                    holds = holds & pc.field(field.name).is_null()
        return holds

    def _value(self, name: str, row: int) -> Any:
        """A value of the log; None where it has none."""
        column = self._columns.get(name)
        value = column[row] if column is not None else None
        return value if value is not None and value.is_valid else None
