"""Samples of an opened recording as rows of the table `samples`.

A row is a packet (packet_rows.py), with a column for each signal of its message; those that it does not have are empty.
What a packet has several of, such as satellites, cannot share its row: each of those has one of its own, with its
number.

A column is found by the name, unit and type of its signal, which are in its metadata. Its own name is made from the
signal's; if another signal has it already (such as another unit in other firmware), a number is added. So the columns
of a store never change their meaning, and old files stay readable.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from imuscope.recordings.columns.store import ColumnStore
from imuscope.server.extensions.fleet.store.metadata import RecordingKey
from imuscope.server.extensions.fleet.store.packet_rows import PacketWindow, packet_windows
from imuscope.server.extensions.fleet.store.tables import SAMPLES, SIGNAL, UNIT
from imuscope.server.library.recording_detail import channels_of
from imuscope.server.wire import ChannelInfo

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
    """Channels of one message that share rows.

    Args:
        tracks: channels of one quantity, whose unit or the like changed during the recording, are one track.
        is_list: whether a packet has several samples of them: entries of a list.
    """

    device: str
    message: str
    is_list: bool
    tracks: Sequence[Sequence[int]]
    signals: Sequence[StoredSignal]


def sample_rows(store: ColumnStore) -> list[SampleRows]:
    """The channels that have samples, grouped by device and message; each list of a message is a group of its own."""
    groups: dict[tuple[str, str, str], dict[tuple[str, str], list[ChannelInfo]]] = {}
    left = MAX_SIGNALS
    for info in channels_of(store).values():
        if not store.rows(info.id) or len(info.columns) > left:
            continue
        left -= len(info.columns)
        key = info.device, info.message, info.name if info.kind == "table" else ""
        groups.setdefault(key, {}).setdefault((info.name, info.doc), []).append(info)
    return [
        SampleRows(
            device,
            message,
            bool(name),
            [[info.id for info in track] for track in tracks.values()],
            [signal for title, track in _titled(tracks) for info in track for signal in _signals(title, info)],
        )
        for (device, message, name), tracks in groups.items()
    ]


def _titled(tracks: Mapping[tuple[str, str], list[ChannelInfo]]) -> Iterator[tuple[str, list[ChannelInfo]]]:
    """Tracks with names that differ: angles that are computed from two attitudes of a packet have one name."""
    count: Counter[str] = Counter()
    for (name, _), track in tracks.items():
        count[name] += 1
        yield name if count[name] == 1 else f"{name} ({count[name]})", track


def _signals(name: str, info: ChannelInfo) -> Iterator[StoredSignal]:
    for at, column in enumerate(info.columns):
        yield StoredSignal(info.id, at, f"{name}.{column.name}", column.unit, _TYPES[column.dtype])


def fields_for(groups: Sequence[SampleRows], known: pa.Schema) -> dict[tuple[str, str, str], pa.Field]:
    """The column of each signal, by its name, unit and type: one of the table, or a new one."""
    fields: dict[tuple[str, str, str], pa.Field] = {}
    columns = list(known)
    names = {field.name.lower() for field in columns}
    for signal in (signal for group in groups for signal in group.signals):
        field = next((field for field in columns if signal.is_in(field)), None)
        if field is None:
            name = _free(plain_name(signal.name), names)
            about = {SIGNAL: signal.name.encode(), UNIT: signal.unit.encode()}
            field = pa.field(name, signal.type, metadata=about)
            columns.append(field)
            names.add(name.lower())
        fields[_key(signal)] = field
    return fields


def _key(signal: StoredSignal) -> tuple[str, str, str]:
    return signal.name, signal.unit, str(signal.type)


def plain_name(signal: str) -> str:
    """Name of a column: letters, digits and underscores.

    >>> plain_name("RateOfTurn.x"), plain_name("I.acc.z (2)")
    ('RateOfTurn_x', 'I_acc_z_2')
    """
    return re.sub(r"[^A-Za-z0-9]+", "_", signal).strip("_") or "signal"


def _free(name: str, names: set[str]) -> str:
    count, free = 1, name
    while free.lower() in names:
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
        columns: dict[str, list[StoredSignal]] = {}
        for signal in group.signals:
            columns.setdefault(fields[_key(signal)].name, []).append(signal)
        words = {**key.values, "device": group.device, "message": group.message}
        for window in packet_windows(store, group.tracks):
            arrays = [_column(store, window, field, columns.get(field.name, ()), words, group) for field in schema]
            yield pa.RecordBatch.from_arrays(arrays, schema=schema)


def _column(
    store: ColumnStore,
    window: PacketWindow,
    field: pa.Field,
    signals: Sequence[StoredSignal],
    words: Mapping[str, object],
    group: SampleRows,
) -> pa.Array:
    count = len(window.time)
    if signals:
        values, is_missing = np.zeros(count, field.type.to_pandas_dtype()), np.ones(count, bool)
        for signal in signals:
            lo, hi, rows = window.samples.get(signal.channel, (0, 0, None))
            if lo < hi:
                values[rows] = np.concatenate(list(store.values(signal.channel, signal.at, lo, hi)))
                is_missing[rows] = False
        return pa.array(values, field.type, mask=is_missing)
    if field.name == "time":
        return pa.array((window.time * 1e6).round().astype(np.int64)).cast(field.type)
    if field.name == "entry" and group.is_list:
        return pa.array(window.order + 1, field.type)
    if field.name in words:
        return pa.repeat(pa.scalar(words[field.name], field.type), count)
    return pa.nulls(count, field.type)
