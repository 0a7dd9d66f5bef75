"""Query of a time range of a channel, live or recorded: as sample frames for the page, as a table for programs.

    recorded    Columns (recordings/columns/store.py), mapped from disk
    live        the ring of a channel in the store

Both answer the same query, t0 ≤ t ≤ t1 in a maximum number of buckets, with all rows (ExactRows) or summarised
(MinMaxBuckets), so that paused, scrolled-back and recorded data look alike. Attitudes are thinned instead of
summarised, and a table (satellites) with too many rows gives its newest state.

In sample frames of the wire a bucket is two rows at one time: min, then max; for flags the bits of any row, then of
all. In a table it is one row: t, n, and NAME_min, NAME_max (NAME_any, NAME_all).
"""

import io
import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from imuscope.protocols.arrays import Array
from imuscope.protocols.clocks.unix_time import nanoseconds
from imuscope.recordings.columns.rows import ExactRows, MinMaxBuckets, downsample
from imuscope.recordings.columns.statistics import norm_statistics, statistics
from imuscope.recordings.columns.store import Base, ColumnStore
from imuscope.server import wire
from imuscope.server.streaming.channel_store import StoredChannel
from imuscope.server.wire import codec as wire_codec

THINNED = ("quaternion", "matrix")


@dataclass(frozen=True, slots=True)
class QueryResult:
    """Rows of one channel, with their description.

    Args:
        info: the channel.
        rows: Exact or MinMaxBuckets.
        columns: positions of the returned columns in the channel.
    """

    info: wire.ChannelInfo
    rows: ExactRows | MinMaxBuckets
    columns: tuple[int, ...]

    @property
    def exact(self) -> bool:
        return isinstance(self.rows, ExactRows)


def recorded(
    store: ColumnStore,
    info: wire.ChannelInfo,
    t0: float,
    t1: float,
    width: int,
    *,
    columns: Sequence[int] | None = None,
    base: Base = "device",
) -> QueryResult:
    """A time range of a recorded channel; `width` 0 for all rows."""
    indices = tuple(range(len(info.columns)) if columns is None else columns)
    if width and info.kind in THINNED:
        return QueryResult(
            info, store.thinned(info.id, t0, t1, 2 * width, base=base).picked(slice(None), indices), indices
        )
    rows = store.query(info.id, t0, t1, width, columns=indices, base=base)
    if isinstance(rows, MinMaxBuckets) and info.kind == "table":
        rows = _newest(store, info.id, t1, base).picked(slice(None), indices)
    return QueryResult(info, rows, indices)


def ordered(answer: QueryResult) -> QueryResult:
    """The same rows sorted by time, because a device may send rows later than newer ones of another kind."""
    rows = answer.rows
    if not isinstance(rows, ExactRows):
        return answer
    key = np.where(np.isnan(rows.time), rows.arrival, rows.time)
    if not (key[1:] < key[:-1]).any():
        return answer
    order = np.argsort(key, kind="stable")
    return QueryResult(answer.info, rows.picked(order), answer.columns)


def stored_values(
    channel: StoredChannel, t0: float, base: Base = "device", columns: Collection[int] | None = None
) -> list[Array]:
    """Copy of the ring buffers from `t0` on: arrival, time, and all columns or those at some positions, in their order.

    Call it in the event loop.
    """
    ring = channel.ring
    # device time may be some seconds away from arrival; a ring is searched by arrival
    indices = None if columns is None else {0, 1, *(2 + at for at in columns)}
    return ring.read(ring.sequence_at(t0 - 5.0 if base == "device" else t0), indices)


def query_columns(
    info: wire.ChannelInfo,
    whole: Sequence[Array],
    t0: float,
    t1: float,
    width: int,
    *,
    columns: Sequence[int] | None = None,
    base: Base = "device",
) -> QueryResult:
    """A time range of a copy made by `stored_values`; may run in any thread."""
    indices = tuple(range(len(info.columns)) if columns is None else columns)
    arrival, time = whole[0], whole[1]
    t = arrival if base == "arrival" else np.maximum.accumulate(np.where(np.isnan(time), arrival, time))
    lo, hi = np.searchsorted(t, t0, "left"), np.searchsorted(t, t1, "right")
    own = [whole[2 + i][lo:hi] for i in indices]
    if width and hi - lo > 2 * width and info.kind not in THINNED:
        status = [info.kind == "status" and bool(info.columns[i].bits) for i in indices]
        return QueryResult(info, downsample(own, t[lo:hi], status, (t0, t1, width)), indices)
    at = np.arange(hi - lo)
    if width and hi - lo > 2 * width:
        at = np.unique(np.linspace(0, hi - lo - 1, 2 * width).astype(np.int64))
    rows = ExactRows(nanoseconds(arrival[lo:hi][at]), nanoseconds(time[lo:hi][at]), [column[at] for column in own])
    return QueryResult(info, rows, indices)


def _newest(store: ColumnStore, channel: int, t1: float, base: Base) -> ExactRows:
    """The rows that share the newest time not after `t1`."""
    last = store.row_at(channel, t1, base)
    near = store.exact(channel, max(0, last - 512), last + 1)
    clock = near.arrival if base == "arrival" else np.where(np.isnan(near.time), near.arrival, near.time)
    same = np.flatnonzero(clock == clock[-1]) if len(near) else np.empty(0, np.int64)
    return near.picked(same)


@dataclass(frozen=True, slots=True)
class ColumnStatistics:
    """Statistics of a range of one column; null without numbers, and for the mean of a rotating axis."""

    n: int
    mean: float | None
    sigma: float | None
    min: float | None
    max: float | None


def statistics_in(
    store: ColumnStore, info: wire.ChannelInfo, t0: float, t1: float, *, base: Base = "device"
) -> list[ColumnStatistics]:
    """Statistics of every column of a recorded channel, circular where it wraps, then of the length of a vector."""
    lo, hi = store.between(info.id, t0, t1, base)
    figures = [statistics(store, info.id, at, lo, hi, column.period) for at, column in enumerate(info.columns)]
    if info.kind == "vector" and len(info.columns) == 3:
        figures.append(norm_statistics(store, info.id, range(3), lo, hi))
    return [
        ColumnStatistics(
            one.n, *(value if math.isfinite(value) else None for value in (one.mean, one.sigma, one.min, one.max))
        )
        for one in figures
    ]


# -- for the page ------------------------------------------------------------------------------------------------------


def frame_of(answer: QueryResult) -> bytes:
    """One sample frame of the wire, b"" without rows; the answer must have all of the channel's columns."""
    rows = answer.rows
    if not len(rows):
        return b""
    if isinstance(rows, ExactRows):
        columns: list[Array] = [rows.arrival, rows.time, *rows.columns]
    else:
        pairs = [np.column_stack(pair).reshape(-1) for pair in zip(rows.low, rows.high, strict=True)]
        columns = [np.repeat(rows.t, 2), np.repeat(rows.t, 2), *pairs]
    return wire_codec.encode_samples(answer.info.id, 0, columns, 0.0, history=True)


# -- for programs ------------------------------------------------------------------------------------------------------


def names_of(answer: QueryResult) -> list[tuple[str, str, Literal["", "low", "high"], int]]:
    """(name, unit, which, position in the answer) of every column of the table after the time columns."""
    out: list[tuple[str, str, Literal["", "low", "high"], int]] = []
    for at, position in enumerate(answer.columns):
        column = answer.info.columns[position]
        if answer.exact:
            out.append((column.name, column.unit, "", at))
            continue
        flags = answer.info.kind == "status" and bool(column.bits)
        least, greatest = ("any", "all") if flags else ("min", "max")
        out.append((f"{column.name}_{least}", column.unit, "low", at))
        out.append((f"{column.name}_{greatest}", column.unit, "high", at))
    return out


def table_of(answer: QueryResult) -> dict[str, tuple[Array, str]]:
    """Name → (values, unit), in order; times in unix seconds."""
    rows = answer.rows
    out: dict[str, tuple[Array, str]] = {}
    if isinstance(rows, ExactRows):
        out["time"], out["arrival"] = (rows.time, "s"), (rows.arrival, "s")
    else:
        out["t"], out["n"] = (rows.t, "s"), (rows.n, "")
    for name, unit, which, at in names_of(answer):
        values = rows.columns[at] if isinstance(rows, ExactRows) else (rows.low if which == "low" else rows.high)[at]
        out[name] = (values, unit)
    return out


PIECE_ROWS = 4096  # rows encoded at once: a piece delays the threads of live devices by a few ms


def arrow_of(answer: QueryResult) -> Iterator[bytes]:
    """An Arrow IPC stream of one table, piece by piece; units are in the fields' metadata, the channel's in the
    schema's.
    """
    import pyarrow as pa

    table = table_of(answer)
    fields = [
        pa.field(name, pa.from_numpy_dtype(values.dtype), metadata={"unit": unit} if unit else None)
        for name, (values, unit) in table.items()
    ]
    about = {"channel": answer.info.name, "device": answer.info.device, "frame": answer.info.frame, "exact": "1"}
    about["exact"] = "1" if answer.exact else "0"
    schema = pa.schema(fields, metadata=about)
    sink = io.BytesIO()
    with pa.ipc.new_stream(sink, schema) as writer:
        for at in range(0, len(answer.rows), 16 * PIECE_ROWS):
            rows = [pa.array(values[at : at + 16 * PIECE_ROWS]) for values, _ in table.values()]
            writer.write_batch(pa.record_batch(rows, schema=schema))
            yield _emptied(sink)
    yield _emptied(sink)


def _emptied(sink: io.BytesIO) -> bytes:
    written = sink.getvalue()
    sink.seek(0)
    sink.truncate()
    return written


def json_of(answer: QueryResult) -> Iterator[bytes]:
    """The table as JSON, column by column and piece by piece: {"channel", "exact", "units", "columns": {name:
    [values]}}; NaN is null.
    """
    table = table_of(answer)
    body: Mapping[str, Any] = {
        "channel": answer.info.name,
        "device": answer.info.device,
        "frame": answer.info.frame,
        "exact": answer.exact,
        "units": {name: unit for name, (_, unit) in table.items() if unit},
    }
    yield _json(body)[:-1] + b',"columns":{'
    for number, (name, (values, _)) in enumerate(table.items()):
        yield (b"," if number else b"") + _json(name) + b":["
        for at in range(0, len(values), PIECE_ROWS):
            yield (b"," if at else b"") + _json(_plain(values[at : at + PIECE_ROWS]))[1:-1]
        yield b"]"
    yield b"}}"


def _json(value: object) -> bytes:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()


def _plain(values: Array) -> list[Any]:
    if values.dtype.kind == "f":
        return [value if math.isfinite(value) else None for value in values.astype(np.float64).tolist()]
    return [wire_codec.to_json_safe(value) for value in values.tolist()]
