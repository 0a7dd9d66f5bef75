"""Samples of a channel, cut from a batch: as columns, or as they were on the wire.

    Batch ──ColumnPlan──> ChannelRows: a column for each number
                     └──> WireRows: rows of bytes, which a ring buffer copies as they are (ring_kernel.py)

A live device has a few samples at a time; to make an array of each of their columns would cost more than all the rest.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Array, Floats, Ints
from imuscope.protocols.clocks.unix_time import seconds
from imuscope.protocols.events import Batch
from imuscope.protocols.schema.layouts import Layout, LazyColumns
from imuscope.server.wire import ChannelInfo

Copies = tuple[Layout, Ints]


@dataclass(frozen=True, slots=True)
class ColumnPlan:
    """Layout of one channel within a batch: its id, its columns, rows per sample (a table's k), and `copies` of
    ring_kernel.py, if each of its numbers is one on the wire.
    """

    channel: int
    names: tuple[str, ...]
    per_sample: int
    copies: Copies | None = None


@dataclass(frozen=True, slots=True)
class ChannelRows:
    """Samples of one channel: `arrival` and `time` (unix seconds), then the channel's columns, in stream order; and the
    `place` of each one's frame in the stream and its arrival and time in ns, None for computed ones.
    """

    channel: int
    columns: list[Array]
    place: Array | None = None
    exact: tuple[Ints, Ints] | None = None

    def __len__(self) -> int:
        return len(self.columns[0])

    @property
    def values(self) -> list[Array]:
        """The channel's own columns."""
        return self.columns[2:]


class WireRows:
    """Samples of one channel as they were on the wire; ChannelRows that make their columns on access.

    Attributes:
        bytes: (n, size) uint8, each row with a sample.
        copies: where the columns are in it, see ring_kernel.py.
        arrival_ns, time_ns, time: (n,) ns and s since 1970.
    """

    __slots__ = ("_batch", "_plan", "arrival_ns", "bytes", "channel", "copies", "time", "time_ns")

    def __init__(
        self, batch: Batch, columns: LazyColumns, plan: ColumnPlan, copies: Copies, time: Floats, time_ns: Ints
    ) -> None:
        self._batch, self._plan = batch, plan
        self.channel, (_, self.copies) = plan.channel, copies
        self.bytes, self.arrival_ns, self.time, self.time_ns = columns.rows, batch.arrival_ns, time, time_ns

    def __len__(self) -> int:
        return len(self.arrival_ns)

    @property
    def place(self) -> Array:
        return self._batch.offset

    @property
    def exact(self) -> tuple[Ints, Ints]:
        return self.arrival_ns, self.time_ns

    @property
    def values(self) -> list[Array]:
        return values_of(self._batch, self._plan)

    @property
    def columns(self) -> list[Array]:
        return [seconds(self.arrival_ns), self.time, *self.values]


def values_of(batch: Batch, cut: ColumnPlan) -> list[Array]:
    out: list[Array] = []
    for name in cut.names:
        array = np.asarray(batch.columns[name])
        out.extend(_rows(array) if cut.per_sample != 1 or table_of(array) is not None else numbers_of(array))
    return out


def copies_of(columns: Mapping[str, Array], plan: ColumnPlan, info: ChannelInfo) -> Copies | None:
    """The places in a row that are copied to a channel's columns; None if not each value is a number of the row."""
    if plan.per_sample != 1 or not isinstance(columns, LazyColumns):
        return None
    places: list[tuple[int, int, bool]] = []
    for name in plan.names:
        numbers = columns.layout.readers[name].numbers
        if numbers is None:
            return None
        offset, dtype, count = numbers
        native = dtype.newbyteorder("=")
        for k in range(count):
            if info.columns[len(places)].dtype != native.str[1:]:
                return None
            places.append((offset + k * dtype.itemsize, dtype.itemsize, dtype != native))
    return columns.layout, np.array(places, np.int64).T.copy()


def numbers_of(array: Array) -> list[Array]:
    """(n, …) → one (n,) array per element; of a structured array, per element of each of its fields, in order."""
    if array.dtype.names:
        return [column for name in array.dtype.names for column in numbers_of(array[name])]
    if array.dtype.kind not in "fiub":
        return []  # text
    if array.ndim == 1:
        return [array]
    flat = array.reshape(len(array), -1)
    return [flat[:, i] for i in range(flat.shape[1])]


def table_of(array: Array) -> tuple[str, Array] | None:
    """The repeated record in an array: ("", itself) for (n, k) records, (name, field) for records in records."""
    if array.dtype.names is None:
        return None
    if array.ndim == 2:
        return "", array
    for name in array.dtype.names:
        if array[name].ndim == 2 and array[name].dtype.names:
            return name, array[name]
    return None


def rows_per_sample(column: Array) -> int:
    table = table_of(np.asarray(column))
    return 1 if table is None else int(table[1].shape[1])


def _rows(array: Array) -> list[Array]:
    """A table as columns: values per sample are repeated on each of its rows."""
    table = table_of(array)
    assert table is not None
    name, records = table
    shared = [other for other in array.dtype.names or () if name and other != name]
    out = [np.repeat(column, records.shape[1]) for other in shared for column in numbers_of(array[other])]
    return out + numbers_of(records.reshape(-1))
