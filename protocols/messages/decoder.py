"""Decoder of a stream of messages: records in, batches out. A topic is a message; its quantities are channels.

    records ─> by channel ─> readers (cdr.py, walkers.py) ─> numbers by path ─> quantities ─> Batch

## Time

The time of measurement is the message's own stamp (header.stamp, stamp, timestamp), else the time at which it was
published, if that is known. Both are times of the sender's clock; stamps.py decides whether they are those of the host.
Where they are not, the stamp is a column of its own, and `remarks` says so.

## Loss

If a channel's sequence numbers count the messages of its publisher, numbers that are missing are lost messages.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from imuscope.protocols.arrays import Array, Ints
from imuscope.protocols.clocks.counters import SequenceCounter
from imuscope.protocols.events import Batch, ClockStep, Event, RejectedFrame, SampleGap
from imuscope.protocols.framing.stream_buffer import StreamBuffer
from imuscope.protocols.messages.cdr import MOST_COLUMNS, CdrReader
from imuscope.protocols.messages.message_table import (
    CHANNEL,
    HEAD_SIZE,
    PUBLISHED,
    RECORD_QUANTITIES,
    SEQUENCE,
    SIZE,
    START,
    MessagePayloads,
    scan_messages,
)
from imuscope.protocols.messages.own_schema import columns_of, own_quantity
from imuscope.protocols.messages.quantities import MessageQuantity, absent_quantities, quantities_of, unknown_rows
from imuscope.protocols.messages.records import (
    HEAD,
    MAX_RECORD,
    MESSAGE,
    MESSAGE_FIXED,
    PLAUSIBLE,
    SCHEMA,
    Definitions,
    MessageChannel,
)
from imuscope.protocols.messages.ros2msg import parse
from imuscope.protocols.messages.stamps import StampTrack
from imuscope.protocols.messages.walkers import SENSELESS, STAMPS, NumericMessage, json_reader, protobuf_reader
from imuscope.protocols.schema.fields import Field, Message

STAMP = Field("stamp", "f8", unit="s", doc="Time in the message, of a clock that is not the time axis.")
MOST_CHANNELS = 1024
MOST_REMARKS = 8
MAX_RECORDS = 1 << 12  # of the table of records; more are scanned in turns


@dataclass(frozen=True, slots=True)
class _Received:
    """Messages of a topic in one drain: (n,) each.

    Args:
        offset, size: of the record in the stream.
    """

    payloads: MessagePayloads
    offset: Ints
    size: Ints
    arrival_ns: Ints
    sequence: Ints
    publish_ns: Ints


@dataclass(slots=True)
class Numbers:
    """Numbers of some messages of a channel.

    Args:
        rows: (n,) indexes of the messages.
        stamps: (n,) ns; 0 if the message has none.
        columns: path → (n,).
        tables: path → (n, rows) of messages that are tables.
    """

    rows: Ints
    stamps: Ints
    columns: dict[str, Array]
    tables: dict[str, Array] = field(default_factory=dict)


Read = Callable[[Sequence[bytes]], tuple[list[Numbers], list[tuple[int, str]]]]


def reader_of(channel: MessageChannel) -> Read | None:
    """Reader of the messages of a channel; None if their encoding or schema is unknown or invalid."""
    try:
        match channel.encoding, channel.schema_encoding:
            case "cdr", "ros2msg":
                return _cdr(CdrReader(parse(channel.schema, channel.schema_data.decode())))
            case "ros1", "ros1msg":
                return _cdr(CdrReader(parse(channel.schema, channel.schema_data.decode()), is_ros1=True))
            case "protobuf", "protobuf":
                return _walked(protobuf_reader(channel.schema, channel.schema_data))
            case "json", _:
                return _walked(json_reader())
    except SENSELESS:
        return None
    return None


def _cdr(reader: CdrReader) -> Read:
    def read(messages: Sequence[bytes]) -> tuple[list[Numbers], list[tuple[int, str]]]:
        layouts, refused = reader.columns(messages)
        parts = []
        for one in layouts:
            stamps = np.zeros(len(one.rows), np.int64)
            columns = dict(one.numbers)
            for path, times in one.times.items():
                if path in STAMPS:
                    stamps = times
                else:
                    columns[path] = times / 1e9
            parts.append(Numbers(one.rows, stamps, columns))
        return parts, refused

    return read


def _walked(read_one: Callable[[bytes], NumericMessage]) -> Read:
    def read(messages: Sequence[bytes]) -> tuple[list[Numbers], list[tuple[int, str]]]:
        flat: list[tuple[int, NumericMessage]] = []
        tables: dict[int, list[tuple[int, NumericMessage]]] = {}
        refused: list[tuple[int, str]] = []
        for index, data in enumerate(messages):
            try:
                one = read_one(data)
            except SENSELESS as error:
                refused.append((index, str(error)))
                continue
            if one.rows:
                tables.setdefault(len(one.rows), []).append((index, one))
            else:
                flat.append((index, one))
        parts = [_gathered(flat)] if flat else []
        return parts + [_gathered_tables(some) for some in tables.values()], refused

    return read


def _gathered(messages: Sequence[tuple[int, NumericMessage]]) -> Numbers:
    names = list(dict.fromkeys(name for _, one in messages for name in one.of))[:MOST_COLUMNS]
    columns: dict[str, Array] = {
        name: np.array([one.of.get(name, np.nan) for _, one in messages], np.float64) for name in names
    }
    return Numbers(_indexes(messages), _stamps(messages), columns)


def _gathered_tables(messages: Sequence[tuple[int, NumericMessage]]) -> Numbers:
    names = list(dict.fromkeys(name for _, one in messages for row in one.rows for name in row.of))[:MOST_COLUMNS]
    tables: dict[str, Array] = {
        name: np.array([[row.of.get(name, np.nan) for row in one.rows] for _, one in messages], np.float64)
        for name in names
    }
    return Numbers(_indexes(messages), _stamps(messages), {}, tables)


def _indexes(messages: Sequence[tuple[int, NumericMessage]]) -> Ints:
    return np.array([index for index, _ in messages], np.int64)


def _stamps(messages: Sequence[tuple[int, NumericMessage]]) -> Ints:
    return np.array([min(one.stamp_ns, (1 << 63) - 1) for _, one in messages], np.int64)


class _Topic:
    """One channel of the stream."""

    def __init__(self, channel: MessageChannel) -> None:
        self.channel = channel
        self.read = reader_of(channel)
        self.own = columns_of(channel.schema, channel.schema_data) if channel.encoding == "json" else {}
        self.counter = SequenceCounter(1 << 32) if channel.is_counted else None
        self.stamps = StampTrack()
        self.published = 0  # messages without a stamp, which have the time at which they were published
        self._paths: dict[str, None] = {}
        self._known: dict[tuple[frozenset[str], bool, bool], tuple[Message, list[MessageQuantity]]] = {}

    def described(self, numbers: Numbers) -> tuple[Message, list[MessageQuantity]]:
        """The message with the quantities that are known in these rows."""
        is_table = bool(numbers.tables)
        columns = numbers.tables or numbers.columns
        if self.own:
            columns = {name: columns.get(name, np.zeros(0)) for name in self.own}
        elif not columns.keys() <= self._paths.keys():
            self._paths = dict.fromkeys([*self._paths, *columns][:MOST_COLUMNS])
            self._known.clear()
        names = {path.rpartition(".")[0] for path in numbers.columns if path.endswith((".0", ".x"))}
        names = {name.removesuffix("_covariance") for name in names}
        absent = frozenset() if self.own else frozenset(absent_quantities(numbers.columns, names))
        has_stamp = self.stamps.is_kept and not is_table
        key = (absent, is_table, has_stamp)
        if key not in self._known:
            self._known[key] = self._message(absent, is_table=is_table, has_stamp=has_stamp)
        return self._known[key]

    def _message(
        self, absent: frozenset[str], *, is_table: bool, has_stamp: bool
    ) -> tuple[Message, list[MessageQuantity]]:
        channel = self.channel
        if self.own:
            quantities = [own_quantity(channel.schema, self.own)]
        else:
            available = quantities_of(channel.schema, list(self._paths))
            quantities = [one for one in available if one.field.name not in absent]
        fields = tuple(one.field for one in quantities)
        if has_stamp:
            fields = (*fields, STAMP)
        # A quantity that is called like its message would have its name twice.
        apart = () if is_table else tuple(one.name for one in fields)
        message = Message(-1, channel.topic, fields, separate_channels=apart, title=channel.topic, doc=channel.schema)
        return message, quantities


class MessageDecoder:
    """Decoder of one stream; see protocols/events.py, Decoder.

    Args:
        direction: accepted for the interface; a stream of messages has one.
    """

    def __init__(self, *, direction: str = "to_host", datagrams: bool = False) -> None:
        self._buffer = StreamBuffer()
        self._definitions = Definitions()
        self._table = np.empty((RECORD_QUANTITIES, MAX_RECORDS), np.int64)
        self._topics: dict[int, _Topic] = {}

    # -- input ---------------------------------------------------------------------------------------------------------

    def feed(self, data: bytes, arrival_ns: int) -> None:
        self._buffer.append(data, arrival_ns)

    def feed_chunks(self, data: bytes, ends: Ints, arrival_ns: Ints) -> None:
        """Append many chunks."""
        self._buffer.extend(data, ends, arrival_ns)

    @property
    def buffered(self) -> int:
        """Bytes of an incomplete record."""
        return len(self._buffer)

    @property
    def remarks(self) -> list[str]:
        texts = [words for topic in self._topics.values() if (words := _remark(topic))]
        return list(dict.fromkeys(texts))[:MOST_REMARKS]

    @property
    def axes(self) -> dict[str, str]:
        """The clock that gives the times of each topic, in words."""
        return {topic.channel.topic: _axis(topic) for topic in self._topics.values() if topic.read is not None}

    def drain(self, *, stalled: bool = False) -> list[Event]:
        """Return every complete event."""
        rejects: list[Event] = []
        received: dict[int, list[Ints]] = {}
        data, start = self._buffer.data(), self._buffer.start
        released = self._scan(data, start, rejects, received, stalled=stalled)
        events = rejects
        for number, parts in received.items():
            table = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
            events += self._decode(self._topics[number], self._received(data, start, table))
        self._buffer.release(released)
        if len(received) + len(rejects) > 1:
            events.sort(key=_first)
        return events

    # -- records -------------------------------------------------------------------------------------------------------

    def _scan(
        self, data: bytes, start: int, rejects: list[Event], received: dict[int, list[Ints]], *, stalled: bool
    ) -> int:
        """Sort the records; returns the position behind the last one."""
        buffer = self._buffer
        array = np.frombuffer(data, np.uint8)
        at, end = 0, len(data)
        while end - at >= HEAD.size:
            n, behind = scan_messages(array, at, MAX_RECORD, self._table)
            if n:
                self._sort(self._table[:, :n], start, rejects, received)
                at = behind
                continue
            opcode, length = HEAD.unpack_from(data, at)
            whole = at + HEAD.size + length
            least = MESSAGE_FIXED if opcode == MESSAGE else 0
            if not SCHEMA <= opcode <= MESSAGE or not least <= length < MAX_RECORD:
                match = PLAUSIBLE.search(data, at + 1)
                behind = match.start() if match is not None else max(end - HEAD.size + 1, at + 1)
                rejects.append(RejectedFrame(start + at, behind - at, "bad_size", buffer.arrival(start + at)))
                at = behind
                continue
            if whole > end:
                if not stalled:
                    break
                rejects.append(RejectedFrame(start + at, end - at, "truncated", buffer.arrival(start + end - 1)))
                match = PLAUSIBLE.search(data, at + 1)
                at = match.start() if match is not None else end
                continue
            self._define(data[at:whole], opcode, start + at, rejects, received)
            at = whole
        if stalled and at < end:
            rejects.append(RejectedFrame(start + at, end - at, "truncated", buffer.arrival(start + end - 1)))
            at = end
        return start + at

    def _sort(self, table: Ints, start: int, rejects: list[Event], received: dict[int, list[Ints]]) -> None:
        channels = table[CHANNEL]
        for number in np.unique(channels).tolist():
            rows = table[:, channels == number]
            topic = self._topics.get(number)
            if topic is None:
                for at, size in zip(rows[START].tolist(), rows[SIZE].tolist(), strict=True):
                    arrival_ns = self._buffer.arrival(start + at + size - 1)
                    rejects.append(RejectedFrame(start + at, size, "bad_id", arrival_ns))
            elif topic.read is not None:
                received.setdefault(number, []).append(rows)

    def _define(
        self, record: bytes, opcode: int, offset: int, rejects: list[Event], received: dict[int, list[Ints]]
    ) -> None:
        """Take a schema or a channel."""
        try:
            channel = self._definitions.read(opcode, record[HEAD.size :])
        except ValueError:
            arrival_ns = self._buffer.arrival(offset + len(record) - 1)
            rejects.append(RejectedFrame(offset, len(record), "bad_item", arrival_ns))
            return
        if channel is not None and len(self._topics) < MOST_CHANNELS:
            self._topics[channel.id] = _Topic(channel)
            received.pop(channel.id, None)

    def _received(self, data: bytes, start: int, table: Ints) -> _Received:
        offset, size = table[START] + start, table[SIZE]
        payloads = MessagePayloads(data, table[START] + HEAD_SIZE, size - HEAD_SIZE)
        arrivals = self._buffer.arrivals(offset + size - 1)
        return _Received(payloads, offset, size, arrivals, table[SEQUENCE], table[PUBLISHED])

    # -- messages ------------------------------------------------------------------------------------------------------

    def _decode(self, topic: _Topic, messages: _Received) -> list[Event]:
        assert topic.read is not None
        events: list[Event] = []
        if topic.counter is not None:
            lost = topic.counter.missing(np.ascontiguousarray(messages.sequence))
            for row in np.flatnonzero(lost).tolist():
                at, arrival_ns = int(messages.offset[row]), int(messages.arrival_ns[row])
                events.append(SampleGap(at, int(lost[row]), topic.channel.topic, arrival_ns))
        column_values, refused = topic.read(messages.payloads)
        for index, words in refused:
            place = int(messages.offset[index]), int(messages.size[index])
            events.append(RejectedFrame(*place, "bad_item", int(messages.arrival_ns[index]), detail=words[:200]))
        arrivals, offsets, published = messages.arrival_ns, messages.offset, messages.publish_ns
        stamps = np.zeros(len(offsets), np.int64)
        for numbers in column_values:
            topic.published += int(((numbers.stamps <= 0) & (published[numbers.rows] > 0)).sum())
            stamps[numbers.rows] = np.where(numbers.stamps > 0, numbers.stamps, published[numbers.rows])
        timed = topic.stamps.times(stamps, arrivals)
        for step in timed.steps:
            events.append(ClockStep(int(offsets[step.row]), "jump", step.by_ns, int(arrivals[step.row])))
        for numbers in column_values:
            rows = numbers.rows
            message, quantities = topic.described(numbers)
            if not quantities:
                continue
            columns = _values(quantities, numbers)
            if STAMP in message.fields:
                columns[STAMP.name] = stamps[rows] / 1e9
            used = timed.used[rows]
            for which in (used, ~used):
                if which.all():
                    part: Mapping[str, Array] = columns
                elif which.any():
                    part = {name: column[which] for name, column in columns.items()}
                else:
                    continue
                some = rows[which]
                time_ns = timed.time_ns[some] if which is used else None
                events.append(Batch(message, "", arrivals[some], offsets[some], time_ns, part))
        return events


def _values(quantities: Sequence[MessageQuantity], numbers: Numbers) -> dict[str, Array]:
    n = len(numbers.rows)
    if numbers.tables:
        return {one.field.name: _table(one, numbers.tables, n) for one in quantities}
    columns = {}
    for one in quantities:
        values = one.values(numbers.columns, n)
        unknown = unknown_rows(numbers.columns, one.field.name)
        if unknown is not None and values.dtype.kind == "f":
            values = values.copy()
            values[unknown] = np.nan
        columns[one.field.name] = values
    return columns


def _table(quantity: MessageQuantity, tables: Mapping[str, Array], n: int) -> Array:
    """(n, rows) records."""
    k = next(iter(tables.values())).shape[1]
    names = [one.name for one in quantity.field.fields] or list(quantity.field.axes) or ["value"]
    records = np.full((n, k), np.nan, [(name, "<f8") for name in names])
    for name, path in zip(names, quantity.paths, strict=True):
        if path in tables:
            records[name] = tables[path]
    return records


def _axis(topic: _Topic) -> str:
    stamps = topic.stamps
    if stamps.is_apart:
        return "the spacing of the stamps, placed by the arrival"
    if 2 * topic.published > stamps.stamped + stamps.unstamped:
        return "the time of publication"
    return "the stamp" if stamps.stamped > stamps.unstamped else "the arrival"


def _remark(topic: _Topic) -> str:
    name = topic.channel.topic
    if topic.read is None:
        encoding = topic.channel.encoding or "of no encoding"
        kind = topic.channel.schema or "its type"
        if topic.channel.encoding in ("cdr", "protobuf", "json"):
            return f"{name} is not shown: the definition of {kind} is missing or cannot be read."
        return f"{name} is {encoding}, which is not read."
    stamps = topic.stamps
    if stamps.still:
        some = f"Some stamps of {name}" if stamps.stamped else f"The stamps of {name}"
        return f"{some} stand still: the arrival is used instead, and they are the column “{STAMP.name}”."
    if stamps.missing and stamps.stamped >= stamps.unstamped and not stamps.is_apart:
        return f"Some messages of {name} have no stamp: their times are those of arrival."
    if stamps.is_apart or stamps.unstamped > stamps.stamped:
        if not stamps.off_ns:
            return f"Messages of {name} have no stamp: their times are those of arrival."
        side = "behind" if stamps.off_ns > 0 else "ahead of"
        words = f"Stamps of {name} are {duration(abs(stamps.off_ns) / 1e9)} {side} the time of arrival"
        if stamps.is_apart:
            return f"{words}: their spacing is used, placed by the arrival, and they are the column “{STAMP.name}”."
        return f"{words}, which is used instead. Synchronise the clocks of both hosts."
    return ""


def duration(seconds: float) -> str:
    """A duration in its largest unit: "3.2 s", "41 min", "12 days"."""
    for size, unit in ((86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.1f} s"


def _first(event: Event) -> int:
    offset = event.offset
    return offset if isinstance(offset, int) else int(offset[0])
