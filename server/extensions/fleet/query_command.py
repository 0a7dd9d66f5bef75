"""`imuscope query --store URL "SELECT …"`: a question about the recordings of a store."""

from __future__ import annotations

from dataclasses import dataclass
from typing import BinaryIO, TextIO

from imuscope.server.extensions.fleet.prepared_queries import QUESTIONS
from imuscope.server.extensions.fleet.store import MISSING, StoreError, location


class QueryCommandError(Exception):
    """An error that the user can correct, in one line."""


@dataclass(frozen=True, slots=True)
class QueryRequest:
    """Request for an answer.

    Args:
        store: URL or path.
        sql: the question.
        format: of the answer, one of server/extensions/fleet/results.py.
        memory_mb, timeout_s: limits.
    """

    store: str
    sql: str
    format: str = "table"
    memory_mb: int = 1024
    timeout_s: float = 300.0


def question_of(sql: str, name: str) -> str:
    """SQL as given, or that of a prepared question.

    Raises:
        QueryCommandError: both are given.
    """
    if name and sql:
        raise QueryCommandError("give SQL, or --question with the name of a prepared one, not both")
    return QUESTIONS[name].sql if name else sql


def answer(request: QueryRequest, out: TextIO, binary: BinaryIO) -> None:
    """Write the answer to a question.

    Args:
        out, binary: the output for text, and for Arrow.

    Raises:
        QueryCommandError: the question is not valid, or the store cannot be read.
    """
    if not 0 <= request.timeout_s <= 1e6:
        raise QueryCommandError(f"--timeout {request.timeout_s:g} is not a time in seconds; 0 means no limit")
    if not 64 <= request.memory_mb <= 1 << 24:
        raise QueryCommandError(f"--memory {request.memory_mb} is outside 64 … {1 << 24} MB")
    try:
        from imuscope.server.extensions.fleet.query import QueryError, QueryLimits, run_query
        from imuscope.server.extensions.fleet.results import write_arrow, write_csv, write_json, write_table
    except ModuleNotFoundError as error:
        if error.name not in ("deltalake", "obstore", "duckdb"):
            raise
        raise QueryCommandError(MISSING) from None
    try:
        store = location(request.store)
        with run_query(store, request.sql, QueryLimits(request.memory_mb, request.timeout_s)) as reader:
            match request.format:
                case "arrow":
                    write_arrow(reader, binary)
                case "json":
                    write_json(reader, out)
                case "csv":
                    write_csv(reader, out)
                case _:
                    write_table(reader, out)
    except (StoreError, QueryError) as error:
        raise QueryCommandError(f"{error.message.rstrip('.')}. {error.hint}".strip()) from None
