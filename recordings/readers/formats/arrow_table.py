"""Columns of numbers from binary files, read as a text table is: with the same search for the clock.

    a file ─> headings, record batches ─> cells as text ─> CsvSource

A column of moments becomes ns since 1970; days and times of day become texts. A column of something else than numbers,
texts and dates is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.sources import FileDamage, remark
from imuscope.recordings.tables.format import MAX_COLUMNS, MOST_COLUMNS, SAMPLE_ROWS, TableFormat
from imuscope.recordings.tables.options import TableOptions
from imuscope.recordings.tables.table_source import CsvSource

if TYPE_CHECKING:  # imported where a table is read, so that a server starts sooner
    import pyarrow as pa

BATCH_ROWS = 1 << 16


@dataclass(slots=True)
class ArrowColumns:
    """A table of a file.

    Args:
        headings: of its columns; "" where a column has no name.
        batches: reads all rows, each time that it is called.
        left_out: sentences on other content.
        metadata: what the file says beside the table, by name in lower case.
    """

    headings: Sequence[str]
    batches: Callable[[], Iterator[pa.RecordBatch]]
    left_out: Sequence[str] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)


class ArrowSource(CsvSource):
    """A binary table. Raises as CsvSource does."""

    def __init__(self, path: Path, columns: ArrowColumns, format_name: str, options: TableOptions) -> None:
        if len(columns.headings) > MOST_COLUMNS:
            words = f"{path.name} has {len(columns.headings)} columns; {MAX_COLUMNS} are read."
            raise RecordingError(words, "Give a part of them.")
        self._columns = columns
        self._left_out_words = [remark(words) for words in columns.left_out]
        super().__init__(path, options)
        self.format = format_name

    def _form_of_file(self) -> TableFormat:
        sample: list[tuple[str, ...]] = []
        for batch in self._text_batches():
            lists = [column.to_pylist() for column in batch.slice(0, SAMPLE_ROWS - len(sample)).columns]
            sample += [tuple(cell or "" for cell in row) for row in zip(*lists, strict=True)]
            if len(sample) >= SAMPLE_ROWS:
                break
        if not sample:
            raise RecordingError(f"{self.path.name} has no rows.", "Give a table with samples.")
        headings = self._columns.headings
        return TableFormat(
            0, ",", ".", headings if any(headings) else (), sample, len(headings), self._columns.metadata
        )

    def _batches(
        self, names: Sequence[str], odd: list[Any], damage: list[FileDamage] | None = None
    ) -> Iterator[pa.RecordBatch]:
        import pyarrow as pa

        noted = self.damage if damage is None else damage
        if damage is None:
            noted[:] = self._left_out_words
        places = [self.names.index(name) for name in names]
        try:
            for batch in self._text_batches(places):
                yield pa.RecordBatch.from_arrays(batch.columns, names=list(names))
        except SENSELESS as error:
            noted.append(FileDamage(-1, f"Damaged from some row on: {first_line(error)}."))

    def _may_be_numbers(self) -> bool:
        return False

    def _text_batches(self, places: Sequence[int] | None = None) -> Iterator[pa.RecordBatch]:
        """The columns as text; all of them by default."""
        import pyarrow as pa

        try:
            for whole in self._columns.batches():
                some = [whole.column(place) for place in (range(whole.num_columns) if places is None else places)]
                for begin in range(0, whole.num_rows, BATCH_ROWS):
                    texts = [_as_text(column.slice(begin, BATCH_ROWS)) for column in some]
                    yield pa.RecordBatch.from_arrays(texts, names=[str(number) for number in range(len(texts))])
        except pa.ArrowException as error:
            raise OSError(first_line(error)) from None


SENSELESS = (OSError, ValueError, TypeError, KeyError, IndexError, EOFError, OverflowError)
"""Errors of the libraries that read binary tables, for damaged files."""


def first_line(error: BaseException) -> str:
    """The first line of an error's words, not too long."""
    return (str(error).splitlines() or [type(error).__name__])[0][:160].rstrip(".")


def heading_of(name: str, kind: pa.DataType) -> str | None:
    """The heading of a column of this type; None for a type that is not read."""
    import pyarrow.types as types

    if types.is_timestamp(kind) or types.is_duration(kind):
        return f"{name} [ns]"
    if types.is_dictionary(kind):
        return heading_of(name, kind.value_type)
    if types.is_date(kind) or types.is_time(kind):
        return name
    plain = types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind) or types.is_decimal(kind)
    is_text = types.is_string(kind) or types.is_large_string(kind) or types.is_string_view(kind)
    return name if plain or is_text else None


def _as_text(column: pa.Array) -> pa.Array:
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.types as types

    if types.is_dictionary(column.type):
        column = column.dictionary_decode()
    kind = column.type
    if types.is_string(kind):
        return column
    if types.is_boolean(kind):
        column = column.cast(pa.int8())
    elif types.is_timestamp(kind):
        column = column.cast(pa.timestamp("ns", getattr(kind, "tz", None)), safe=False).cast(pa.int64())
    elif types.is_duration(kind):
        column = column.cast(pa.duration("ns"), safe=False).cast(pa.int64())
    elif types.is_float16(kind):
        column = column.cast(pa.float32())
    elif types.is_floating(kind):
        column = pc.if_else(pc.is_nan(column), pa.scalar(None, kind), column)
    return column.cast(pa.string())
