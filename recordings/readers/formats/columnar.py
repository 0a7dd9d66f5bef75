"""Parquet and Arrow files (IPC files and streams, Feather), as tables. The unit of a column is its field's metadata.

Fields of structures and places of lists of one length are columns: gyro.x.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.formats.array_columns import AXES
from imuscope.recordings.readers.formats.arrow_table import (
    BATCH_ROWS,
    SENSELESS,
    ArrowColumns,
    ArrowSource,
    first_line,
    heading_of,
)
from imuscope.recordings.readers.registry import FileReader, OpenRequest, register_reader
from imuscope.recordings.system.regular_file import open_regular

if TYPE_CHECKING:
    import pyarrow as pa

MOST_PLACES = 64  # of a list, to be columns
LARGEST_GROUP = 1 << 30  # bytes of a row group or batch, unpacked
DAMAGED = "Write it again, or give another file."


@dataclass(frozen=True, slots=True)
class _Place:
    """Numbers of a file: of a column, of a field of its structures, or of one place of its lists, which is a number."""

    column: str
    name: str
    heading: str
    field: str = ""
    at: int = -1

    def of(self, column: pa.Array) -> pa.Array:
        import pyarrow.compute as pc

        if self.field:
            return pc.struct_field(column, self.field)
        return pc.list_element(column, self.at) if self.at >= 0 else column


def _places_of(column: pa.Field) -> list[_Place]:
    """The numbers of a column; none if it has something else."""
    import pyarrow.types as types

    name, kind = column.name, column.type
    if types.is_struct(kind):
        inner = [(f"{name}.{one.name}", one.name, -1, one.type) for one in kind]
    elif types.is_fixed_size_list(kind) and kind.list_size <= MOST_PLACES:
        suffixes = AXES if kind.list_size == len(AXES) else tuple(map(str, range(kind.list_size)))
        inner = [(f"{name}.{suffix}", "", at, kind.value_type) for at, suffix in enumerate(suffixes)]
    else:
        inner = [(name, "", -1, kind)]
    headings = [heading_of(text, one) for text, _, _, one in inner]
    return [
        _Place(name, text, heading, field, at)
        for (text, field, at, _), heading in zip(inner, headings, strict=True)
        if heading is not None
    ]


def _flat(batches: Iterator[pa.RecordBatch], places: Sequence[_Place]) -> Iterator[pa.RecordBatch]:
    """Batches with a column for each place."""
    import pyarrow as pa

    for batch in batches:
        arrays = [one.of(batch.column(one.column)) for one in places]
        yield pa.RecordBatch.from_arrays(arrays, names=[str(number) for number in range(len(arrays))])


def _table(request: OpenRequest, kind: str, schema: pa.Schema, batches: Callable[[list[str]], Any]) -> ArrowSource:
    headings: dict[str, str] = {}
    places: list[_Place] = []
    left_out: list[str] = []
    for column in schema:
        inner = _places_of(column)
        if not inner or column.name in {one.column for one in places}:
            left_out.append(column.name)
            continue
        places += inner
        about = column.metadata or {}
        unit, frame = (about.get(key, b"").decode(errors="replace") for key in (b"unit", b"frame"))
        details = "; ".join(filter(None, (unit, frame)))
        for one in inner:
            named = one.heading == one.name and details
            headings[one.name] = f"{one.heading} [{details}]" if named else one.heading
    words = [f"Columns without numbers are left out: {', '.join(left_out[:10])}."] if left_out else []
    if not headings:
        raise RecordingError(f"{request.path.name} has no columns of numbers.", "Give a table of samples.")
    names = list(dict.fromkeys(one.column for one in places))
    columns = ArrowColumns(list(headings.values()), lambda: _flat(batches(names), places), words)
    return ArrowSource(request.path, columns, kind, request.table)


def _opened(request: OpenRequest, kind: str, read: Callable[[OpenRequest], ArrowSource]) -> ArrowSource:
    import pyarrow as pa

    try:
        return read(request)
    except (*SENSELESS, pa.ArrowException, MemoryError) as error:
        raise RecordingError(f"{request.path.name} is a damaged {kind} file: {first_line(error)}.", DAMAGED) from None


def _parquet(request: OpenRequest) -> ArrowSource:
    import pyarrow.parquet as pq

    with open_regular(request.path) as file:
        described = pq.ParquetFile(file)
        schema, about = described.schema_arrow, described.metadata
        sizes = (about.row_group(number).total_byte_size for number in range(about.num_row_groups))
        if max(sizes, default=0) > LARGEST_GROUP:
            raise RecordingError(
                f"{request.path.name} has a row group of more than {LARGEST_GROUP >> 20} MB.",
                "Write it with smaller row groups.",
            )

    def batches(names: list[str]) -> Iterator[pa.RecordBatch]:
        with open_regular(request.path) as file:
            yield from pq.ParquetFile(file).iter_batches(BATCH_ROWS, columns=names, use_threads=False)

    return _table(request, "parquet", schema, batches)


def _arrow(request: OpenRequest) -> ArrowSource:
    with _arrow_reader(request.path) as reader:
        schema = reader.schema

    def batches(names: list[str]) -> Iterator[pa.RecordBatch]:
        with _arrow_reader(request.path) as reader:
            count = getattr(reader, "num_record_batches", None)
            some = reader if count is None else (reader.get_batch(number) for number in range(count))
            for batch in some:
                yield batch.select(names)

    return _table(request, "arrow", schema, batches)


def _arrow_reader(path: Path) -> AbstractContextManager[Any]:
    """Reader of an IPC file, mapped into memory, or of a stream."""
    import pyarrow as pa

    mapped = pa.memory_map(str(path))
    is_file = mapped.read(6) == b"ARROW1"
    mapped.seek(0)
    reader: AbstractContextManager[Any] = pa.ipc.open_file(mapped) if is_file else pa.ipc.open_stream(mapped)
    return reader


_open_parquet = functools.partial(_opened, kind="Parquet", read=_parquet)
_open_arrow = functools.partial(_opened, kind="Arrow", read=_arrow)
register_reader(FileReader("parquet", "Parquet", (".parquet", ".pq"), _open_parquet, {0: (b"PAR1",)}, order=40))
register_reader(FileReader("arrow", "Arrow", (".arrow", ".feather"), _open_arrow, {0: (b"ARROW1\0\0",)}, order=41))
register_reader(FileReader("arrow-stream", "Arrow stream", (".arrows", ".ipc"), _open_arrow, order=42))
