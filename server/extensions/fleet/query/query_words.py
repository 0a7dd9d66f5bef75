"""Words that an editor of questions completes: tables, columns, signals and functions."""

from __future__ import annotations

from typing import Any

import duckdb
import pyarrow as pa

from imuscope.server.extensions.fleet.store.delta_tables import open_table
from imuscope.server.extensions.fleet.store.store import StoreLocation
from imuscope.server.extensions.fleet.store.tables import RECORDINGS, SAMPLES, SIGNAL, TABLES, UNIT, StoreTable

LONG = (
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
            long = [{"name": name, "type": type, "doc": doc} for name, type, doc in LONG]
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
