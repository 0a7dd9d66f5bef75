"""Bytes of IDTP devices in, events out: one Batch for each device and layout, what was lost, and what was refused.

    chunks ──> IdtpStream ──> frames ──> group by (device, verified, version, type, length) ──> Batch
                   │              └─> sequence numbers ──> SampleGap      timestamps ──> time, ClockStep
                   └─> Reject

## Devices and trust

Several devices may share a link: `Batch.device` is the device_id, in decimal. Lite and Safety frames say what they are
in the Status column of their batch; Secure frames that could not be verified come only when they were asked for, as
batches of their own whose `verified` is False, with a clock of their own, and they touch nothing else.

## Time

The timestamp counts in a unit that the document only recommends (µs), so it is a setting; 32 bits of µs wrap every 71.6
minutes and are unwrapped, for each device apart. Where arrival speaks for another unit, `contradiction` says so.

What a person should know, once for each device, comes as a Reply named "Warning": a newer version, payloads of an
unexpected length, a successor protocol.

Source: IDTP v2.1.0, with its errata.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple, get_args

import numpy as np

from protocols.counters import TickUnwrapper
from protocols.events import Batch, ClockStep, Count, Doubt, Event, LazyMapping, Reply, SampleGap
from protocols.framing import BAD_VERSION, BODY, INDT, OFFSET, REASONS, SENDER, SIZE, Bytes, Ints
from protocols.grouping import group
from protocols.idtp.custom_payloads import Schema
from protocols.idtp.frames import LITE, SECURE, SEQUENCE_AT, TIMESTAMP_AT, VERSION_AT, version_at
from protocols.idtp.payloads import DecodedPayload, Payload, Rotation
from protocols.idtp.replay_guard import FAR, KEY, LOST, MODE, SOURCE_SHIFT, TIMESTAMP, key_of, source_of
from protocols.idtp.stream_parser import Cut, IdtpStream
from protocols.idtp.units import UNITS, UnitWatch
from protocols.jit import BYTES, INTS, NOTHING, ROWS, compiled, unsigned
from protocols.schema import Direction, Message
from protocols.stream_parser import StreamDecoder

WRAP = 2**32
KNOWN_MINOR = 1
WARNING = Message(-1, "Warning", kind="indication", doc="What a person should know about a device.")

LAYOUT = (1 << SOURCE_SHIFT) - 1  # the part of a KEY that decides the layout
_LAYOUTS = 4096  # remembered; a device has a handful


@compiled(NOTHING, BYTES, INTS, ROWS)
def gather(data: Bytes, starts: Ints, rows: Bytes) -> None:
    """Copy `rows.shape[1]` bytes from each of `starts` into the rows of one array."""
    width = unsigned(rows.shape[1])
    for f in range(unsigned(len(starts))):
        start = unsigned(starts[f])
        for i in range(width):
            rows[f, i] = data[start + i]


class _Kind(NamedTuple):
    """What the frames of one KEY have in common."""

    payload: Payload
    device: str
    unverified: bool


class IdtpDecoder(StreamDecoder[IdtpStream]):
    """See events.Decoder.

    Args:
        direction: devices only send; kept for those who ask.
        key: for Secure frames; with one, only Secure frames are accepted unless `min_mode` says otherwise.
        min_mode: 0 (Lite), 1 (Safety) or 2 (Secure): weaker frames are rejected as `below_min_mode`.
        replay_check: False accepts frames whatever their sequence numbers.
        time_unit: of the timestamp: "ns", "us", "ms" or "s".
        rotation: which way a device's quaternion turns; the column always turns body to ENU.
        show_unverified: without a key, show Secure frames, marked, instead of rejecting them as `no_key`.
        schema: rows of the vendor's own payload types, see custom_payloads.py.
        datagrams: every chunk is a datagram.
    Raises:
        ValueError: a setting that there is not.
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
            )
        )
        self._time_unit = time_unit
        self._tick_ns = UNITS[time_unit]
        self._watches: dict[int, UnitWatch] = {}  # by source
        self.contradiction: Doubt | None = None  # a unit that the arrival of the frames speaks for
        self._rotation: Rotation = rotation
        self._schema: Schema = schema or {}
        self._payloads: dict[int, Payload] = {}  # by the layout's part of a KEY, see replay_guard.py
        self._kinds: dict[int, _Kind] = {}  # by KEY
        self._clocks: dict[int, TickUnwrapper] = {}  # by source
        self._firsts: dict[int, int] = {}  # by source, its first sequence number
        self._said: set[tuple[int, str]] = set()

    def rearm(self, device: str = "") -> None:
        """Accept whatever sequence number comes next, of one device or ("") of all; see replay_guard.py.

        Raises:
            ValueError: no device identifier.
        """
        if device and not (device.isdecimal() and int(device) <= 0xFFFF):
            raise ValueError(f"a device is a number from 0 to 65535, given {device!r}")
        self._stream.sequences.rearm(int(device) if device else None)

    def remembered(self) -> Mapping[int, int]:
        """See events.Remembers."""
        heard = (source_of(source) for source in self._clocks)
        return self._stream.sequences.remembered(device for device, unverified in heard if not unverified)

    def recall(self, numbers: Mapping[int, int]) -> None:
        """See events.Remembers."""
        self._stream.sequences.recall(numbers)

    def drain(self, *, stalled: bool = False) -> list[Event]:
        """Everything complete, by offset; a batch stands where its first frame began."""
        events: list[Event] = []
        for cut in self._stream.drain(stalled=stalled):
            if cut.rejects:
                events += cut.rejects
                events += self._other_protocols(cut)
            if cut.table.shape[1]:
                self._data(cut, events)
                if len(self._firsts) < len(self._clocks):
                    self._note_firsts(cut)
        return sorted(events, key=_offset) if len(events) > 1 else events

    def _note_firsts(self, cut: Cut) -> None:
        """The numbers that devices began with."""
        senders = cut.table[SENDER]
        for source in self._clocks.keys() - self._firsts.keys():
            device, _ = source_of(source)
            row = int(np.argmax(senders == device))
            at = int(cut.table[OFFSET, row]) + SEQUENCE_AT
            self._firsts[source] = int.from_bytes(bytes(cut.data[at : at + 4]), "little")

    def count_of(self, device: str = "") -> Count | None:
        """See events.Counts."""
        verified = {str(source_of(source)[0]): source for source in self._firsts if not source_of(source)[1]}
        if device not in verified:
            return None
        first, last = self._firsts[verified[device]], self._stream.sequences.last_of(int(device), LITE)
        return Count("sequence", first, last, (last - first) % (1 << 32), 1 << 32)

    # -- batches -------------------------------------------------------------------------------------------------------

    def _data(self, cut: Cut, events: list[Event]) -> None:
        """Batches, gaps, steps and warnings of the accepted frames."""
        rows, table = cut.judged.rows, cut.table
        if table.shape[1] == 1:
            self._single(cut, events)
            return
        offsets = table[OFFSET] + cut.start
        times = self._times(cut, offsets, events)
        if cut.judged.gaps:
            self._gaps(cut, offsets, times, events)
        if cut.judged.other:
            self._newer(cut, events)
        for key, which in _groups(rows[KEY]):
            events.append(self._batch(cut, key, which, offsets, times, events))

    def _single(self, cut: Cut, events: list[Event]) -> None:
        """One frame, the usual case of a live stream: what `_data` does, with plain numbers."""
        rows, arrivals = cut.judged.rows, cut.arrival_ns
        lost, stamp, _, key = rows[:, 0].tolist()
        offset, size, body, _, _, sender = cut.table[:6, 0].tolist()
        offset += cut.start
        kind = self._kinds.get(key) or self._learn(key)
        payload, device = kind.payload, kind.device
        clock = self._clocks.get(key >> SOURCE_SHIFT) or self._clock(key >> SOURCE_SHIFT)
        if self._watches:
            self._watch(key >> SOURCE_SHIFT, rows[TIMESTAMP], arrivals)
        time = clock.tick(stamp, int(arrivals[0])) * self._tick_ns
        for _, step, by in clock.steps:
            events.append(ClockStep(offset, step, by * self._tick_ns, int(arrivals[0]), device))
        if lost > FAR and rows[MODE, 0] < SECURE:
            self._jumped(sender, lost, cut, 0, events)
        elif lost:
            events.append(SampleGap(offset, lost, "sequence", int(arrivals[0]), time, device))
        if cut.judged.other:
            self._newer(cut, events)
        if payload.trouble:
            self._warn(sender, payload.message.name, payload.trouble, cut, 0, events)
        gathered = np.ndarray((1, payload.width), np.uint8, bytearray(cut.data[body : body + payload.width]))
        shown = DecodedPayload(payload, gathered, rows[MODE], kind.unverified, self._rotation)
        offsets, times = np.array((offset,)), np.array((time,))
        header = LazyMapping(partial(_header, cut.data, cut.start, offsets))
        batch = Batch(payload.message, device, arrivals, offsets, times, shown, not kind.unverified, size, header)
        events.append(batch)

    def _batch(self, cut: Cut, key: int, which: Ints | None, offsets: Ints, times: Ints, events: list[Event]) -> Batch:
        """The frames of one key; `which` None: all of them."""
        kind = self._kinds.get(key) or self._learn(key)
        payload = kind.payload
        starts, modes, arrivals = cut.table[BODY], cut.judged.rows[MODE], cut.arrival_ns
        size = int(cut.table[SIZE, 0 if which is None else which[0]])
        if which is None:
            modes = modes.copy()  # that memory is good until the next drain only
        else:
            starts, modes, arrivals = starts[which], modes[which], arrivals[which]
            offsets, times = offsets[which], times[which]
        if payload.trouble:
            first = 0 if which is None else int(which[0])
            self._warn(int(kind.device), payload.message.name, payload.trouble, cut, first, events)
        gathered = np.empty((len(starts), payload.width), np.uint8)
        gather(cut.array, starts, gathered)
        shown = DecodedPayload(payload, gathered, modes, kind.unverified, self._rotation)
        header = LazyMapping(partial(_header, cut.data, cut.start, offsets))
        return Batch(payload.message, kind.device, arrivals, offsets, times, shown, not kind.unverified, size, header)

    def _learn(self, key: int) -> _Kind:
        """What a key stands for."""
        source, old, number, length = key_of(key)
        device, unverified = source_of(source)
        layout = key & LAYOUT
        if layout not in self._payloads:
            if len(self._payloads) >= _LAYOUTS:
                self._payloads.clear()
            self._payloads[layout] = Payload(number, old, length, self._schema, self._tick_ns)
        if len(self._kinds) >= _LAYOUTS:
            self._kinds.clear()
        self._kinds[key] = _Kind(self._payloads[layout], str(device), unverified)
        return self._kinds[key]

    # -- time and loss -------------------------------------------------------------------------------------------------

    def _times(self, cut: Cut, offsets: Ints, events: list[Event]) -> Ints:
        """Device time of each frame, ns; each device (verified or not) has its own clock."""
        rows, arrivals = cut.judged.rows, cut.arrival_ns
        if not cut.judged.mixed:
            return self._unwrap(int(rows[KEY, 0]) >> SOURCE_SHIFT, rows[TIMESTAMP], arrivals, offsets, events)
        times = np.empty(len(offsets), np.int64)
        for source, which in _groups(rows[KEY] >> SOURCE_SHIFT):
            pick: Any = slice(None) if which is None else which
            raw = rows[TIMESTAMP][pick]
            times[pick] = self._unwrap(source, raw, arrivals[pick], offsets[pick], events)
        return times

    def _unwrap(self, source: int, raw: Ints, arrivals: Ints, offsets: Ints, events: list[Event]) -> Ints:
        clock = self._clocks.get(source) or self._clock(source)
        if self._watches:
            self._watch(source, raw, arrivals)
        ticks = clock.ticks(raw, arrivals)
        for i, kind, by in clock.steps:
            device = str(source_of(source)[0])
            events.append(ClockStep(int(offsets[i]), kind, by * self._tick_ns, int(arrivals[i]), device))
        return ticks * self._tick_ns

    def _clock(self, source: int) -> TickUnwrapper:
        clock = self._clocks[source] = TickUnwrapper(WRAP, tick_ns=self._tick_ns)
        if len(self._clocks) == 1:  # the unit is one for all: the first device tells
            self._watches[source] = UnitWatch(self._time_unit)
        return clock

    def _watch(self, source: int, raw: Ints, arrivals: Ints) -> None:
        """Hold the timestamps of the first second against their arrival."""
        watch = self._watches.get(source)
        if watch is None:
            return
        watch.look(raw, arrivals)
        if watch.done:
            self.contradiction = watch.found
            del self._watches[source]

    def _gaps(self, cut: Cut, offsets: Ints, times: Ints, events: list[Event]) -> None:
        missing = cut.judged.rows[LOST]
        for i in np.flatnonzero(missing).tolist():
            device = str(int(cut.table[SENDER, i]))
            lost = int(missing[i])
            if lost > FAR and cut.judged.rows[MODE, i] < SECURE:
                self._jumped(int(device), lost, cut, i, events)
                continue
            events.append(SampleGap(int(offsets[i]), lost, "sequence", int(cut.arrival_ns[i]), int(times[i]), device))

    def _jumped(self, device: int, lost: int, cut: Cut, row: int, events: list[Event]) -> None:
        """Below Secure anybody can forge a number: what a far jump passes over is told, not counted as lost."""
        words = f"its sequence number jumped ahead by {lost + 1}, which is not counted as lost"
        self._warn(device, "jump", words, cut, row, events)

    # -- what a person should know -------------------------------------------------------------------------------------

    def _warn(self, device: int, topic: str, words: str, cut: Cut, row: int, events: list[Event]) -> None:
        """Say something about a device, once."""
        if (device, topic) in self._said:
            return
        self._said.add((device, topic))
        offset, size = cut.start + int(cut.table[OFFSET, row]), int(cut.table[SIZE, row])
        values = {"device_id": device, "warning": words}
        events.append(Reply(WARNING, values, offset, size, int(cut.arrival_ns[row]), str(device)))

    def _newer(self, cut: Cut, events: list[Event]) -> None:
        """Versions other than the known one."""
        minors = cut.array[cut.table[OFFSET] + VERSION_AT].astype(np.int64) & 0xF
        for device, at in zip(*np.unique(cut.table[SENDER] << 4 | minors, return_index=True), strict=True):
            minor = int(minors[at])
            if minor > KNOWN_MINOR:
                words = f"speaks IDTP 2.{minor}, newer than what is known here, and is read as 2.{KNOWN_MINOR}"
                self._warn(int(device) >> 4, f"2.{minor}", words, cut, int(at), events)
            elif minor < KNOWN_MINOR:
                words = "speaks IDTP 2.0, in which every payload type is the vendor's own"
                self._warn(int(device) >> 4, f"2.{minor}", words, cut, int(at), events)

    def _other_protocols(self, cut: Cut) -> Iterator[Reply]:
        """INDT, and other versions of IDTP, by name, once each."""
        for reject in cut.rejects:
            if reject.reason == REASONS[INDT]:
                what = "these bytes speak INDT, the successor of IDTP"
            elif reject.reason == REASONS[BAD_VERSION]:
                what = f"these frames are of IDTP {version_at(cut.data, reject.offset - cut.start)}"
            else:
                continue
            if (-1, what) not in self._said and len(self._said) < _LAYOUTS:
                self._said.add((-1, what))
                values = {"warning": f"{what}, which is not read here"}
                yield Reply(WARNING, values, reject.offset, reject.size, reject.arrival_ns)


def _header(data: bytes, start: int, offsets: Ints) -> Mapping[str, Any]:
    """Timestamp and sequence number as the frames at `offsets` sent them."""
    at = (offsets - start + TIMESTAMP_AT)[:, None] + np.arange(8)
    both = np.frombuffer(data, np.uint8)[at].view("<u4")
    return {"timestamp": both[:, 0], "sequence": both[:, 1]}


def _groups(keys: Ints) -> Iterator[tuple[int, Ints | None]]:
    """Each key and its rows; None where it is the only one."""
    n = len(keys)
    order = np.empty(n, np.int64)
    bounds = np.empty(n + 1, np.int64)
    groups = group(keys, order, bounds)
    if groups == 1:
        yield int(keys[0]), None
        return
    for begin, end in pairwise(bounds[: groups + 1].tolist()):
        yield int(keys[order[begin]]), order[begin:end]


def _offset(event: Event) -> int:
    """Where an event stands in the stream. What is said about a frame comes before it."""
    if isinstance(event, Batch):
        return 2 * int(event.offset[0]) + 1
    return 2 * event.offset
