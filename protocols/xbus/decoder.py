"""Bytes of an MTi in, events out: MTData2 as columns, everything else by name.

    chunks ──> XbusStreamParser ──> frames ──┬─ MTData2 ──> walk ──> one Batch for each layout (sequence of items)
                  │                └─ others ───> form ──> Reply
                  ├─> Text, RejectedFrame
                  └─ counters and clocks of the MTData2 frames, in stream order over all layouts ──> SampleGap,
                  ClockStep, times

## Time

A message may carry SampleTimeFine (0.1 ms), SampleTimeCoarse (s) or UtcTime. The best one seen in the stream so far, in
this order, is its clock. The first message with a better one changes the clock (reported as a ClockStep of kind
"sync"); later messages without it have no device time. UtcTime counts only while its flags call UTC valid.

SampleTimeFine wraps at 2^32 or after a day (864 000 000 ticks), depending on the product: the rule is taken from the
product code if the stream contains it, else found from the data. A GNSS solution carries an older time than its
neighbours. Without a fix the clocks of GNSS messages are arbitrary, so these have no device time; nor have satellites
before the first solution has reported whether there is a fix.

## Several forms of one quantity

A message may hold a quantity in several coordinate systems or number formats, or even twice. The last one has the plain
name; each earlier one is a quantity of its own, named after what it differs in: Quaternion_ENU, Acceleration_Float64,
Temperature_2.

## Loss

PacketCounter counts every MTData2 message of a device, whatever its content; missing numbers are a SampleGap. A frame
with the payload of one of the last came twice: it is rejected as "repeated".

## Several devices

On a shared line (RS-485) each device has a bus identifier, a counter and a clock of its own. The first to wake up or
send data is the line's device; another identifier is of a further one ("2"). An answer carries the identifier under
which the device was addressed: it belongs to a further device if that identifier was seen before, otherwise to the
line's own device (which may be addressed as 1 or as 255).

Source: MT0101P 2020.A, sections 5.1 and 5.3.6.
"""

import re
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import UINT8, Bytes, Ints
from imuscope.protocols.clocks.counters import SequenceCounter, TickUnwrapper
from imuscope.protocols.events import Batch, ClockStep, Count, Event, RejectedFrame, Reply, SampleGap, stream_order
from imuscope.protocols.framing.stream_buffer import BODY, ID, LENGTH, OFFSET, SENDER, SIZE, one_number
from imuscope.protocols.framing.stream_parser import StreamDecoder
from imuscope.protocols.schema.fields import Direction, Message
from imuscope.protocols.schema.layouts import Layout, Place, unpack
from imuscope.protocols.xbus.data_identifiers import RAW_BLOB, form_words, is_known, item
from imuscope.protocols.xbus.frames import (
    ABOUT,
    ARRIVALS,
    COARSE,
    COUNTER,
    FINE,
    FIX_UNKNOWN,
    GOOD,
    MASTER,
    MTDATA2,
    OFFSETS,
    PACKET_COUNTER,
    SAMPLE_TIME_FINE,
    STARTS,
    TIMED,
    TIMES,
    WALKED,
    gather,
    items,
    walk,
)
from imuscope.protocols.xbus.messages import MTDATA2_ROW, form_of
from imuscope.protocols.xbus.sample_time import COARSE_CLOCK, FINE_CLOCK, NO_CLOCK, UTC, select_clock
from imuscope.protocols.xbus.stream_parser import ParseResult, XbusStreamParser

TICK_NS = 100_000
WRAP = 2**32
WRAP_DAY = 864_000_000
WAKE_UP, MTDATA = 0x3E, 0x32
FEWEST_LEGACY = 3
LEGACY = (
    "The device sends MTData (0x32), the legacy output, whose layout is not transmitted: it is bytes here. Switch it "
    "to MTData2 with SetOutputConfiguration, or MT Manager, and record again."
)
CONFIRMED_FRAMES = 3  # frames of a bus identifier; noise occasionally contains a valid one
DAY_PRODUCTS = re.compile(r"MTi-(10|20|30|100|200|300|G-7)")  # 10- and 100-series; the others count to 2^32

Flags = NDArray[np.bool_]

_CLOCKS = {"": NO_CLOCK, "UtcTime": UTC, "SampleTimeCoarse": COARSE_CLOCK, "SampleTimeFine": FINE_CLOCK}
_RECENT = 128  # frames among which one is looked for that came twice
_MAX_LAYOUTS = 1024  # layouts remembered; a device has a handful


class DataLayout:
    """Meaning of one sequence of (identifier, size): the message with its fields, and their positions in a payload."""

    def __init__(self, payload: bytes) -> None:
        spans, size = items(payload)
        self.bad: list[tuple[int, int]] = []  # known identifiers with a wrong size: (offset in the payload, bytes)
        listed: list[Place] = []
        blob_open = False
        for identifier, at, length in spans:
            field = item(identifier, length)
            if field.dtype == "bytes" and is_known(identifier) and identifier != RAW_BLOB:
                self.bad.append((at - 3, length + 3))
            place: Place = (field, ((at, length),))
            if identifier == RAW_BLOB and blob_open:
                place = _joined(listed.pop(), at, length)
            blob_open = identifier == RAW_BLOB and length == 255  # only the item right after it continues it
            listed.append(place)
        places = _named(listed)
        self.layout = Layout(list(places.values()), size)
        fields = tuple(field for field, _ in places.values())
        names = [name for name in reversed(_CLOCKS) if name in places]
        clock = names[0] if names else ""
        self.message: Message = replace(MTDATA2_ROW, fields=fields, time=clock, tick_ns=TICK_NS if clock else 0)
        # For a single frame: which bytes are identifiers and sizes, their values, and the places of counter and clock.
        mask = bytearray(size)
        for _, at, _ in spans:
            mask[at - 3 : at] = b"\xff\xff\xff"
        self._mask = int.from_bytes(mask, "big")
        self._mark = int.from_bytes(payload[:size], "big") & self._mask
        last = {(identifier, length): at for identifier, at, length in spans}
        self.counter_at, self.fine_at = last.get((PACKET_COUNTER, 2), 0), last.get((SAMPLE_TIME_FINE, 4), 0)
        kinds = {identifier >> 8 for identifier, _, _ in spans}
        self.usual = bool(self.counter_at and self.fine_at and not self.bad and not kinds & {0x70, 0x88})

    def fits(self, payload: bytes) -> bool:
        """Whether this payload, which has the right length, has the layout."""
        return int.from_bytes(payload, "big") & self._mask == self._mark


def _named(places: list[Place]) -> dict[str, Place]:
    """Places by name, in the order of the wire: the last form of a quantity has its name, each is a channel."""
    last = {field.name: position for position, (field, _) in enumerate(places)}
    named: dict[str, Place] = {}
    counts: Counter[str] = Counter()
    for position, (field, pieces) in enumerate(places):
        if position != last[field.name]:
            form = form_words(field, places[last[field.name]][0])
            base = f"{field.name}_{form}"
            counts[base] += 1
            words = form if form and counts[base] == 1 else f"{form}{counts[base] + (not form)}"
            field = replace(field, name=f"{field.name}_{words}", title=f"{field.title or field.name} ({words})")
        named[field.name] = field, pieces
    return named


def _joined(place: Place, at: int, length: int) -> Place:
    """A blob and the item that continues it."""
    field, pieces = place
    return replace(field, shape=(field.shape[0] + length,)), (*pieces, (at, length))


class _Clocks:
    """Positions of the counter and clocks of one device, and the last state of its receiver."""

    def __init__(self) -> None:
        self.counter = SequenceCounter(1 << 16)
        self.fine = TickUnwrapper(WRAP, auto=(WRAP_DAY,), tick_ns=TICK_NS)
        self.coarse = TickUnwrapper(WRAP, tick_ns=1_000_000_000)
        self.recent: deque[bytes] = deque(maxlen=_RECENT)  # payloads of the last frames with a PacketCounter
        self.clock = 0  # the best clock shown so far
        self.fix = FIX_UNKNOWN  # by the last GNSS solution


class XbusDecoder(StreamDecoder[XbusStreamParser]):
    """See events.Decoder. Message numbers are unique over both directions, so one decoder reads either.

    Args:
        direction: whose side is read; kept for callers, since the tables cover both.
    """

    def __init__(self, *, direction: Direction = "to_host") -> None:
        self.direction = direction
        super().__init__(XbusStreamParser())
        self._layouts: dict[bytes, DataLayout] = {}
        self._newest: dict[int, DataLayout] = {}  # by length of the payload
        self.addresses: dict[str, int] = {}  # bus identifiers that certainly send; see events.Shared
        self._names: dict[int, str] = {}  # of all seen, by bus identifier
        self._frames: dict[int, int] = {}  # number of frames, by bus identifier
        self._clocks = _Clocks()
        self._others: dict[int, _Clocks] = {}
        self._legacy = 0  # frames of the former generation's output

    def drain(self, *, stalled: bool = False) -> list[Event]:
        cut = self._stream.drain(stalled=stalled)
        events: list[Event] = [*cut.rejects, *cut.texts]
        table, arrivals = cut.table, cut.arrival_ns
        n = table.shape[1]
        if not n or (n == 1 and self._single(cut, events)):
            return sorted(events, key=stream_order) if len(events) > 1 else events
        other = table[ID] != MTDATA2
        if np.count_nonzero(other):  # an eighth of the time of `any`, which is Python
            replies = self._replies(cut, np.flatnonzero(other))
            events += replies
            is_data = ~other
            table, arrivals = np.ascontiguousarray(table[:, is_data]), arrivals[is_data]
            if not table.shape[1]:
                self._learn(replies)
                return sorted(events, key=stream_order)
            events += self._by_sender(cut, table, arrivals, replies)
        else:
            events += self._by_sender(cut, table, arrivals, [])
        return sorted(events, key=stream_order) if len(events) > 1 else events

    @property
    def remarks(self) -> list[str]:
        return [LEGACY] if self._legacy >= FEWEST_LEGACY else []

    # -- replies -------------------------------------------------------------------------------------------------------

    def _replies(self, cut: ParseResult, which: NDArray[np.intp]) -> list[Reply]:
        replies = []
        for i in which.tolist():
            offset, size, body, length, mid = cut.table[:5, i].tolist()
            payload = cut.data[body : body + length]
            message, _ = form_of(mid, payload)
            values = unpack(message.fields, payload)
            bid = int(cut.table[SENDER, i])
            self._legacy += mid == MTDATA
            if mid == WAKE_UP:  # sent spontaneously, so it carries the identifier of the device's data
                self._claim(bid)
            device = self._name(bid)
            replies.append(Reply(message, values, cut.start + offset, size, int(cut.arrival_ns[i]), device))
        return replies

    def _claim(self, bid: int, frames: int = 1) -> str:
        """Name of the device that sends under this identifier. The line's own is the first one seen. At a wrong baud
        rate noise occasionally contains a valid frame, so an identifier counts for other connections, and against a
        device that sends under its own (255), only after a few frames.
        """
        if bid not in self._names:
            known = next((name for name, address in self.addresses.items() if address == bid), None)
            is_own = "" not in self.addresses and ("" not in self._names.values() or bid == MASTER)
            name = known if known is not None else "" if is_own else str(bid)
            if name == "":
                self._drop_own_device()
            self._names[bid] = name
        self._frames[bid] = self._frames.get(bid, 0) + frames
        if self._frames[bid] >= CONFIRMED_FRAMES and bid not in self.addresses.values():
            self.addresses[self._names[bid]] = bid
        return self._names[bid]

    def _drop_own_device(self) -> None:
        """Drop the assumed own device of the line; it was noise, or is a further device."""
        before = next((bid for bid, name in self._names.items() if name == ""), None)
        if before is not None:
            self._names[before], self._others[before] = str(before), self._clocks
            self._clocks = _Clocks()

    def _name(self, bid: int) -> str:
        """Name of the device that answered."""
        known = (name for name, address in self.addresses.items() if address == bid)
        return self._names.get(bid) or next(known, "")

    def _learn(self, replies: list[Reply]) -> None:
        """Update the clock from a reply."""
        for reply in replies:
            if reply.message.name == "ProductCode":
                day = DAY_PRODUCTS.match(str(reply.values.get("product_code", "")))
                clocks = self._further(int(reply.device)) if reply.device else self._clocks
                clocks.fine.set_wrap(WRAP_DAY if day else WRAP)

    def _further(self, bid: int) -> _Clocks:
        return self._others.setdefault(bid, _Clocks())

    # -- several devices -----------------------------------------------------------------------------------------------

    def _by_sender(self, cut: ParseResult, table: Ints, arrivals: Ints, replies: list[Reply]) -> list[Event]:
        """Events of the line's first device, and of each further one under its bus identifier."""
        senders = table[SENDER]
        if not np.count_nonzero(senders != self.addresses.get("", -1)):
            return self._data(cut, table, arrivals, replies)
        bids, counts = np.unique(senders, return_counts=True)
        frames = dict(zip(bids.tolist(), counts.tolist(), strict=True))
        for bid in dict.fromkeys(senders.tolist()):
            self._claim(bid, frames[bid])
        events: list[Event] = []
        own_replies = [reply for reply in replies if not reply.device]
        self._learn([reply for reply in replies if reply.device])
        if not any(self._names[bid] == "" for bid in frames):
            self._learn(own_replies)
        for bid in frames:
            which = senders == bid
            part = np.ascontiguousarray(table[:, which]), arrivals[which]
            if (name := self._names[bid]) == "":
                events += self._data(cut, *part, own_replies)
                continue
            own = self._clocks
            self._clocks = self._further(bid)
            batches = self._data(cut, *part, [])
            self._clocks = own
            events += [
                replace(one, device=name) if isinstance(one, Batch | SampleGap | ClockStep) else one for one in batches
            ]
        return events

    def count_of(self, device: str = "") -> Count | None:
        if device:
            return None  # only the line's own: the other devices of a shared line have no link to lose
        counter = self._clocks.counter
        if counter.first is None or counter.last is None:
            return None
        return Count("PacketCounter", counter.first, counter.last, counter.passed, counter.modulus)

    # -- data ----------------------------------------------------------------------------------------------------------

    def _single(self, cut: ParseResult, events: list[Event]) -> bool:
        """One frame of a live stream: same as `_data`, with plain numbers. Returns False without side effects unless it
        is an MTData2 of a known layout with the usual counter and clock.
        """
        offset, size, body, length, mid, sender = cut.table[:6, 0].tolist()
        if self.addresses.get("") != sender:
            return False
        layout = self._newest.get(length) if mid == MTDATA2 and self._clocks.clock in (NO_CLOCK, FINE_CLOCK) else None
        if layout is None or not layout.usual:
            return False
        payload = cut.data[body : body + length]
        if not layout.fits(payload):
            return False
        offset, fine, counter = offset + cut.start, layout.fine_at, layout.counter_at
        number = int.from_bytes(payload[counter : counter + 2], "big")
        ticks = int.from_bytes(payload[fine : fine + 4], "big")
        clocks, missing = self._clocks, 0
        if not clocks.counter.follows(number):
            missing = int(clocks.counter.missing(np.array((number,)))[0])
            if clocks.counter.late and payload in clocks.recent:
                events.append(RejectedFrame(offset, size, "repeated", int(cut.arrival_ns[0])))
                return True
        clocks.clock = FINE_CLOCK
        clocks.recent.append(payload)
        time = clocks.fine.tick(ticks) * TICK_NS
        for _, kind, by in clocks.fine.steps:
            events.append(ClockStep(offset, kind, by * TICK_NS, int(cut.arrival_ns[0])))
        if missing:
            events.append(SampleGap(offset, missing, "PacketCounter", int(cut.arrival_ns[0]), time))
        columns = layout.layout.columns(np.ndarray((1, length), UINT8, payload))
        place = one_number(offset), one_number(time)
        events.append(Batch(layout.message, "", cut.arrival_ns, *place, columns, size=size))
        return True

    def _data(
        self, cut: ParseResult, table: Ints, arrivals: Ints, replies: list[Reply], missing: Ints | None = None
    ) -> list[Event]:
        """Batches, gaps and steps of MTData2 frames. `missing`: frames lost before each, if that is counted already."""
        n, body = table.shape[1], table[BODY]
        walked, about = np.empty((WALKED, n), np.int64), np.empty((ABOUT, n), np.int64)
        order, bounds = np.empty(n, np.int64), np.empty(n + 1, np.int64)
        groups, bad, without_fine, without_counter = walk(cut.array, body, table[LENGTH], walked, order, bounds)
        if missing is None:
            missing, repeated = self._missing(cut.data, table, walked, bool(without_counter))
            if repeated:
                once = np.delete(np.arange(n), repeated)
                places = zip(*table[[OFFSET, SIZE]][:, repeated].tolist(), arrivals[repeated].tolist(), strict=True)
                twice = [RejectedFrame(cut.start + at, size, "repeated", when) for at, size, when in places]
                table = np.ascontiguousarray(table[:, once])
                return [*twice, *self._data(cut, table, arrivals[once], replies, missing[once])]
        offsets, timed = about[OFFSETS], about[TIMED]
        np.add(table[OFFSET], cut.start, out=offsets)
        events: list[Event] = []
        if without_fine or replies or self._clocks.clock not in (NO_CLOCK, FINE_CLOCK):
            times, used = self._times(cut, walked, offsets, arrivals, replies, events)
            np.not_equal(used, NO_CLOCK, out=timed, casting="unsafe")
        else:  # the usual case
            self._clocks.clock = FINE_CLOCK
            times = self._unwrap(self._clocks.fine, TICK_NS, walked[FINE], offsets, arrivals, events)
            timed[:] = 1
        for i in np.flatnonzero(missing).tolist() if np.count_nonzero(missing) else ():
            time = int(times[i]) if timed[i] else None
            events.append(SampleGap(int(offsets[i]), int(missing[i]), "PacketCounter", int(arrivals[i]), time))
        if bad:
            self._bad_tails(table, walked[GOOD], cut.start, arrivals, events)
        about[STARTS], about[ARRIVALS], about[TIMES] = body, arrivals, times
        for first, last in pairwise(bounds[: groups + 1].tolist()):
            which = order[first:last]
            one = int(which[0])
            layout = self._layout(cut.data, int(body[one]), int(walked[GOOD, one]))
            rows = np.empty((len(which), layout.layout.size), np.uint8)
            metadata = np.empty((ABOUT, len(which)), np.int64)
            has_time = gather(cut.array, about, which, rows, metadata)
            some = _batches(layout, rows, metadata, None if has_time == len(which) else metadata[TIMED] > 0)
            for batch in some:
                batch.size = int(table[SIZE, one])
            events += some
            for at, size in layout.bad:
                places = zip((metadata[STARTS] + (cut.start + at)).tolist(), metadata[ARRIVALS].tolist(), strict=True)
                events += [RejectedFrame(place, size, "bad_item", arrival) for place, arrival in places]
        return events

    def _layout(self, data: bytes, start: int, size: int) -> DataLayout:
        payload = data[start : start + size]
        at = 0
        key = b""
        while at < size:
            key += payload[at : at + 3]
            at += 3 + payload[at + 2]
        layout = self._layouts.get(key)
        if layout is None:
            if len(self._layouts) >= _MAX_LAYOUTS:
                self._layouts.clear()
            layout = self._layouts[key] = DataLayout(payload)
        self._newest[size] = layout
        return layout

    @staticmethod
    def _bad_tails(table: Ints, good: Ints, start: int, arrivals: Ints, events: list[Event]) -> None:
        """The item that did not fit in its payload, and with it the rest of the payload."""
        for i in np.flatnonzero(good < table[LENGTH]).tolist():
            at = int(table[BODY, i] + good[i])
            events.append(RejectedFrame(start + at, int(table[LENGTH, i] - good[i]), "bad_item", int(arrivals[i])))

    # -- time and loss -------------------------------------------------------------------------------------------------

    def _times(
        self, cut: ParseResult, walked: Ints, offsets: Ints, arrivals: Ints, replies: list[Reply], events: list[Event]
    ) -> tuple[Ints, Ints]:
        """Device time of each frame, ns, and its clock."""
        clocks, n = self._clocks, len(offsets)
        used, times, better = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(3, np.int64)
        clocks.clock, clocks.fix, steps, _ = select_clock(
            cut.array, walked, clocks.clock, clocks.fix, used, times, better
        )
        for i in better[:steps].tolist():
            events.append(ClockStep(int(offsets[i]), "sync", 0, int(arrivals[i])))
        for clock, raw, unwrap, tick in (
            (FINE_CLOCK, walked[FINE], clocks.fine, TICK_NS),
            (COARSE_CLOCK, walked[COARSE], clocks.coarse, 1_000_000_000),
        ):
            for which in _stretches(np.flatnonzero(used == clock), offsets, replies, self._learn):
                times[which] = self._unwrap(unwrap, tick, raw[which], offsets[which], arrivals[which], events)
            replies = []
        return times, used

    @staticmethod
    def _unwrap(
        unwrap: TickUnwrapper, tick_ns: int, raw: Ints, offsets: Ints, arrivals: Ints, events: list[Event]
    ) -> Ints:
        ticks = unwrap.ticks(raw)
        for i, kind, by in unwrap.steps:
            events.append(ClockStep(int(offsets[i]), kind, by * tick_ns, int(arrivals[i])))
        return ticks * tick_ns

    def _missing(self, data: bytes, table: Ints, walked: Ints, holes: bool) -> tuple[Ints, list[int]]:
        """Number of frames lost before each, by PacketCounter, and the rows of those that came twice; `holes`: some
        frames do not carry it.
        """
        counter, recent, counters = self._clocks.counter, self._clocks.recent, walked[COUNTER]
        rows = np.flatnonzero(counters >= 0) if holes else np.arange(len(counters))
        missing = np.zeros(len(counters), np.int64)
        missing[rows] = counter.missing(counters[rows] if holes else counters)
        late = set(rows[counter.late].tolist())
        some = rows if late else rows[-_RECENT:]
        frames = [data[at : at + size] for at, size in table[[BODY, LENGTH]][:, some].T.tolist()]
        if not late:
            recent.extend(frames)
            return missing, []
        repeated: list[int] = []
        for row, frame in zip(some.tolist(), frames, strict=True):
            if row in late and walked[FINE, row] >= 0 and frame in recent:
                repeated.append(row)
            else:
                recent.append(frame)
        return missing, repeated


def _batches(layout: DataLayout, rows: Bytes, metadata: Ints, timed: Flags | None) -> list[Batch]:
    """One batch, or two if only some of the frames have a device time. `timed` None: all have."""
    columns = layout.layout.columns
    if timed is None:
        return [Batch(layout.message, "", metadata[ARRIVALS], metadata[OFFSETS], metadata[TIMES], columns(rows))]
    return [
        Batch(layout.message, "", own[ARRIVALS], own[OFFSETS], own[TIMES] if has_time else None, columns(rows[part]))
        for part, has_time in ((timed, True), (~timed, False))
        if (own := metadata[:, part]).size
    ]


def _stretches(
    rows: NDArray[np.intp], offsets: Ints, replies: list[Reply], learn: Callable[[list[Reply]], None]
) -> Iterator[NDArray[np.intp]]:
    """`rows` split at replies, so that each reply is processed before the frames after it."""
    for reply in replies:
        before = rows[offsets[rows] < reply.offset]
        if len(before):
            yield before
            rows = rows[len(before) :]
        learn([reply])
    if len(rows):
        yield rows
