"""Delta tables of a store: created when first written, appended to exactly once for each recording.

Each append carries the identifier of its recording as an application transaction of the Delta protocol. Before an
append the table is searched for it; of two appends at the same moment, the second to commit is refused, searches again
and finds the first. So an upload that was killed, or that runs twice, adds its rows once. Files of an append that did
not commit stay in the folder of the table; no reader sees them, and a vacuum removes them.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import pyarrow as pa
from deltalake import CommitProperties, DeltaTable, PostCommitHookProperties, Transaction, WriterProperties
from deltalake.exceptions import CommitFailedError, DeltaError, TableNotFoundError
from deltalake.schema import Field as DeltaField
from deltalake.schema import Schema as DeltaSchema
from deltalake.writer import write_deltalake

from imuscope.server.concurrency.backoff import Backoff
from imuscope.server.extensions.fleet.store.store import StoreError, StoreLocation, storage_errors
from imuscope.server.extensions.fleet.store.tables import StoreTable

COMMIT_ATTEMPTS = 60  # of a commit: each one that fails has lost to another that succeeded
COMPRESSION_LEVEL = 3
ROW_GROUP = 1 << 18  # rows that a reader skips or reads at once
TARGET_BYTES = 256 << 20  # of a file, after which another is begun
_FIRST_S, _LONGEST_S = 0.05, 2.0

Rows: TypeAlias = "pa.Table | pa.RecordBatchReader"
Needed = Callable[["pa.Schema | None"], "pa.Schema"]


def open_table(store: StoreLocation, name: str) -> DeltaTable | None:
    """A table of the store; None before anything was written to it.

    Raises:
        StoreError: the store cannot be read.
    """
    if store.folder is not None and not (store.folder / "tables" / name / "_delta_log").is_dir():
        return None
    with storage_errors(store):
        try:
            return DeltaTable(store.table(name), storage_options=store.options)
        except TableNotFoundError:
            return None


def has_rows(store: StoreLocation, name: str, recording: str) -> bool:
    """Whether the rows of a recording are in a table."""
    table = open_table(store, name)
    if table is None:
        return False
    with storage_errors(store):
        return table.transaction_version(recording) is not None


def append_once(
    store: StoreLocation, table: StoreTable, recording: str, needed: Needed, rows: Callable[[pa.Schema], Rows]
) -> bool:
    """Append the rows of a recording, unless they are in the table already.

    Args:
        needed: gives the columns of the rows from those of the table, None before it exists; those that it lacks are
            added to it.
        rows: called with the schema of the table for each attempt.

    Returns:
        Whether they were appended now.

    Raises:
        StoreError: the store cannot be written.
    """
    backoff = Backoff(_FIRST_S, _LONGEST_S)
    for _ in range(COMMIT_ATTEMPTS):
        with storage_errors(store):
            try:
                dataset = open_table(store, table.name)
                if dataset is None:
                    dataset = _create(store, table, needed(None))
                if dataset.transaction_version(recording) is not None:
                    return False
                known = pa.schema(dataset.schema().to_arrow())
                if missing := [field for field in needed(known) if field.name not in names_of(dataset)]:
                    _add_columns(dataset, missing)
                    continue
                _append(dataset, table, recording, rows(known))
                return True
            except CommitFailedError:
                pass  # another upload committed first
        time.sleep(backoff.next())
    raise StoreError(f"{store.url}: too many uploads write to {table.name} at once", "Start the same command again.")


def create_table(store: StoreLocation, table: StoreTable) -> None:
    """Make a table without rows, unless it is there: other engines cannot read a table that does not exist.

    Raises:
        StoreError: the store cannot be written.
    """
    with storage_errors(store):
        if open_table(store, table.name) is None:
            _create(store, table, table.schema)


def names_of(table: DeltaTable) -> set[str]:
    """Names of the columns of a table."""
    return {field.name for field in table.schema().fields}


def _create(store: StoreLocation, table: StoreTable, schema: pa.Schema) -> DeltaTable:
    if store.folder is not None:
        (store.folder / "tables" / table.name).mkdir(parents=True, exist_ok=True)
    try:
        return DeltaTable.create(
            store.table(table.name),
            schema,
            partition_by=list(table.partitions),
            name=table.name,
            description=table.doc,
            configuration={"delta.dataSkippingNumIndexedCols": "-1"},
            storage_options=store.options,
        )
    except DeltaError as error:
        if (dataset := open_table(store, table.name)) is not None:  # another upload created it
            return dataset
        raise error


def _add_columns(table: DeltaTable, fields: Sequence[pa.Field]) -> None:
    added = DeltaSchema.from_arrow(pa.schema([field.with_nullable(True) for field in fields]))
    columns: list[DeltaField] = list(added.fields)
    table.alter.add_columns(columns)


def _append(table: DeltaTable, kind: StoreTable, recording: str, rows: Rows) -> None:
    write_deltalake(
        table,
        rows,
        mode="append",
        target_file_size=TARGET_BYTES,
        writer_properties=writer_properties(),
        commit_properties=CommitProperties(
            app_transactions=[Transaction(recording, 1)], custom_metadata={"imuscope": recording}, max_commit_retries=0
        ),
        post_commithook_properties=PostCommitHookProperties(cleanup_expired_logs=False),
    )


def writer_properties() -> WriterProperties:
    """Compression and row groups of the files of a table."""
    return WriterProperties(compression="ZSTD", compression_level=COMPRESSION_LEVEL, max_row_group_size=ROW_GROUP)


def as_schema(rows: pa.Table, schema: pa.Schema) -> pa.Table:
    """Rows with the columns of a table, in its order; those that they lack are empty."""
    columns: list[Any] = []
    for field in schema:
        at = rows.schema.get_field_index(field.name)
        columns.append(rows.column(at).cast(field.type) if at >= 0 else pa.nulls(rows.num_rows, field.type))
    return pa.Table.from_arrays(columns, schema=schema)
