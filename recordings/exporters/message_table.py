"""Table of one message: joins its quantities, each with rows of its own, into rows of one table.

    channel A   t1 a1    t2 a2    t3 a3             time  arrival   A    B
    channel B   t1 b1             t3 b3     ──>     t1    …         a1   b1
                                                    t2    …         a2
                                                    t3    …         a3   b3

They are joined by their packet (arrival and place in the stream): an outer join, so nothing is left out; a quantity
without a sample in a packet has an empty cell. If one has several rows in a packet, the first goes with the first of
the others, and so on. Tables (`rows`: satellites) have many rows a packet by nature, and are kept separate. The two
times are followed by the device's own clock for each row, and its UTC if known.

Memory: `windows` cuts the channels at common times so that about 65 536 rows of each are held at once.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from imuscope.protocols.arrays import Array, Ints
from imuscope.protocols.clocks.unix_time import NO_TIME, seconds
from imuscope.recordings.columns.payloads import BYTES
from imuscope.recordings.columns.rows import ExactRows
from imuscope.recordings.columns.store import Base, Clock, ColumnStore
from imuscope.recordings.exporters.request import ExportRequest, ExportStep, with_unit
from imuscope.recordings.exporters.topics import frame_of

JoinedRows = tuple[int, int]

WINDOW = 1 << 16  # rows
MOMENT = pa.timestamp("ns", "UTC")
SEGMENT = "segment"


@dataclass(slots=True)
class MessageTable:
    """One table: the channels of a message.

    Args:
        name: of the message.
        device: id of the device.
        channels: ChannelInfo as in the manifest.
        names: a heading for each column of each channel, without unit; one that is there again belongs to another
            layout of the message, and stands in the same column.
        clocks: the device's clock readings, described like channels.
        segments: begin of each segment of the device's clock after the first, unix s: then a column has their numbers.
    """

    name: str
    device: str
    channels: list[Mapping[str, Any]] = field(default_factory=list)
    names: list[list[str]] = field(default_factory=list)
    clocks: list[Mapping[str, Any]] = field(default_factory=list)
    segments: Sequence[float] = ()

    @property
    def is_rows(self) -> bool:
        """Whether it has several rows of the same time."""
        return any(info["kind"] == "table" for info in self.channels)

    @property
    def columns(self) -> list[tuple[str, Mapping[str, Any], str]]:
        """Heading, ColumnInfo and frame of every column, those of the clocks first."""
        columns: dict[str, tuple[str, Mapping[str, Any], str]] = {}
        for names, info in zip(self.names, [*self.clocks, *self.channels], strict=True):
            for name, column in zip(names, info["columns"], strict=True):
                first = columns.get(name, (name, column, str(info["frame"])))[1]
                dtype = _common(first["dtype"], column["dtype"])
                columns[name] = (name, {**first, "dtype": dtype}, str(info["frame"]))
        return list(columns.values())


@dataclass(frozen=True, slots=True)
class JoinedTable:
    """Rows of a table: `at[i]` gives the row of `parts[i]` for each of them, −1 for none. Times are unix ns."""

    time: Ints
    arrival: Ints
    place: Array
    parts: list[ExactRows]
    at: list[Ints | None]  # None: the identity

    def columns(self) -> Iterator[tuple[Array, Array | None]]:
        """Values of every column in order, and where they are missing (None: nowhere)."""
        for part, at in zip(self.parts, self.at, strict=True):
            for column in part.columns:
                if at is None:
                    yield column, None
                elif len(column):
                    yield column[np.maximum(at, 0)], at < 0
                else:
                    yield np.zeros(len(at), column.dtype), np.ones(len(at), bool)


def tables(request: ExportRequest) -> list[MessageTable]:
    """The tables of an export, in order of the first appearance of their messages."""
    by_message: dict[tuple[Any, ...], MessageTable] = {}
    for info in (*request.infos, *request.payloads):
        alone = info["name"] if info["kind"] == "table" else ""
        name = f"{info['message']}.{alone.removeprefix(info['message'] + '.')}" if alone else info["message"]
        name = info["message"] if alone == info["message"] else name
        name = name if info["verified"] else f"{name}.unverified"
        table = by_message.setdefault((info["device"], name), MessageTable(name, info["device"]))
        table.channels.append(info)
    for table in by_message.values():
        table.clocks = clocks_of(request, table.channels[0])
        table.segments = request.segments(table.device)
        _name(request, table)
    return list(by_message.values())


def clocks_of(request: ExportRequest, info: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Clock readings of the device for the message of a channel."""
    of = info["device"], info["message"], info["verified"]
    return [one for one in request.clocks if (one["device"], one["message"], one["verified"]) == of]


def _name(request: ExportRequest, table: MessageTable) -> None:
    """Set headings: with the frame for a quantity in several frames. A quantity that a changed layout has, too, goes on
    in its column; only one that comes twice in a packet, or in other units, has a number.
    """
    frames: dict[str, set[str]] = {}
    for info in table.channels:
        frames.setdefault(info["name"], set()).add(info["frame"])
    counts: dict[str, int] = {"time": 1, "arrival": 1, SEGMENT: 1}
    columns: dict[str, list[tuple[Mapping[str, Any], Mapping[str, Any]]]] = {}  # heading → channels, and their columns
    for info in (*table.clocks, *table.channels):
        frame = str(info["frame"]) if len(frames.get(info["name"], ())) > 1 else ""
        names = []
        for column in info["columns"]:
            name = heading(info, column, frame)
            before = columns.setdefault(name, [])
            if not before or not all(_continues(request, (info, column), one) for one in before):
                counts[name] = counts.get(name, 0) + 1
            names.append(name if counts[name] == 1 else f"{name} #{counts[name]}")
            before.append((info, column))
        table.names.append(names)


def _continues(
    request: ExportRequest,
    one: tuple[Mapping[str, Any], Mapping[str, Any]],
    other: tuple[Mapping[str, Any], Mapping[str, Any]],
) -> bool:
    """Whether two columns of channels are one quantity, which no packet has twice."""
    (info, column), (before, its) = one, other
    if info["id"] == before["id"] or (info["frame"], column["unit"]) != (before["frame"], its["unit"]):
        return False
    if not _common(column["dtype"], its["dtype"]):
        return False
    places, others = (request.columns.clock(id_, *request.rows(id_), "place") for id_ in (info["id"], before["id"]))
    return not bool(np.isin(places, others).any())


def _common(one: str, other: str) -> str:
    """Type that holds the numbers of two; "" if there is none."""
    if one == other:
        return one
    if BYTES in (one, other):
        return ""
    dtype = np.result_type(np.dtype(one), np.dtype(other)).str[1:]
    return "" if dtype[0] == "f" and {one, other} & {"i8", "u8"} else dtype


def heading(info: Mapping[str, Any], column: Mapping[str, Any], frame: str = "") -> str:
    """Heading of a column among others of its message: "Acceleration.x", "PacketCounter", "DID_IMU.time".

    Args:
        frame: included if the quantity comes in several.
    """
    quantity = str(info["name"]).rstrip("?").removeprefix(f"{info['message']}.")
    if column["name"] in ("value", quantity):
        name = quantity
    elif quantity == info["message"]:
        name = str(column["name"])
    else:
        return f"{quantity}{f'[{frame}]' if frame else ''}.{column['name']}"
    return f"{info['message']}.{name}" if name in ("time", "arrival") else f"{name}{f'[{frame}]' if frame else ''}"


def batches(request: ExportRequest, table: MessageTable, step: ExportStep) -> Iterator[pa.RecordBatch]:
    """The rows of a table; columns are time, arrival, the segment if there are several, then
    those of the table. A missing cell is null.

    Args:
        step: called with the progress, 0..1.
    """
    infos = {info["id"]: info for info in (*(() if table.is_rows else table.clocks), *table.channels)}
    numbers = list(infos)
    ranges = {number: request.rows(number) for number in numbers}
    total = sum(hi - lo for lo, hi in ranges.values()) or 1
    done = 0
    heads = schema(table)
    own = sum(len(info["columns"]) for info in table.clocks)
    for window in windows(request.columns, ranges, base="arrival"):
        parts = [request.exact(info, *window[number]) for number, info in infos.items()]
        joined = join(parts, [request.columns.clock(number, *window[number], "place") for number in infos])
        arrays = [moments(joined.time), moments(joined.arrival)]
        if table.is_rows:
            for info in table.clocks:
                arrays += of_their_packet(request.columns, info, joined.arrival, joined.place)
        arrays += [cells(values, missing) for values, missing in joined.columns()]
        arrays = [*arrays[:2], *map(known, arrays[2 : 2 + own]), *arrays[2 + own :]]
        arrays = [*arrays[:2], *_continued(table, arrays[2:], heads)]
        if table.segments:
            key = np.where(joined.time == NO_TIME, joined.arrival, joined.time)
            arrays.insert(2, pa.array(np.searchsorted(table.segments, seconds(key), "right").astype(np.int32)))
        yield pa.RecordBatch.from_arrays(arrays, schema=heads)
        done += sum(hi - lo for lo, hi in window.values())
        step(done / total)


def _continued(table: MessageTable, arrays: Sequence[pa.Array], heads: pa.Schema) -> Iterator[pa.Array]:
    """Columns of a table: those of the layouts of a quantity as one."""
    names = [name for own in table.names for name in own]
    if len({*names}) == len(names):
        yield from arrays
        return
    columns: dict[str, list[pa.Array]] = {}
    for name, array in zip(names, arrays, strict=True):
        columns.setdefault(name, []).append(array.cast(heads.field(name).type))
    yield from (pc.coalesce(*parts) for parts in columns.values())


def of_their_packet(columns: ColumnStore, clock: Mapping[str, Any], arrival: Ints, place: Array) -> Iterator[pa.Array]:
    """Clock reading of each row; rows of one packet share it.

    Args:
        arrival, place: (n,) of the rows; unix ns, and that of ColumnStore.clock.
    """
    ends = seconds(np.array([arrival.min(), arrival.max()])) if len(arrival) else np.array([0.0, -1.0])
    lo, hi = columns.between(clock["id"], float(ends[0]), float(ends[1]), "arrival")
    clock_rows = columns.exact(clock["id"], lo, hi)
    n = len(clock_rows)
    arrivals = np.concatenate((clock_rows.arrival_ns, arrival))
    places = np.concatenate((columns.clock(clock["id"], lo, hi, "place"), place))
    order = np.lexsort((np.arange(len(places)) >= n, places, arrivals))  # a reading before the rows of its packet
    newest = np.maximum.accumulate(np.where(order < n, np.arange(len(order)), -1))
    at = np.empty(len(order), np.int64)
    at[order] = np.where(newest < 0, -1, order[newest])
    at = at[n:]
    missing = (at < 0) | (arrivals[at] != arrival) | (places[at] != place)
    for column in clock_rows.columns:
        values = column[np.maximum(at, 0)] if n else np.zeros(len(at), column.dtype)
        yield pa.array(values, mask=missing)


def moments(times_ns: Ints) -> pa.Array:
    """Times as Arrow's, UTC; null for NO_TIME."""
    return pa.array(times_ns, MOMENT, mask=times_ns == NO_TIME)


def cells(values: Array, missing: Array | None = None) -> pa.Array:
    """A column as an Arrow array; payloads, which are objects, as their bytes."""
    return pa.array(values, pa.binary() if values.dtype == object else None, mask=missing)


def known(values: pa.Array) -> pa.Array:
    """A clock's values; unknown ones are empty."""
    return pc.if_else(pc.is_nan(values), None, values) if pa.types.is_floating(values.type) else values


def schema(table: MessageTable) -> pa.Schema:
    """Names and units of a table's columns; each field's metadata has the rest."""
    about = {
        "time": "Device time mapped to the host's clock; empty where the message has no clock.",
        "arrival": "When its bytes arrived at the host.",
    }
    fields = [pa.field(name, MOMENT, metadata={"label": words}) for name, words in about.items()]
    if table.segments:
        fields.append(pa.field(SEGMENT, pa.int32(), metadata={"label": "Number of the segment of the clock."}))
    for name, column, frame in table.columns:
        details = {
            "unit": column["unit"],
            "frame": frame_of(column, frame),
            "label": column["label"],
            "doc": column["doc"],
        }
        fields.append(
            pa.field(name, _TYPES[column["dtype"]], metadata={key: text for key, text in details.items() if text})
        )
    return pa.schema(fields)


_TYPES = {
    **{f"i{size}": getattr(pa, f"int{8 * size}")() for size in (1, 2, 4, 8)},
    **{f"u{size}": getattr(pa, f"uint{8 * size}")() for size in (1, 2, 4, 8)},
    "f4": pa.float32(),
    "f8": pa.float64(),
    BYTES: pa.binary(),
}


def headings(table: MessageTable) -> list[str]:
    """Header line of a table: names with their units, and the frame of values not in body axes."""
    own = (with_unit(name, column["unit"], frame_label(frame)) for name, column, frame in table.columns)
    return ["time (s)", "arrival (s)", *([SEGMENT] if table.segments else ()), *own]


def frame_label(frame: str) -> str:
    """The frame of a quantity for a heading: body axes are not named."""
    return "" if frame == "body" else frame


def windows(
    columns: ColumnStore, ranges: Mapping[int, JoinedRows], rows: int = WINDOW, base: Base = "device"
) -> Iterator[dict[int, JoinedRows]]:
    """Cut channels at common times: every window has about `rows` rows of the busiest channel and the rows of the
    others between the same two times of that base. Rows of one time are never split.
    """
    clock: Clock = "key" if base == "device" else "arrival"
    at = {number: lo for number, (lo, _) in ranges.items()}
    while any(at[number] < hi for number, (_, hi) in ranges.items()):
        size = rows
        while True:
            window = {number: (at[number], hi) for number, (_, hi) in ranges.items()}
            bound = np.inf
            for number, (_, hi) in ranges.items():
                last = at[number] + size
                if last < hi:
                    bound = min(bound, float(columns.clock(number, last, last + 1, clock)[0]))
            if np.isfinite(bound):
                for number, (lo, hi) in window.items():
                    window[number] = (lo, max(lo, min(hi, columns.between(number, bound, bound, base)[0])))
            if any(stop > start for start, stop in window.values()):
                break
            size *= 2  # more rows of one time than fit into a window
        yield window
        at = {number: stop for number, (_, stop) in window.items()}


def join(parts: Sequence[ExactRows], places: Sequence[Array]) -> JoinedTable:
    """The rows of some channels as rows of one table; `places`: that of the packet of each row (ColumnStore.clock)."""
    first = parts[0]
    if all(
        _alike(first, other) and np.array_equal(places[0], at) for other, at in zip(parts[1:], places[1:], strict=True)
    ):
        return JoinedTable(first.time_ns, first.arrival_ns, places[0], list(parts), [None] * len(parts))
    time = np.concatenate([part.time_ns for part in parts])
    arrival = np.concatenate([part.arrival_ns for part in parts])
    place = np.concatenate(places)
    key = np.where(time == NO_TIME, arrival, time)
    nth = np.concatenate(
        [_nth(*own) for own in zip(_parted(key, parts), [part.arrival_ns for part in parts], places, strict=True)]
    )
    order = np.lexsort((nth, place, arrival, key))
    new = np.zeros(len(order), bool)
    new[:1] = True
    for values in (key, arrival, place, nth):
        new[1:] |= values[order][1:] != values[order][:-1]
    row = np.empty(len(order), np.int64)
    row[order] = np.cumsum(new) - 1
    rows = int(new.sum())
    at: list[Ints | None] = []
    for own in _parted(row, parts):
        positions = np.full(rows, -1, np.int64)
        positions[own] = np.arange(len(own))
        at.append(positions)
    firsts = order[new]
    return JoinedTable(time[firsts], arrival[firsts], place[firsts], list(parts), at)


def _parted(values: Array, parts: Sequence[ExactRows]) -> list[Array]:
    """Values of the rows of all parts, part by part."""
    return np.split(values, np.cumsum([len(part) for part in parts[:-1]]))


def _alike(a: ExactRows, b: ExactRows) -> bool:
    return np.array_equal(a.arrival_ns, b.arrival_ns) and np.array_equal(a.time_ns, b.time_ns)


def _nth(key: Array, arrival: Array, place: Array) -> Ints:
    """Index of each row among the rows of its packet, or of its time where it came in no packet."""
    order = np.lexsort((np.arange(len(key)), place, arrival, key))
    same = np.zeros(len(order), bool)
    same[1:] = True
    for values in (key, arrival, place):
        same[1:] &= values[order][1:] == values[order][:-1]
    index = np.arange(len(order))
    begins = np.maximum.accumulate(np.where(same, 0, index))
    out = np.empty(len(order), np.int64)
    out[order] = index - begins
    return out
