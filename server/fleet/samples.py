"""Samples of an opened recording as rows of the table `samples`.

A row is a time at which a message arrived, with a column for each of its signals. Quantities of one message share their
times, so they share rows; those that do not have rows of their own, in which the columns of the others are empty.

A column is found by the name, unit and type of its signal, which are in its metadata. Its own name is made from the
signal's; if another signal has it already (another unit in other firmware, say), a number is added. So the columns of a
store never change their meaning, and old files stay readable.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from recordings.column_store import ColumnStore
from server.fleet.metadata import RecordingKey
from server.fleet.tables import SAMPLES, SIGNAL, UNIT
from server.library.recording_detail import channels_of
from server.wire import ChannelInfo

ROWS = 1 << 17  # at once
MAX_SIGNALS = 2000  # of a recording; noise that passes a weak checksum must not create unlimited columns
_TYPES = {
    **{dtype: pa.int32() for dtype in ("i1", "u1", "i2", "u2", "i4")},
    **{dtype: pa.int64() for dtype in ("u4", "i8")},
    **{"u8": pa.float64(), "f4": pa.float32(), "f8": pa.float64()},
}


@dataclass(frozen=True, slots=True)
class StoredSignal:
    """A signal: a column of a channel."""

    channel: int
    at: int
    name: str
    unit: str
    type: pa.DataType

    def is_in(self, field: pa.Field) -> bool:
        """Whether a column holds this signal."""
        about = field.metadata or {}
        same = about.get(SIGNAL) == self.name.encode() and about.get(UNIT, b"") == self.unit.encode()
        return bool(same and field.type == self.type)


@dataclass(frozen=True, slots=True)
class SampleRows:
    """Channels of one message that share their times."""

    device: str
    message: str
    channel: int
    signals: Sequence[StoredSignal]


def sample_rows(store: ColumnStore) -> list[SampleRows]:
    """The channels that have samples, grouped by their times."""
    groups: list[list[ChannelInfo]] = []
    left = MAX_SIGNALS
    for info in channels_of(store).values():
        if not store.rows(info.id) or len(info.columns) > left:
            continue
        left -= len(info.columns)
        own = next((group for group in groups if _alike(store, group[0], info)), None)
        if own is None:
            groups.append([info])
        else:
            own.append(info)
    return [
        SampleRows(group[0].device, group[0].message, group[0].id, [one for info in group for one in _signals(info)])
        for group in groups
    ]


def _signals(info: ChannelInfo) -> Iterator[StoredSignal]:
    for at, column in enumerate(info.columns):
        yield StoredSignal(info.id, at, f"{info.name}.{column.name}", column.unit, _TYPES[column.dtype])


def _alike(store: ColumnStore, first: ChannelInfo, other: ChannelInfo) -> bool:
    """Whether two channels have the same message, names of their own, and the same times."""
    same = (first.device, first.message) == (other.device, other.message) and first.name != other.name
    rows = store.rows(first.id)
    if not same or rows != store.rows(other.id):
        return False
    for lo in range(0, rows, ROWS):
        if not np.array_equal(store.clock(first.id, lo, lo + ROWS), store.clock(other.id, lo, lo + ROWS)):
            return False
    return True


def fields_for(groups: Sequence[SampleRows], known: pa.Schema) -> dict[tuple[str, str, str], pa.Field]:
    """The column of each signal, by its name, unit and type: one of the table, or a new one."""
    found: dict[tuple[str, str, str], pa.Field] = {}
    columns = list(known)
    taken = {field.name.lower() for field in columns}
    for signal in (signal for group in groups for signal in group.signals):
        field = next((field for field in columns if signal.is_in(field)), None)
        if field is None:
            name = _free(plain_name(signal.name), taken)
            about = {SIGNAL: signal.name.encode(), UNIT: signal.unit.encode()}
            field = pa.field(name, signal.type, metadata=about)
            columns.append(field)
            taken.add(name.lower())
        found[_key(signal)] = field
    return found


def _key(signal: StoredSignal) -> tuple[str, str, str]:
    return signal.name, signal.unit, str(signal.type)


def plain_name(signal: str) -> str:
    """Name of a column: letters, digits and underscores.

    >>> plain_name("RateOfTurn.x"), plain_name("I.acc.z (2)")
    ('RateOfTurn_x', 'I_acc_z_2')
    """
    return re.sub(r"[^A-Za-z0-9]+", "_", signal).strip("_") or "signal"


def _free(name: str, taken: set[str]) -> str:
    count, free = 1, name
    while free.lower() in taken:
        count += 1
        free = f"{name}_{count}"
    return free


def sample_schema(groups: Sequence[SampleRows], known: pa.Schema | None) -> pa.Schema:
    """The columns that the rows need: those of every table of samples, and one for each signal."""
    own = SAMPLES.schema
    fields = {field.name: field for field in fields_for(groups, known if known is not None else own).values()}
    return pa.schema([*own, *fields.values()])


def sample_reader(
    store: ColumnStore, groups: Sequence[SampleRows], key: RecordingKey, schema: pa.Schema
) -> pa.RecordBatchReader:
    """The rows, batch by batch, with the columns of a table."""
    return pa.RecordBatchReader.from_batches(schema, _batches(store, groups, key, schema))


def _batches(
    store: ColumnStore, groups: Sequence[SampleRows], key: RecordingKey, schema: pa.Schema
) -> Iterator[pa.RecordBatch]:
    fields = fields_for(groups, schema)
    for group in groups:
        columns = {fields[_key(signal)].name: signal for signal in group.signals}
        words = {**key.values, "device": group.device, "message": group.message}
        for lo in range(0, store.rows(group.channel), ROWS):
            hi = min(lo + ROWS, store.rows(group.channel))
            yield pa.RecordBatch.from_arrays(
                [_column(store, group, field, columns, words, lo, hi) for field in schema], schema=schema
            )


def _column(
    store: ColumnStore,
    group: SampleRows,
    field: pa.Field,
    columns: Mapping[str, StoredSignal],
    words: Mapping[str, object],
    lo: int,
    hi: int,
) -> pa.Array:
    if field.name in columns:
        signal = columns[field.name]
        values = np.concatenate(list(store.values(signal.channel, signal.at, lo, hi)))
        return pa.array(values.astype(field.type.to_pandas_dtype()))
    if field.name == "time":
        return pa.array((store.clock(group.channel, lo, hi) * 1e6).round().astype(np.int64)).cast(field.type)
    if field.name in words:
        return pa.repeat(pa.scalar(words[field.name], field.type), hi - lo)
    return pa.nulls(hi - lo, field.type)
