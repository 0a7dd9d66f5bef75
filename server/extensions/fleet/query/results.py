"""Answers of questions as a table, CSV, JSON or Arrow, written as they come.

    table    columns for people: at most MAX_ROWS rows; texts are cut to MAX_WIDTH
    csv      RFC 4180, one header line
    json     a list of objects
    arrow    the Arrow IPC stream

Times are ISO 8601 in UTC with Z; a value that is missing or not finite is null in JSON and empty otherwise. Integers
are written in full, whatever their size.
"""

import base64
import csv
import io
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, date, datetime, time, timedelta
from decimal import Decimal
from typing import Any, BinaryIO, TextIO

import pyarrow as pa

MAX_ROWS = 1000
MAX_WIDTH = 60


def plain(value: Any) -> Any:
    """A value as JSON has it."""
    match value:
        case None | bool() | str() | int():
            return value
        case float():
            return value if math.isfinite(value) else None
        case datetime():
            return iso(value)
        case date() | time():
            return value.isoformat()
        case timedelta():
            return value.total_seconds()
        case pa.MonthDayNano():
            return _interval(value)
        case Decimal():
            return (int(value) if value == value.to_integral_value() else float(value)) if value.is_finite() else None
        case bytes():
            return base64.b64encode(value).decode()
        case dict():
            return {str(name): plain(one) for name, one in value.items()}
        case list() | tuple():
            return [plain(one) for one in value]
        case _:
            return str(value)


def _interval(value: Any) -> float | str:
    """A span in s; one of months, whose length varies, as ISO 8601 has it."""
    seconds: float = value.nanoseconds / 1e9
    return f"P{value.months}M{value.days}DT{seconds:g}S" if value.months else 86400 * value.days + seconds


def iso(value: datetime) -> str:
    """A time in UTC, to the microsecond where it has any."""
    utc = value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)
    return utc.replace(tzinfo=None).isoformat() + "Z"


def _rows(batches: Iterable[pa.RecordBatch]) -> Iterator[tuple[Any, ...]]:
    """Rows by position: names of columns may occur twice."""
    for batch in batches:
        columns = [[plain(value) for value in column.to_pylist()] for column in batch.columns]
        yield from zip(*columns, strict=True)


def unique(names: Sequence[str]) -> list[str]:
    """Names of columns; further ones of the same name get a number.

    >>> unique(["a", "b", "a"])
    ['a', 'b', 'a_2']
    """
    out: list[str] = []
    for name in names:
        count, free = 1, name
        while free in out:
            count += 1
            free = f"{name}_{count}"
        out.append(free)
    return out


def write_json(reader: pa.RecordBatchReader, out: TextIO) -> None:
    """A list of objects, one a line."""
    names = unique(reader.schema.names)
    separator = "["
    for row in _rows(reader):
        body = json.dumps(dict(zip(names, row, strict=True)), ensure_ascii=False, allow_nan=False)
        out.write(f"{separator}{body}")
        separator = ",\n "
    out.write("[]\n" if separator == "[" else "]\n")


def write_csv(reader: pa.RecordBatchReader, out: TextIO) -> None:
    """A header line, and a line for each row."""
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(unique(reader.schema.names))
    for row in _rows(reader):
        writer.writerow([_cell(value) for value in row])


def text_of_csv(reader: pa.RecordBatchReader, out: BinaryIO) -> None:
    """The same as bytes, UTF-8."""
    text = io.TextIOWrapper(out, encoding="utf-8", newline="", write_through=False)
    write_csv(reader, text)
    text.flush()
    text.detach()


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | dict):
        return json.dumps(value, ensure_ascii=False)
    return repr(value) if isinstance(value, float) else str(value)


def write_arrow(reader: pa.RecordBatchReader, out: BinaryIO) -> None:
    """The Arrow IPC stream, readable by `pyarrow.ipc.open_stream`."""
    with pa.ipc.new_stream(out, reader.schema) as stream:
        for batch in reader:
            stream.write_batch(batch)


def write_table(reader: pa.RecordBatchReader, out: TextIO) -> None:
    """Columns for people."""
    names = unique(reader.schema.names)
    numeric = [pa.types.is_integer(field.type) or pa.types.is_floating(field.type) for field in reader.schema]
    lines: list[list[str]] = []
    more = False
    for row in _rows(reader):
        if len(lines) == MAX_ROWS:
            more = True
            break
        lines.append([_shown(value) for value in row])
    widths = [max(map(len, column)) for column in zip(names, *lines, strict=True)]
    for cells in (names, ["─" * width for width in widths], *lines):
        padded = (
            cell.rjust(width) if right else cell.ljust(width)
            for cell, width, right in zip(cells, widths, numeric, strict=True)
        )
        out.write("  ".join(padded).rstrip() + "\n")
    words = f"the first {MAX_ROWS} rows; the other formats have all" if more else _counted(len(lines))
    out.write(f"({words})\n")


def _counted(rows: int) -> str:
    return "no rows" if rows == 0 else "1 row" if rows == 1 else f"{rows} rows"


def _shown(value: Any) -> str:
    text = f"{value:.9g}" if isinstance(value, float) else _cell(value)
    text = "".join(c if c.isprintable() else " " for c in text)
    return text if len(text) <= MAX_WIDTH else text[: MAX_WIDTH - 1] + "…"
