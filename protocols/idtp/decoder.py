"""Bytes of IDTP devices in, events out: one Batch for each device and layout, losses, and rejected frames.

    chunks ──> IdtpStream ──> frames ──> group by (device, verified, version, type, length) ──> Batch
                   │              └─> sequence numbers ──> SampleGap      timestamps ──> time, ClockStep
                   └─> Reject

## Devices and trust

Several devices may share a link: `Batch.device` is the device_id, in decimal. The Status column of a batch
distinguishes Lite frames from Safety frames. Secure frames that could not be verified are returned only on request, as
batches of their own with `verified` False and with a clock of their own; they affect nothing else.

## Time

The timestamp's unit is only recommended by the document (µs), so it is a setting; 32 bits of µs wrap every 71.6 minutes
and are unwrapped for each device separately. `contradiction` reports another unit that the arrival times suggest.

Notices for the user (a newer version, payloads of an unexpected length, a successor protocol) come as a Reply named
"Warning", once for each device.

Source: IDTP v2.1.0, with its errata.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, get_args

import numpy as np

from imuscope.protocols.arrays import UINT8, Bytes, Ints
from imuscope.protocols.clocks.counters import TickUnwrapper
from imuscope.protocols.events import Batch, ClockStep, Count, Doubt, Event, LazyMapping, Reply, SampleGap, stream_order
from imuscope.protocols.framing.grouping import group
from imuscope.protocols.framing.stream_buffer import (
    BAD_VERSION,
    BODY,
    OFFSET,
    REASONS,
    SENDER,
    SIZE,
    SUCCESSOR,
    one_number,
)
from imuscope.protocols.framing.stream_parser import StreamDecoder
from imuscope.protocols.idtp.custom_payloads import Schema
from imuscope.protocols.idtp.frames import LITE, SECURE, SEQUENCE_AT, TIMESTAMP_AT, VERSION_AT, version_at
from imuscope.protocols.idtp.payloads import DecodedPayload, Payload, Rotation
from imuscope.protocols.idtp.replay_guard import (
    KEY,
    LOST,
    MAX_NUMBERS_AHEAD,
    MODE,
    SOURCE_SHIFT,
    TAKEN_BACK,
    TIMESTAMP,
    key_of,
    source_of,
)
from imuscope.protocols.idtp.stream_parser import ClassifiedFrames, IdtpStream
from imuscope.protocols.idtp.units import UNITS, UnitWatch
from imuscope.protocols.native.kernels import BYTES, INT, INTS, NOTHING, ROWS, STRIDED, TABLE, compiled, unsigned
from imuscope.protocols.schema.fields import Direction, Message

WRAP = 2**32
KNOWN_MINOR = 1
WARNING = Message(-1, "Warning", kind="indication", doc="Remark on a device, for users.")

LAYOUT = (1 << SOURCE_SHIFT) - 1  # the part of a KEY that determines the layout
_MAX_LAYOUTS = 4096  # remembered; a device has a handful


OFFSETS, ARRIVALS, TIMES, MODES = range(4)
ABOUT = 4


@compiled(NOTHING, BYTES, STRIDED, STRIDED, INTS, INTS, INTS, INT, ROWS, TABLE)
def gather(
    data: Bytes, table: Ints, judged: Ints, arrivals: Ints, times: Ints, which: Ints, start: int, rows: Bytes, out: Ints
) -> None:
    """Copy the payloads of a group into the rows of one array, with offset, arrival and time of each frame.

    Args:
        table, judged, arrivals, times: of all frames, see protocols/framing/stream_buffer.py and replay_guard.py.
        which: (n,) the frames that belong to the group.
        start: position of `data` in the stream.
        rows: (n, size), written.
        out: (ABOUT, n), written.
    """
    width = unsigned(rows.shape[1])
    for f in range(unsigned(len(which))):
        k = unsigned(which[f])
        out[OFFSETS, f] = table[OFFSET, k] + start
        out[ARRIVALS, f] = arrivals[k]
        out[TIMES, f] = times[k]
        out[MODES, f] = judged[MODE, k]
        body = unsigned(table[BODY, k])
        for i in range(width):
            rows[f, i] = data[body + i]


@dataclass(slots=True)
class _PayloadKind:
    """Properties shared by the frames of one KEY."""

    payload: Payload
    device: str
    unverified: bool


class IdtpDecoder(StreamDecoder[IdtpStream]):
    """See events.Decoder.

    Args:
        direction: devices only send; kept for callers that read it.
        key: for Secure frames; with one, only Secure frames are accepted unless `min_mode` says otherwise.
        min_mode: 0 (Lite), 1 (Safety) or 2 (Secure): weaker frames are rejected as `below_min_mode`.
        replay_check: False accepts frames whatever their sequence numbers.
        time_unit: of the timestamp: "ns", "us", "ms" or "s".
        rotation: direction in which a device's quaternion turns; the column always turns body to ENU.
        show_unverified: without a key, show Secure frames, marked, instead of rejecting them as `no_key`.
        schema: rows of the vendor's own payload types, see custom_payloads.py.
        datagrams: every chunk is a datagram.
        arrivals: False: the arrival times are not those of a link, so a device's silence cannot be measured.

    Raises:
        ValueError: invalid setting.
    """

    def __init__(
        self,
        *,
        direction: Direction = "to_host",
        key: bytes | None = None,
        min_mode: int | None = None,
        replay_check: bool = True,
        time_unit: str = "us",
        rotation: Rotation = "enu_from_body",
        show_unverified: bool = False,
        schema: Schema | None = None,
        datagrams: bool = False,
        arrivals: bool = True,
    ) -> None:
        if time_unit not in UNITS:
            raise ValueError(f"time_unit is one of {', '.join(UNITS)}, given {time_unit!r}")
        if rotation not in get_args(Rotation):
            raise ValueError(f"rotation is one of {', '.join(get_args(Rotation))}, given {rotation!r}")
        self.direction = direction
        super().__init__(
            IdtpStream(
                key=key,
                min_mode=min_mode,
                replay_check=replay_check,
                show_unverified=show_unverified,
                datagrams=datagrams,
                arrivals=arrivals,
            )
        )
        self._time_unit = time_unit
        self._tick_ns = UNITS[time_unit]
        self._watches: dict[int, UnitWatch] = {}  # by source
        self.memory_key = key if replay_check else None
        self.doubted = "time_unit"
        self.contradiction: Doubt | None = None  # the unit that the frames' arrival times suggest instead
        self._rotation: Rotation = rotation
        self._schema: Schema = schema or {}
        self._payloads: dict[int, Payload] = {}  # by the layout's part of a KEY, see replay_guard.py
        self._kinds: dict[int, _PayloadKind] = {}  # by KEY
        self._clocks: dict[int, TickUnwrapper] = {}  # by source
        self._firsts: dict[int, int] = {}  # by source, its first sequence number
        self._reported: set[tuple[int, str]] = set()

    def rearm(self, device: str = "") -> None:
        """Accept any sequence number next, of one device or ("") of all; see replay_guard.py.

        Raises:
            ValueError: not a device identifier.
        """
        if device and not (device.isdecimal() and int(device) <= 0xFFFF):
            raise ValueError(f"a device is a number from 0 to 65535, given {device!r}")
        self._stream.sequences.rearm(int(device) if device else None)

    def state(self) -> Mapping[int, int]:
        sources = (source_of(source) for source in self._clocks)
        return self._stream.sequences.state(device for device, unverified in sources if not unverified)

    def restore(self, numbers: Mapping[int, int]) -> None:
        self._stream.sequences.restore(numbers)

    def drain(self, *, stalled: bool = False) -> list[Event]:
        """Return every complete event by offset; a batch is placed at its first frame."""
        events: list[Event] = []
        for cut in self._stream.drain(stalled=stalled):
            if cut.rejects:
                events += cut.rejects
                events += self._other_protocols(cut)
            if n := cut.table.shape[1]:
                if n == 1:
                    self._single(cut, events)
                else:
                    self._data(cut, events)
                if len(self._firsts) < len(self._clocks):
                    self._note_firsts(cut)
        return sorted(events, key=stream_order) if len(events) > 1 else events

    def _note_firsts(self, cut: ClassifiedFrames) -> None:
        """Record each device's first sequence number."""
        senders = cut.table[SENDER]
        for source in self._clocks.keys() - self._firsts.keys():
            device, _ = source_of(source)
            row = int(np.argmax(senders == device))
            at = int(cut.table[OFFSET, row]) + SEQUENCE_AT
            self._firsts[source] = int.from_bytes(bytes(cut.data[at : at + 4]), "little")

    def count_of(self, device: str = "") -> Count | None:
        verified = {str(source_of(source)[0]): source for source in self._firsts if not source_of(source)[1]}
        if device not in verified:
            return None
        first, last = self._firsts[verified[device]], self._stream.sequences.last_of(int(device), LITE)
        return Count("sequence", first, last, (last - first) % (1 << 32), 1 << 32)

    # -- batches -------------------------------------------------------------------------------------------------------

    def _data(self, cut: ClassifiedFrames, events: list[Event]) -> None:
        """Batches, gaps, steps and warnings of several accepted frames."""
        rows = cut.verdict.rows
        offsets = cut.table[OFFSET] + cut.start
        times = self._times(cut, offsets, events)
        if cut.verdict.gaps:
            self._gaps(cut, offsets, times, events)
        if cut.verdict.other:
            self._newer(cut, events)
        for _, which in _groups(rows[KEY]):
            events.append(self._batch(cut, which, times, events))

    def _single(self, cut: ClassifiedFrames, events: list[Event]) -> None:
        """One frame, the usual case of a live stream: same as `_data`, with plain numbers."""
        rows, arrivals = cut.verdict.rows, cut.arrival_ns
        lost, stamp, mode, key, taken_back = rows.ravel().tolist()
        offset, size, body, _, _, sender = cut.table[:6, 0].tolist()
        offset += cut.start
        kind = self._kinds.get(key) or self._learn(key)
        payload, device = kind.payload, kind.device
        clock = self._clocks.get(key >> SOURCE_SHIFT) or self._clock(key >> SOURCE_SHIFT)
        arrival = arrivals.item()
        watch = self._watches.get(key >> SOURCE_SHIFT) if self._watches else None
        if watch is not None and watch.add(stamp, arrival):
            self._judge_unit(key >> SOURCE_SHIFT, watch)
        time = clock.tick(stamp, arrival) * self._tick_ns
        for _, step, by in clock.steps:
            events.append(ClockStep(offset, step, by * self._tick_ns, arrival, device))
        if taken_back:
            events.append(SampleGap(offset, -taken_back, "sequence", arrival, time, device))
        if lost > MAX_NUMBERS_AHEAD and mode < SECURE:
            self._jumped(sender, lost, cut, 0, events)
        elif lost:
            events.append(SampleGap(offset, lost, "sequence", arrival, time, device))
        if cut.verdict.other:
            self._newer(cut, events)
        if payload.error:
            self._warn(sender, payload.message.name, payload.error, cut, 0, events)
        gathered = np.ndarray((1, payload.width), UINT8, cut.data[body : body + payload.width])
        shown = DecodedPayload(payload, gathered, rows[MODE], kind.unverified, self._rotation)
        offsets, times = one_number(offset), one_number(time)
        header = LazyMapping(_header, cut.data, cut.start, offsets)
        batch = Batch(payload.message, device, arrivals, offsets, times, shown, not kind.unverified, size, header)
        events.append(batch)

    def _batch(self, cut: ClassifiedFrames, which: Ints, times: Ints, events: list[Event]) -> Batch:
        """The batch of the frames with one key."""
        one = int(which[0])
        key, size = int(cut.verdict.rows[KEY, one]), int(cut.table[SIZE, one])
        kind = self._kinds.get(key) or self._learn(key)
        payload = kind.payload
        if payload.error:
            self._warn(int(kind.device), payload.message.name, payload.error, cut, one, events)
        rows, about = np.empty((len(which), payload.width), np.uint8), np.empty((ABOUT, len(which)), np.int64)
        gather(cut.array, cut.table, cut.verdict.rows, cut.arrival_ns, times, which, cut.start, rows, about)
        offsets, arrivals, own_times, modes = about
        shown = DecodedPayload(payload, rows, modes, kind.unverified, self._rotation)
        header = LazyMapping(_header, cut.data, cut.start, offsets)
        trusted = not kind.unverified
        return Batch(payload.message, kind.device, arrivals, offsets, own_times, shown, trusted, size, header)

    def _learn(self, key: int) -> _PayloadKind:
        """Store the meaning of a key."""
        source, old, number, length = key_of(key)
        device, unverified = source_of(source)
        layout = key & LAYOUT
        if layout not in self._payloads:
            if len(self._payloads) >= _MAX_LAYOUTS:
                self._payloads.clear()
            self._payloads[layout] = Payload(number, old, length, self._schema, self._tick_ns)
        if len(self._kinds) >= _MAX_LAYOUTS:
            self._kinds.clear()
        self._kinds[key] = _PayloadKind(self._payloads[layout], str(device), unverified)
        return self._kinds[key]

    # -- time and loss -------------------------------------------------------------------------------------------------

    def _times(self, cut: ClassifiedFrames, offsets: Ints, events: list[Event]) -> Ints:
        """Device time of each frame, ns; each device (verified or not) has its own clock."""
        rows, arrivals = cut.verdict.rows, cut.arrival_ns
        if not cut.verdict.mixed:
            return self._unwrap(int(rows[KEY, 0]) >> SOURCE_SHIFT, rows[TIMESTAMP], arrivals, offsets, None, events)
        times = np.empty(len(offsets), np.int64)
        for source, which in _groups(rows[KEY] >> SOURCE_SHIFT):
            raw = rows[TIMESTAMP][which]
            times[which] = self._unwrap(source, raw, arrivals[which], offsets, which, events)
        return times

    def _unwrap(
        self, source: int, raw: Ints, arrivals: Ints, offsets: Ints, which: Ints | None, events: list[Event]
    ) -> Ints:
        """Device time of the rows `raw`, which belong to the frames `which` of those at `offsets`, or to all."""
        clock = self._clocks.get(source) or self._clock(source)
        if self._watches:
            self._watch(source, raw, arrivals)
        ticks = clock.ticks(raw, arrivals)
        for i, kind, by in clock.steps:
            device = str(source_of(source)[0])
            offset = int(offsets[i if which is None else which[i]])
            events.append(ClockStep(offset, kind, by * self._tick_ns, int(arrivals[i]), device))
        return ticks * self._tick_ns

    def _clock(self, source: int) -> TickUnwrapper:
        clock = self._clocks[source] = TickUnwrapper(WRAP, tick_ns=self._tick_ns)
        if len(self._clocks) == 1:  # one unit for all: taken from the first device
            self._watches[source] = UnitWatch(self._time_unit)
        return clock

    def _watch(self, source: int, raw: Ints, arrivals: Ints) -> None:
        """Compare the timestamps of the first second with their arrival."""
        watch = self._watches.get(source)
        if watch is not None:
            watch.observe(raw, arrivals)
            self._judge_unit(source, watch)

    def _judge_unit(self, source: int, watch: UnitWatch) -> None:
        if watch.done:
            self.contradiction = watch.contradiction
            del self._watches[source]

    def _gaps(self, cut: ClassifiedFrames, offsets: Ints, times: Ints, events: list[Event]) -> None:
        missing, taken_back = cut.verdict.rows[[LOST, TAKEN_BACK]]
        for i in np.flatnonzero(missing | taken_back).tolist():
            device = str(int(cut.table[SENDER, i]))
            lost, false = int(missing[i]), int(taken_back[i])
            if lost > MAX_NUMBERS_AHEAD and cut.verdict.rows[MODE, i] < SECURE:
                self._jumped(int(device), lost, cut, i, events)
                lost = 0
            for number in (-false, lost):
                if number:
                    at, arrival = int(offsets[i]), int(cut.arrival_ns[i])
                    events.append(SampleGap(at, number, "sequence", arrival, int(times[i]), device))

    def _jumped(self, device: int, lost: int, cut: ClassifiedFrames, row: int, events: list[Event]) -> None:
        """Report the numbers that a far jump skips; not counted as lost, as a number below Secure can be forged."""
        words = f"its sequence number jumped ahead by {lost + 1}, which is not counted as lost"
        self._warn(device, "jump", words, cut, row, events)

    # -- warnings ------------------------------------------------------------------------------------------------------

    def _warn(self, device: int, topic: str, words: str, cut: ClassifiedFrames, row: int, events: list[Event]) -> None:
        """Report something about a device, once."""
        if (device, topic) in self._reported:
            return
        self._reported.add((device, topic))
        offset, size = cut.start + int(cut.table[OFFSET, row]), int(cut.table[SIZE, row])
        values = {"device_id": device, "warning": words}
        events.append(Reply(WARNING, values, offset, size, int(cut.arrival_ns[row]), str(device)))

    def _newer(self, cut: ClassifiedFrames, events: list[Event]) -> None:
        """Warn about versions other than the known one."""
        minors = cut.array[cut.table[OFFSET] + VERSION_AT].astype(np.int64) & 0xF
        for device, at in zip(*np.unique(cut.table[SENDER] << 4 | minors, return_index=True), strict=True):
            minor = int(minors[at])
            if minor > KNOWN_MINOR:
                words = f"uses IDTP 2.{minor}, newer than the supported one, and is decoded as 2.{KNOWN_MINOR}"
                self._warn(int(device) >> 4, f"2.{minor}", words, cut, int(at), events)
            elif minor < KNOWN_MINOR:
                words = "uses IDTP 2.0, in which every payload type is vendor-specific"
                self._warn(int(device) >> 4, f"2.{minor}", words, cut, int(at), events)

    def _other_protocols(self, cut: ClassifiedFrames) -> Iterator[Reply]:
        """Report INDT and other versions of IDTP by name, once each."""
        for reject in cut.rejects:
            if reject.reason == REASONS[SUCCESSOR]:
                what = "these bytes are INDT, the successor of IDTP"
            elif reject.reason == REASONS[BAD_VERSION]:
                what = f"these frames are of IDTP {version_at(cut.data, reject.offset - cut.start)}"
            else:
                continue
            if (-1, what) not in self._reported and len(self._reported) < _MAX_LAYOUTS:
                self._reported.add((-1, what))
                values = {"warning": f"{what}, which is not supported"}
                yield Reply(WARNING, values, reject.offset, reject.size, reject.arrival_ns)


def _header(data: bytes, start: int, offsets: Ints) -> Mapping[str, Any]:
    """Timestamp and sequence number as the frames at `offsets` sent them."""
    at = (offsets - start + TIMESTAMP_AT)[:, None] + np.arange(8)
    both = np.frombuffer(data, np.uint8)[at].view("<u4")
    return {"timestamp": both[:, 0], "sequence": both[:, 1]}


def _groups(keys: Ints) -> Iterator[tuple[int, Ints]]:
    """Yield each key and its rows."""
    order, bounds = np.empty(len(keys), np.int64), np.empty(len(keys) + 1, np.int64)
    groups = group(keys, order, bounds)
    for first, last in pairwise(bounds[: groups + 1].tolist()):
        yield int(keys[order[first]]), order[first:last]
