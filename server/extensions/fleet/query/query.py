"""SQL over the tables of a store, by DuckDB: read-only, with limits of memory and time, and cancellable.

Each table is a view over the Parquet files that its Delta log names: DuckDB reads them itself (`files_of`) or
from an Arrow dataset (delta_dataset.py). It requests the columns and rows that a
question needs; nothing is copied into a database. SQL has no access to files, the network or DuckDB's settings.
"""

import json
import re
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import duckdb
import pyarrow as pa
import pyarrow.dataset as ds
from deltalake import DeltaTable

from imuscope.server.extensions.fleet.store.delta_dataset import check_readable, dataset_of
from imuscope.server.extensions.fleet.store.delta_tables import open_table
from imuscope.server.extensions.fleet.store.store import StoreError, StoreLocation, storage_errors, store_error
from imuscope.server.extensions.fleet.store.tables import RECORDINGS, SAMPLES, SIGNAL, TABLES, UNIT, StoreTable

_PLAIN_FILE = re.compile(r"date=\d{4}-\d\d-\d\d/[\w.-]+")
_MEANT_OTHERWISE = re.compile(r"[*?\[\]{}=%]")
"""In the path of a folder: DuckDB takes these for patterns, or for a partition."""


@dataclass(frozen=True, slots=True)
class ParquetFiles:
    """Files of a table.

    Args:
        paths: of the files that the log names; none of them is a pattern.
        differ: whether a column may be missing in one of them.
    """

    paths: tuple[str, ...]
    differ: bool

    @property
    def sql(self) -> str:
        """The table function that reads them; a column that a file does not have is NULL."""
        paths = ", ".join(quoted(path) for path in self.paths)
        union = str(self.differ).lower()
        return f"read_parquet([{paths}], hive_partitioning=true, hive_types={{'date': DATE}}, union_by_name={union})"


def files_of(store: StoreLocation, table: DeltaTable, kind: StoreTable) -> ParquetFiles | None:
    """The files of a table; None where they are to be read as a dataset.

    DuckDB's own reader is several times as quick as an Arrow dataset: it decodes on all cores, and sorts and joins pass
    on to it which rows they still want. It opens every file for its statistics, so `samples`, with a file for each
    robot and day, is read as a dataset instead, which knows from the log what to leave closed (delta_dataset.py); so
    are tables in a cloud.
    """
    if store.folder is None or kind.partitions != ("date",):
        return None
    folder = str(store.folder.resolve() / "tables" / kind.name)
    actions = pa.table(table.get_add_actions(flatten=True))
    names: list[str] = actions.column("path").to_pylist()
    if _MEANT_OTHERWISE.search(folder) or not names or not all(_PLAIN_FILE.fullmatch(name) for name in names):
        return None
    return ParquetFiles(tuple(f"{folder}/{name}" for name in names), _may_differ(table, kind, actions))


def _may_differ(table: DeltaTable, kind: StoreTable, actions: pa.Table) -> bool:
    """Whether a file may lack a column: the log does not count its values."""
    stored = {field.name for field in table.schema().fields} - set(kind.partitions)
    counts = {f"null_count.{name}" for name in stored}
    return any(name not in actions.column_names or actions.column(name).null_count for name in counts)


def allow(connection: duckdb.DuckDBPyConnection, files: list[ParquetFiles]) -> None:
    """Leave these files open to a question after `enable_external_access` is off."""
    paths = ", ".join(quoted(path) for one in files for path in one.paths)
    connection.execute(f"SET allowed_paths = [{paths}]")


def quoted(text: str) -> str:
    """A text as SQL has it."""
    return "'" + text.replace("'", "''") + "'"


def identifier(name: str) -> str:
    """A name as SQL has it, whatever it holds."""
    return '"' + name.replace('"', '""') + '"'


BATCH_ROWS = 1 << 16
AGAIN_S = 0.05
READING = ("SELECT", "EXPLAIN")
_WORD = re.compile(r"\w+")
_SAMPLES = re.compile(r"\bsamples\b", re.IGNORECASE)
_NAMED = re.compile(r"\bsamples\s*\(\s*'((?:[^']|'')*)'\s*\)", re.IGNORECASE)
_CATALOG = {"show", "tables", "information_schema", "describe", "columns"}


class QueryError(StoreError):
    """A question that cannot be answered."""


@dataclass(frozen=True, slots=True)
class QueryLimits:
    """Limits of a question: memory in MB and time in s.

    Args:
        spills: whether what exceeds the memory may be written to `.tmp` in the present folder.
    """

    memory_mb: int = 1024
    timeout_s: float = 300.0
    spills: bool = True


@contextmanager
def run_query(store: StoreLocation, sql: str, limits: QueryLimits = QueryLimits()) -> Iterator[pa.RecordBatchReader]:
    """The answer to a question, batch by batch; to be read within the `with`.

    Raises:
        QueryError: the SQL is not valid, not reading, or exceeds its limits.
        StoreError: the store cannot be read.
    """
    connection = duckdb.connect(":memory:")
    connection.execute("SET errors_as_json = true")  # with the position
    guard = _Guard(connection, limits.timeout_s)
    try:
        with _explained(connection, sql, guard, limits, store), storage_errors(store):
            _check(connection, sql)
            words = {word.lower() for word in _WORD.findall(sql)}
            tables = [
                _stored(connection, store, table)
                for table in TABLES.values()
                if table is RECORDINGS or words & {table.name, f"{table.name}_wide", *_CATALOG}
            ]
            allow(connection, [one.files for one in tables if one.files is not None])
            _lock(connection, limits)  # before anything is used that others wrote
            for one in tables:
                _view(connection, one, sql)
            with guard, ThreadPoolExecutor(1, "question") as thread:
                yield _Answer(connection.sql(sql), guard, thread).reader()
    finally:
        connection.close()


def _check(connection: duckdb.DuckDBPyConnection, sql: str) -> None:
    """Raise QueryError unless the text is one statement that reads."""
    statements = connection.extract_statements(sql)
    if not statements:
        raise QueryError("the question is empty", 'Give an SQL statement: "SELECT * FROM recordings".')
    if len(statements) > 1:
        raise QueryError("these are several statements", "Ask one at a time.")
    if statements[0].type.name not in READING:
        raise QueryError(f"{statements[0].type.name} changes something; a store is read-only", "Start with SELECT.")


@dataclass(frozen=True, slots=True)
class _Stored:
    """A table, its columns as the store has them, and the files that DuckDB reads; None: it has a dataset."""

    table: StoreTable
    schema: pa.Schema
    files: ParquetFiles | None


def _stored(connection: duckdb.DuckDBPyConnection, store: StoreLocation, table: StoreTable) -> _Stored:
    """The source of a table, without rows before anything was uploaded."""
    dataset = open_table(store, table.name)
    if dataset is None:
        connection.register(f"stored_{table.name}", ds.dataset(table.schema.empty_table()))
        return _Stored(table, table.schema, None)
    check_readable(store, dataset)
    files = files_of(store, dataset, table)
    if files is None:
        connection.register(f"stored_{table.name}", dataset_of(store, dataset, table))
    return _Stored(table, pa.schema(dataset.schema().to_arrow()), files)


def _view(connection: duckdb.DuckDBPyConnection, stored: _Stored, sql: str) -> None:
    """Define a table as a view. Its name and its own columns are trusted; all other names come from robots."""
    table = stored.table
    if stored.files is not None:
        _define(connection, f"CREATE VIEW stored_{table.name} AS SELECT * FROM {stored.files.sql}")
    own = [
        f"CAST({one.name if one.name in stored.schema.names else 'NULL'} AS {_sql_type(one.type)}) AS {one.name}"
        for one in table.columns
    ]
    others = list(_nameable(stored.schema, table))
    columns = ", ".join([*own, *(identifier(field.name) for field in others)])
    whole = "" if not table.joined else " WHERE recording IN (SELECT recording FROM stored_recordings)"
    view = f"{table.name}_wide" if table is SAMPLES else table.name
    _define(connection, f"CREATE VIEW {view} AS SELECT {columns} FROM stored_{table.name}{whole}")
    if table is SAMPLES:
        _long_view(connection, others, sql)


def _nameable(schema: pa.Schema, table: StoreTable) -> Iterator[pa.Field]:
    """Further columns that a question can name: SQL ignores case."""
    names = {column.name for column in table.columns}
    for field in schema:
        name = field.name.casefold()
        if name and name.isprintable() and name not in names:
            names.add(name)
            yield field


def _define(connection: duckdb.DuckDBPyConnection, sql: str) -> None:
    """Execute one statement, and never several: it holds names that others chose."""
    (statement,) = connection.extract_statements(sql)
    connection.execute(statement)


def _long_view(connection: duckdb.DuckDBPyConnection, fields: Sequence[pa.Field], sql: str) -> None:
    """The view `samples`, one row for each value, and `samples(signal)`, the rows of one signal.

    A signal is a branch of a union. DuckDB drops those that a condition on `signal` excludes, but examines each; where
    the question names its signals, `samples('Acceleration.x')`, the others are left out here.
    """
    named = set(_NAMED.findall(sql))
    every = len(_SAMPLES.findall(sql)) > len(_NAMED.findall(sql))
    keys = "date, time, robot, recording, device, message"
    branches = [f"SELECT {keys}, '' AS signal, '' AS unit, 0::DOUBLE AS value FROM samples_wide WHERE false"]
    for field in fields:
        about = field.metadata or {}
        signal, unit = about.get(SIGNAL, b"").decode(), about.get(UNIT, b"").decode()
        if signal and (every or quoted(signal)[1:-1] in named):
            texts = f"{quoted(signal)} AS signal, {quoted(unit)} AS unit"
            branches.append(
                f"SELECT {keys}, {texts}, CAST({identifier(field.name)} AS DOUBLE) AS value"
                f" FROM samples_wide WHERE {identifier(field.name)} IS NOT NULL"
            )
    _define(connection, f"CREATE VIEW samples AS {' UNION ALL '.join(branches)}")
    _define(connection, "CREATE MACRO samples(name) AS TABLE SELECT * FROM samples WHERE signal = name")


def _sql_type(column_type: pa.DataType) -> str:
    return {pa.string(): "VARCHAR", pa.float64(): "DOUBLE", pa.int64(): "BIGINT", pa.date32(): "DATE"}.get(
        column_type, "TIMESTAMPTZ"
    )


def _lock(connection: duckdb.DuckDBPyConnection, limits: QueryLimits) -> None:
    settings = {
        "TimeZone": "'UTC'",
        "memory_limit": f"'{limits.memory_mb}MB'",
        "python_enable_replacements": "false",
        "autoinstall_known_extensions": "false",
        "autoload_known_extensions": "false",
        "enable_external_access": "false",
        "lock_configuration": "true",
    }
    if not limits.spills:
        settings = {"temp_directory": "''", **settings}
    for name, value in settings.items():
        connection.execute(f"SET {name} = {value}")


class _Guard:
    """Interrupts a question when its time is over, again and again: one that comes between two steps is lost."""

    def __init__(self, connection: duckdb.DuckDBPyConnection, timeout_s: float) -> None:
        self.is_over = False
        self._connection = connection
        self._timeout_s = timeout_s
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="question's time", daemon=True)

    def __enter__(self) -> None:
        if self._timeout_s > 0:
            self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()  # the connection is closed next

    def interrupt(self) -> None:
        """Stop what the question is doing."""
        self._connection.interrupt()

    def _watch(self) -> None:
        if self._ended.wait(self._timeout_s):
            return
        self.is_over = True
        while not self._ended.is_set():
            self.interrupt()
            self._ended.wait(AGAIN_S)


class _Answer:
    """Result batches; stops at the time limit, however slow the client reads.

    The work is done in a thread: within DuckDB the main one would notice an interrupt only at the end.
    """

    def __init__(self, relation: Any, guard: _Guard, thread: Executor) -> None:
        self._guard, self._thread = guard, thread
        self._reader: pa.RecordBatchReader = self._done(lambda: relation.to_arrow_reader(BATCH_ROWS))

    def reader(self) -> pa.RecordBatchReader:
        return pa.RecordBatchReader.from_batches(self._reader.schema, self._batches())

    def _batches(self) -> Iterator[pa.RecordBatch]:
        while (batch := self._done(lambda: next(self._reader, None))) is not None:
            if self._guard.is_over:
                raise duckdb.InterruptException("time is over")
            yield batch

    def _done(self, work: Callable[[], Any]) -> Any:
        doing = self._thread.submit(work)
        try:
            return doing.result()
        except KeyboardInterrupt:
            while not wait([doing], AGAIN_S).done:
                self._guard.interrupt()  # again: the first one may have come before there was anything to stop
            raise


@contextmanager
def _explained(
    connection: duckdb.DuckDBPyConnection, sql: str, guard: _Guard, limits: QueryLimits, store: StoreLocation
) -> Iterator[None]:
    try:
        yield
    except QueryError:
        raise
    except (duckdb.Error, pa.ArrowException, RuntimeError) as error:
        raise _query_error(_placed(connection, sql, error), sql, guard, limits, store) from None


def _placed(connection: duckdb.DuckDBPyConnection, sql: str, error: Exception) -> Exception:
    """An error that says where it is: that of a relation does not, that of a statement does."""
    if isinstance(error, duckdb.BinderException | duckdb.CatalogException):
        try:
            connection.execute(sql)  # a statement that cannot be planned is not executed
        except duckdb.Error as placed:
            return placed
    return error


def _query_error(
    error: Exception, sql: str, guard: _Guard, limits: QueryLimits, store: StoreLocation
) -> QueryError | StoreError:
    text = str(error)
    if guard.is_over:
        return QueryError(f"the question takes longer than {limits.timeout_s:g} s", "Ask for less, or allow more time.")
    if isinstance(error, duckdb.OutOfMemoryException) or "Out of Memory" in text:
        words = f"the question takes more memory than {limits.memory_mb} MB"
        return QueryError(words, "Ask for less at once, or allow more memory.")
    if isinstance(error, duckdb.IOException):
        return store_error(error, store)
    words, place = _words_and_place(text, sql)
    first, _, rest = words.partition("\n")
    hint = re.sub(r"\s+", " ", rest).strip() if rest.startswith(("Did you mean", "Candidate bindings")) else ""
    return QueryError(place + re.sub(r"\s+", " ", first).strip()[:500].rstrip(".!"), hint[:300])


def _words_and_place(text: str, sql: str) -> tuple[str, str]:
    """The words of an error, and where it is: "line 2, column 5: ", or "" if it has no place."""
    try:
        details = json.loads(text.partition(": ")[2])
        words, at = str(details["exception_message"]), int(details.get("position", -1))  # in bytes
    except (ValueError, KeyError, TypeError):
        return text.split("\n\nLINE ", 1)[0], ""
    if at < 0:
        return words, ""
    before = sql.encode()[:at].decode(errors="ignore")
    line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
    return words, f"line {line}, column {column}: "
