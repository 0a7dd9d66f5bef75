"""`python -m imuscope.server.extensions.fleet.query.query_worker`: answer one question, for query_service.py.

The request comes on standard input, one JSON object: store, sql, format, rows, memory_mb, timeout_s; with `words` in
place of `sql`, the answer is what an editor may complete; with `fetch`, a recording is written to `path`. On standard
output: one line of JSON, {} or {"kind", "message", "hint"}; then the answer. It is complete if the process ends with 0.
"""

import io
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

import duckdb
import pyarrow as pa
import pyarrow.parquet as pq

from imuscope.recordings.system.parent_death import die_with_parent
from imuscope.recordings.system.priority import lower_priority
from imuscope.recordings.system.resource_limits import TooLong, bounded
from imuscope.server.extensions.fleet.query.query import QueryError, QueryLimits, run_query
from imuscope.server.extensions.fleet.query.results import plain, text_of_csv, unique, write_arrow
from imuscope.server.extensions.fleet.store.delta_tables import open_table
from imuscope.server.extensions.fleet.store.fetch import NotInStoreError, fetch
from imuscope.server.extensions.fleet.store.store import StoreError, StoreLocation, location
from imuscope.server.extensions.fleet.store.tables import RECORDINGS, SAMPLES, SIGNAL, TABLES, UNIT, StoreTable

LONG_COLUMNS = (
    ("date", "date", "UTC date on which the recording starts"),
    ("time", "time", "time of the sample"),
    ("robot", "text", "name given to `upload`"),
    ("recording", "text", "identifier of the recording"),
    ("device", "text", "identifier of the device within the recording"),
    ("message", "text", "message of the protocol"),
    ("signal", "text", "CHANNEL.COLUMN"),
    ("unit", "text", "unit of the value"),
    ("value", "real", "value"),
)
_KINDS = {pa.string(): "text", pa.float64(): "real", pa.int64(): "integer", pa.date32(): "date"}
_FUNCTIONS = """SELECT function_name AS name, any_value(parameters ORDER BY len(parameters)) AS parameters,
    any_value(description) AS description FROM duckdb_functions()
    WHERE function_type IN ('scalar', 'aggregate', 'macro', 'window') AND schema_name = 'main'
      AND regexp_full_match(function_name, '[a-z][a-z0-9_]*') GROUP BY name ORDER BY name"""


def query_words(store: StoreLocation) -> dict[str, Any]:
    """Tables with their columns, signals, and functions of SQL.

    Raises:
        StoreError: the store cannot be read.
    """
    tables, signals = [], []
    for table in TABLES.values():
        dataset = open_table(store, table.name)
        schema = pa.schema(dataset.schema().to_arrow()) if dataset is not None else table.schema
        if table is SAMPLES:
            long = [{"name": name, "type": type_name, "doc": doc} for name, type_name, doc in LONG_COLUMNS]
            doc = "samples of all signals; samples('Acceleration.x') has those of one"
            tables.append({"name": "samples", "doc": doc, "columns": long})
            signals = [{"name": name, "unit": unit} for name, unit in map(_signal, schema) if name]
        name = "samples_wide" if table is SAMPLES else table.name
        tables.append({"name": name, "doc": table.doc, "columns": _columns(table, schema)})
    tables.sort(key=lambda one: one["name"] != RECORDINGS.name)
    return {"tables": tables, "signals": signals, "functions": _functions()}


def _columns(table: StoreTable, schema: pa.Schema) -> list[dict[str, str]]:
    known = {column.name for column in table.columns}
    own = [{"name": one.name, "type": _KINDS.get(one.type, "time"), "doc": one.doc} for one in table.columns]
    more = [field for field in schema if field.name not in known]
    return own + [
        {
            "name": field.name,
            "type": _KINDS.get(field.type, "other"),
            "doc": ", ".join(filter(None, _signal(field))),
        }
        for field in more
    ]


def _signal(field: pa.Field) -> tuple[str, str]:
    """Name and unit of the signal in a column of `samples`; empty for another column."""
    about = field.metadata or {}
    return about.get(SIGNAL, b"").decode(), about.get(UNIT, b"").decode()


def _functions() -> list[dict[str, str]]:
    with duckdb.connect(":memory:") as connection:
        rows = connection.execute(_FUNCTIONS).fetchall()
    return [
        {"name": name, "form": f"{name}({', '.join(parameters or ())})", "doc": (description or "").split(". ")[0]}
        for name, parameters, description in rows
    ]


MAX_JSON = 64 << 20
"""Bytes of rows as JSON: a page holds them in memory."""
OWN_MB = 3072  # of memory besides DuckDB's limit: libraries, an answer, stacks of threads
MAX_JSON_INTEGER = 1 << 53  # JavaScript's integers end here; beyond, they are text


def main() -> int:
    """Answer the question on standard input. Returns 0, or 1 after a reported error."""
    lower_priority(10)  # live devices come first
    die_with_parent()
    request = json.loads(sys.stdin.read())
    bounded((request["memory_mb"] + OWN_MB) << 20, round(request["timeout_s"] * (os.cpu_count() or 1)) + 60)
    output = _Output(sys.stdout.buffer)
    try:
        _answer(request, output)
    except StoreError as error:
        kinds = {QueryError: "bad-query", NotInStoreError: "not-found"}
        return output.fail(kinds.get(type(error), "store"), error.message, error.hint)
    except MemoryError:
        words = f"the question takes more memory than {request['memory_mb']} MB"
        return output.fail("bad-query", words, "Ask for less at once, or allow more memory.")
    except TooLong:
        words = f"the question takes longer than {request['timeout_s']:g} s"
        return output.fail("bad-query", words, "Ask for less, or allow more time.")
    except OSError as error:
        if isinstance(error, BrokenPipeError):
            os._exit(1)  # without a reader
        words = (error.strerror or "it cannot be written").lower()
        return output.fail("store", f"the recording cannot be stored here: {words}", "Free some space.")
    output.end()
    return 0


def _answer(request: dict[str, Any], output: "_Output") -> None:
    store = location(request["store"])
    if request.get("words"):
        output.write(json.dumps(query_words(store)).encode())
        return
    if request.get("fetch"):
        output.write(json.dumps({"bytes": fetch(store, request["fetch"], Path(request["path"]))}).encode())
        return
    began = time.monotonic()
    with run_query(
        store, request["sql"], QueryLimits(request["memory_mb"], request["timeout_s"], spills=False)
    ) as reader:
        if request["format"] == "json":
            output.write(_json(reader, request["rows"], began))
        else:
            WRITERS[request["format"]](reader, output)  # type: ignore[arg-type]


def _json(reader: pa.RecordBatchReader, most: int, began: float) -> bytes:
    """Columns with their kinds, and the first rows."""
    columns = [
        {"name": name, "kind": kind_of(field.type)}
        for name, field in zip(unique(reader.schema.names), reader.schema, strict=True)
    ]
    lines: list[str] = []
    size, more = 0, False
    for batch in reader:
        left = most - len(lines)
        more = batch.num_rows > left
        values = [[_exact(plain(value)) for value in column.to_pylist()] for column in batch.slice(0, left).columns]
        for row in zip(*values, strict=True):
            lines.append(json.dumps(row, ensure_ascii=False, allow_nan=False))
            size += len(lines[-1])
            if size > MAX_JSON:
                raise QueryError(
                    f"the first {len(lines)} rows take more than {MAX_JSON >> 20} MB as JSON",
                    "Ask for fewer rows or columns, or download the answer as Parquet.",
                )
        if more:
            break
    head = {"columns": columns, "more": more, "seconds": round(time.monotonic() - began, 3)}
    return f'{json.dumps(head)[:-1]}, "rows": [{",".join(lines)}]}}\n'.encode()


def _exact(value: Any) -> Any:
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > MAX_JSON_INTEGER:
        return str(value)
    if isinstance(value, list):
        return [_exact(one) for one in value]
    return {name: _exact(one) for name, one in value.items()} if isinstance(value, dict) else value


def kind_of(column_type: pa.DataType) -> str:
    """Kind of a column, as a table or a plot treats it."""
    tests: tuple[tuple[str, Callable[[pa.DataType], bool]], ...] = (
        ("boolean", pa.types.is_boolean),
        ("integer", pa.types.is_integer),
        ("number", pa.types.is_floating),
        ("number", pa.types.is_decimal),
        ("time", pa.types.is_timestamp),
        ("date", pa.types.is_date),
        ("text", pa.types.is_string),
        ("text", pa.types.is_large_string),
    )
    return next((kind for kind, is_one in tests if is_one(column_type)), "other")


def _write_parquet(reader: pa.RecordBatchReader, out: BinaryIO) -> None:
    schema = reader.schema.empty_table().rename_columns(unique(reader.schema.names)).schema
    with pq.ParquetWriter(out, schema, compression="zstd") as writer:
        for batch in reader:
            writer.write_batch(pa.RecordBatch.from_arrays(batch.columns, schema=schema))


WRITERS: dict[str, Callable[[pa.RecordBatchReader, BinaryIO], None]] = {
    "arrow": write_arrow,
    "csv": text_of_csv,
    "parquet": _write_parquet,
}


class _Output(io.RawIOBase):
    """Standard output: the line with the outcome, before the first bytes of the answer."""

    def __init__(self, out: BinaryIO) -> None:
        self._out = out
        self._is_begun = False

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        self._begin({})
        return self._out.write(data)

    def fail(self, kind: str, message: str, hint: str) -> int:
        """Report an error; in the middle of an answer, only by ending."""
        self._begin({"kind": kind, "message": f"{message[:1].upper()}{message[1:]}.", "hint": hint})
        self._out.flush()
        return 1

    def end(self) -> None:
        self._begin({})
        self._out.flush()

    def _begin(self, words: dict[str, str]) -> None:
        if not self._is_begun:
            self._is_begun = True
            self._out.write(json.dumps(words).encode() + b"\n")


if __name__ == "__main__":
    raise SystemExit(main())
