"""Parquet files of a Delta table as an Arrow dataset that knows which files a condition excludes.

deltalake's own dataset takes a column that a file does not have for one that is never empty: `IS NOT NULL` then holds
for every row of a file that is older than the column. So what is known of each file is said here: its partition, the
bounds of the columns that questions are narrowed by, and the signals that it does not have.
"""

from __future__ import annotations

from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
from deltalake import DeltaTable

from server.fleet.tables import SAMPLES, SIGNAL, StoreTable

BOUNDED = ("recording", "robot", "time", "minute", "started", "signal")


def dataset_of(table: DeltaTable, kind: StoreTable) -> ds.Dataset:
    """The rows of a table, read from its files as they are asked for."""
    found = table.to_pyarrow_dataset()
    known = _known(table)
    fragments = [
        found.format.make_fragment(
            fragment.path,
            filesystem=fragment.filesystem,
            partition_expression=_guarantee(known.get(_file_name(fragment.path), {}), found.schema, kind),
        )
        for fragment in found.get_fragments()
    ]
    return ds.FileSystemDataset(fragments, found.schema, found.format, found.filesystem)


def _file_name(path: str) -> str:
    """The last part of a path: unique, and without the characters that are escaped in the others."""
    return path.rpartition("/")[2]


def _known(table: DeltaTable) -> dict[str, dict[str, Any]]:
    """Partition and statistics of each file in the log, by its name."""
    actions = pa.table(table.get_add_actions(flatten=True))
    wanted = [
        name
        for name in actions.column_names
        if name == "path"
        or name.startswith(("partition.", "null_count."))
        or (name.startswith(("min.", "max.")) and name[4:] in BOUNDED)
    ]
    return {_file_name(row["path"]): row for row in actions.select(wanted).to_pylist()}


def _guarantee(known: dict[str, Any], schema: pa.Schema, kind: StoreTable) -> pc.Expression:
    """Condition that every row of a file fulfils."""
    holds = pc.scalar(True)
    for name in kind.partitions:
        if (value := known.get(f"partition.{name}")) is not None:
            holds = holds & (pc.field(name) == pa.scalar(value, schema.field(name).type))
    for name in BOUNDED:
        low, high = known.get(f"min.{name}"), known.get(f"max.{name}")
        if low is not None and high is not None and known.get(f"null_count.{name}") == 0:
            type = schema.field(name).type
            holds = holds & (pc.field(name) >= pa.scalar(low, type)) & (pc.field(name) <= pa.scalar(high, type))
    if kind is SAMPLES and known:
        for field in schema:  # the log counts the values of every column of a file: what it does not count is not there
            if (field.metadata or {}).get(SIGNAL) and known.get(f"null_count.{field.name}") is None:
                holds = holds & pc.field(field.name).is_null()
    return holds
