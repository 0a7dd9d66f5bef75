"""Lines of a log of CAN frames in, sample groups out.

    chunks ─> StreamParser (lines.py) ─> frames ─> by identifier ─> sample groups (group_frames) ─> one Batch for each
                      │                                               set of messages that a group has
                      ├─> definitions (definition.py)
                      └─> lines without a frame, frames of another length: RejectedFrame

A sample group is what MTData2 is on a serial line: the quantities of one moment. Its arrival is that of its first
frame. Messages of high rate are apart from the groups, as they are there.

## Time

The clock of a group is SampleTime, else UtcTime while no SampleTime was seen; a group without has no device time.

## Loss

PacketCounter counts the groups; missing numbers are a SampleGap. Frames that are missing in a group are not counted:
a device sends each quantity at a rate of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array, Ints
from imuscope.protocols.can.definition import KINDS, CanDefinition, default_definition, read_definition, read_step
from imuscope.protocols.can.lines import DATA, DEFINITION, payloads, scan
from imuscope.protocols.can.rows import CanRow
from imuscope.protocols.clocks.counters import SequenceCounter, TickUnwrapper
from imuscope.protocols.clocks.dates import UNKNOWN, utc_ns
from imuscope.protocols.events import Batch, ClockStep, Count, Event, RejectedFrame, Reply, SampleGap, stream_order
from imuscope.protocols.framing.stream_buffer import BODY, ID, LENGTH, OFFSET, SENDER, SIZE
from imuscope.protocols.framing.stream_parser import ParseResult, StreamDecoder, StreamParser
from imuscope.protocols.native.kernels import INT, INTS, compiled
from imuscope.protocols.schema.fields import Field, Message

MASK, LAST, COUNT = range(3)
"""Indices of the state: messages of the open group as bits, arrival of its newest frame, number of groups so far."""
STATES = 3
PAUSE_NS = 50_000_000
"""Within a group: some 15 frames on a bus of 125 kbit/s that others use as well take 30 ms."""


@compiled(INT, INTS, INTS, INT, INTS, INTS)
def group_frames(ranks: Ints, arrivals: Ints, heads: int, state: Ints, out: Ints) -> int:
    """Number the groups of frames, continuing from the state.

        SampleTime PacketCounter Quaternion Acceleration │ SampleTime PacketCounter Quaternion │ …

    A group begins at SampleTime, at a PacketCounter or UtcTime that others stand before, at a message that it has
    already, and after a pause. Each frame is decided from those before it alone.

    Args:
        ranks: (n,) place of each frame's message in the order in which a device sends them.
        arrivals: (n,) ns.
        heads: ranks, as bits, of the messages that stand first in a group.
        out: (n,), written: number of the group of each frame.

    Returns:
        the number of the open group.
    """
    for k in range(len(ranks)):
        bit = 1 << ranks[k]
        mask = state[MASK]
        passed = arrivals[k] - state[LAST]
        begins = mask & bit != 0 or mask == 0 or passed > PAUSE_NS or passed < -PAUSE_NS
        if heads & bit != 0 and mask >= bit:
            begins = True
        if begins:
            state[COUNT] += 1
            state[MASK] = 0
        state[MASK] |= bit
        state[LAST] = arrivals[k]
        out[k] = state[COUNT]
    return int(state[COUNT])


FRAME_BYTES = 8
GROUP, APART = "SampleGroup", "HighRate"
COUNTER = "PacketCounter"
NO_CLOCK, UTC, FINE = range(3)
HEADS = ("time", "counter", "utc")
_GROUPED, _REPORT, _APART = range(3)
_SORTS = {"report": _REPORT, "apart": _APART}
EARLIEST_YEAR = 2019  # there was no such device before: a clock that is not set


@dataclass(slots=True)
class Frames:
    """Frames of known messages, in the order of the stream: (n,) each, and their bytes (n, 8)."""

    ranks: Ints
    arrivals: Ints
    offsets: Ints
    data: NDArray[np.uint8]

    @classmethod
    def none(cls) -> Frames:
        empty = np.empty(0, np.int64)
        return cls(empty, empty, empty, np.empty((0, FRAME_BYTES), np.uint8))

    def some(self, which: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Frames:
        return Frames(self.ranks[which], self.arrivals[which], self.offsets[which], self.data[which])

    def after(self, before: Frames) -> Frames:
        """These after others."""
        if not len(before.ranks):
            return self
        return Frames(
            np.concatenate((before.ranks, self.ranks)),
            np.concatenate((before.arrivals, self.arrivals)),
            np.concatenate((before.offsets, self.offsets)),
            np.concatenate((before.data, self.data)),
        )


@dataclass(slots=True)
class _Series:
    """Groups of one kind: the sample groups, or those of high rate."""

    name: str
    title: str
    state: Ints = field(default_factory=lambda: np.zeros(STATES, np.int64))
    open: Frames = field(default_factory=Frames.none)
    messages: dict[int, Message] = field(default_factory=dict)


class CanDecoder(StreamDecoder[StreamParser]):
    """See events.Decoder.

    Args:
        direction: accepted for the interface; a bus has one.
    """

    def __init__(self, *, direction: str = "to_host") -> None:
        super().__init__(StreamParser(scan))
        self._counter = SequenceCounter(1 << 16)
        self._clock = NO_CLOCK
        self._define(default_definition())

    def _define(self, definition: CanDefinition) -> None:
        self._definition = definition
        self._kind = KINDS[definition.kind]
        self._ranks = {row.name: rank for rank, row in enumerate(self._kind.rows)}
        self._sorts = np.array([_SORTS.get(row.role, _GROUPED) for row in self._kind.rows])
        self._heads = sum(1 << rank for rank, row in enumerate(self._kind.rows) if row.role in HEADS)
        self._groups, self._fast = _Series(GROUP, "Sample group"), _Series(APART, "High rate")
        self._ticks = TickUnwrapper(1 << 32, tick_ns=definition.tick_ns)

    @property
    def remarks(self) -> list[str]:
        """Sentences about the stream for the user."""
        return list(self._definition.remarks)

    def count_of(self, device: str = "") -> Count | None:
        counter = self._counter
        if device or counter.first is None or counter.last is None:
            return None
        return Count(COUNTER, counter.first, counter.last, counter.passed, counter.modulus)

    def drain(self, *, stalled: bool = False) -> list[Event]:
        """Return every complete event. The newest group is complete when the next begins, or after a pause."""
        cut = self._stream.drain(stalled=stalled)
        events: list[Event] = [*cut.rejects]
        kinds = cut.table[SENDER]
        first = 0
        for place in [*np.flatnonzero(kinds == DEFINITION).tolist(), cut.table.shape[1]]:
            events += self._frames(cut, first, place)
            if place < cut.table.shape[1]:
                begin, size = int(cut.table[BODY, place]), int(cut.table[LENGTH, place])
                events += self._define_by(cut.data[begin : begin + size], cut, place)
            first = place + 1
        if stalled:
            events += self._flush()
        return sorted(events, key=stream_order)

    def _define_by(self, body: bytes, cut: ParseResult, place: int) -> Iterator[Event]:
        """Events of a line that defines messages, or a step of the clock of the log."""
        definition, step = read_definition(body), read_step(body)
        if definition is not None and definition != self._definition:
            yield from self._flush()
            self._define(definition)
        elif step is not None:
            yield from self._flush()
            if self._clock != NO_CLOCK:
                return
            yield ClockStep(cut.start + int(cut.table[OFFSET, place]), "log", step, int(cut.arrival_ns[place]))

    def _flush(self) -> Iterator[Event]:
        for series in (self._groups, self._fast):
            frames, series.open = series.open, Frames.none()
            series.state[:COUNT] = 0
            if len(frames.ranks):
                yield from self._events(series, frames, np.zeros(len(frames.ranks), np.int64))

    # -- frames --------------------------------------------------------------------------------------------------------

    def _frames(self, cut: ParseResult, first: int, stop: int) -> Iterator[Event]:
        """Events of the frames of some columns."""
        table = cut.table[:, first:stop]
        rows = self._definition.rows
        numbers, inverse = np.unique(table[ID], return_inverse=True)
        known = [rows.get(number) for number in numbers.tolist()]
        ranks = np.array([-1 if row is None else self._ranks[row.name] for row in known] or [0], np.int64)[inverse]
        sizes = np.array([0 if row is None else row.size for row in known] or [0], np.int64)[inverse]
        is_known = (ranks >= 0) & (table[SENDER] == DATA)
        is_short = is_known & (table[LENGTH] < sizes)
        for place in np.flatnonzero(is_short).tolist():
            offset, size = cut.start + int(table[OFFSET, place]), int(table[SIZE, place])
            yield RejectedFrame(offset, size, "bad_size", int(cut.arrival_ns[first + place]))
        which = np.flatnonzero(is_known & ~is_short)
        if not len(which):
            return
        data = np.empty((len(which), FRAME_BYTES), np.uint8)
        payloads(cut.array, table[BODY, which], np.minimum(table[LENGTH, which], FRAME_BYTES), data)
        offsets = table[OFFSET, which] + cut.start
        frames = Frames(ranks[which], np.ascontiguousarray(cut.arrival_ns[first:stop][which]), offsets, data)
        sorts = self._sorts[frames.ranks]
        for place in np.flatnonzero(sorts == _REPORT).tolist():
            yield self._report(frames, place, cut)
        for series, sort in ((self._groups, _GROUPED), (self._fast, _APART)):
            some = frames if sort == _GROUPED and not sorts.any() else frames.some(sorts == sort)
            if len(some.ranks):
                yield from self._grouped(series, some)

    def _report(self, frames: Frames, place: int, cut: ParseResult) -> Reply:
        row = self._kind.rows[int(frames.ranks[place])]
        code = int(frames.data[place, 0])
        message = Message(row.identifier, row.name, (row.field,), kind="indication", doc=row.field.doc)
        offset = int(frames.offsets[place])
        size = cut.data.find(b"\n", offset - cut.start) + 1 - (offset - cut.start)
        return Reply(message, {row.name: code}, offset, size, int(frames.arrivals[place]))

    def _grouped(self, series: _Series, frames: Frames) -> Iterator[Event]:
        """Events of the groups that are complete; the frames of the open one wait."""
        numbers = np.empty(len(frames.ranks), np.int64)
        waiting = series.open
        before = int(series.state[COUNT])
        newest = group_frames(frames.ranks, np.ascontiguousarray(frames.arrivals), self._heads, series.state, numbers)
        numbers = np.concatenate((np.full(len(waiting.ranks), before, np.int64), numbers))
        frames = frames.after(waiting)
        complete = int(np.searchsorted(numbers, newest))
        series.open = frames.some(slice(complete, None))
        if complete:
            yield from self._events(series, frames.some(slice(complete)), numbers[:complete])

    # -- groups --------------------------------------------------------------------------------------------------------

    def _events(self, series: _Series, frames: Frames, numbers: Ints) -> Iterator[Event]:
        """Events of whole groups."""
        first = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
        place = np.full((len(first), len(self._kind.rows)), -1, np.int64)
        group = np.cumsum(np.diff(numbers, prepend=numbers[0]) > 0)
        place[group, frames.ranks] = np.arange(len(numbers))
        times, is_timed = np.zeros(len(first), np.int64), np.zeros(len(first), np.bool_)
        arrivals, offsets = frames.arrivals[first], frames.offsets[first]
        if series is self._groups:
            times, is_timed, steps = self._times(frames, place, arrivals, offsets)
            yield from steps
            yield from self._gaps(frames, place, times, is_timed, arrivals, offsets)
        masks = (place >= 0) @ (1 << np.arange(place.shape[1], dtype=np.int64))
        keys = 2 * masks + is_timed
        for key in np.unique(keys).tolist():
            which = np.flatnonzero(keys == key)
            rows = [(rank, row) for rank, row in enumerate(self._kind.rows) if key >> 1 & 1 << rank]
            columns = {row.name: row.column(frames.data[place[which, rank]]) for rank, row in rows}
            time = times[which] if key & 1 else None
            message = self._message(series, key >> 1, columns)
            yield Batch(message, "", arrivals[which], offsets[which], time, self._joined(columns))

    def _message(self, series: _Series, mask: int, columns: dict[str, Array]) -> Message:
        message = series.messages.get(mask)
        if message is None:
            fields: list[Field] = [row.field for row in self._kind.rows if row.name in columns]
            joined = [one for one in self._kind.joined if set(one.parts) <= columns.keys()]
            parts = {part for one in joined for part in one.parts}
            fields = [*(one for one in fields if one.name not in parts), *(one.field for one in joined)]
            names = {one.name for one in fields}
            clock = next((row.name for row in self._kind.rows if row.role == "time" and row.name in names), "")
            tick = self._definition.tick_ns if clock else 0
            message = Message(
                0,
                series.name,
                tuple(map(self._in_its_unit, fields)),
                clock,
                tick,
                1 << 32,
                title=series.title,
                channel_per_field=True,
            )
            series.messages[mask] = message
        return message

    def _in_its_unit(self, one: Field) -> Field:
        """The clock with the unit of its ticks; any other field as it is."""
        if one.name != self._row("time").name or self._definition.tick_ns == self._kind.ticks_ns[0]:
            return one
        return replace(one, unit="µs", doc="Sample time in µs; wraps at 2³².")

    def _row(self, role: str) -> CanRow:
        return next(row for row in self._kind.rows if row.role == role)

    def _joined(self, columns: dict[str, Array]) -> dict[str, Array]:
        for one in self._kind.joined:
            if set(one.parts) <= columns.keys():
                columns[one.field.name] = np.stack([columns.pop(part) for part in one.parts], axis=1)
        return columns

    # -- time and loss -------------------------------------------------------------------------------------------------

    def _values(self, frames: Frames, place: Ints, role: str) -> tuple[Ints, NDArray[np.uint8]]:
        """Groups that have the message of a role, and its bytes."""
        column = place[:, self._ranks[self._row(role).name]]
        which = np.flatnonzero(column >= 0)
        return which, frames.data[column[which]]

    def _times(
        self, frames: Frames, place: Ints, arrivals: Ints, offsets: Ints
    ) -> tuple[Ints, NDArray[np.bool_], list[Event]]:
        """Device time of each group, ns; whether it has one; steps of the clock."""
        times, is_timed = np.zeros(len(place), np.int64), np.zeros(len(place), np.bool_)
        steps: list[Event] = []
        which, data = self._values(frames, place, "time")
        begin = int(which[0]) if len(which) else len(place)
        if self._clock != FINE:
            utc, bytes_of = self._values(frames, place, "utc")
            ns = utc_of_records(self._row("utc").column(bytes_of))
            usable = (ns != UNKNOWN) & (utc < begin)
            times[utc[usable]], is_timed[utc[usable]] = ns[usable], True
            if usable.any():
                self._clock = UTC
            if len(which) and self._clock == UTC:
                steps.append(ClockStep(int(offsets[begin]), "sync", 0, int(arrivals[begin])))
        if len(which):
            self._clock = FINE
            raw = np.ascontiguousarray(data[:, :4]).view(">u4")[:, 0].astype(np.int64)
            ticks = self._ticks.ticks(raw)
            tick_ns = self._definition.tick_ns
            times[which], is_timed[which] = ticks * tick_ns, True
            for row, kind, by in self._ticks.steps:
                at = int(which[row])
                steps.append(ClockStep(int(offsets[at]), kind, by * tick_ns, int(arrivals[at])))
        return times, is_timed, steps

    def _gaps(
        self, frames: Frames, place: Ints, times: Ints, is_timed: NDArray[np.bool_], arrivals: Ints, offsets: Ints
    ) -> Iterator[Event]:
        which, data = self._values(frames, place, "counter")
        if not len(which):
            return
        missing = self._counter.missing(np.ascontiguousarray(data[:, :2]).view(">u2")[:, 0])
        for k in np.flatnonzero(missing).tolist():
            at = int(which[k])
            time = int(times[at]) if is_timed[at] else None
            yield SampleGap(int(offsets[at]), int(missing[k]), COUNTER, int(arrivals[at]), time)


def utc_of_records(rows: Array) -> Ints:
    """Records of UtcTime as ns since the Unix epoch; UNKNOWN where a record is not a date."""
    names = ("year", "month", "day", "hour", "minute", "second", "ns")
    year, month, day, hour, minute, second, ns = (rows[name].astype(np.int64) for name in names)
    return utc_ns(year, month, day, hour, minute, second, ns, np.ones(len(rows), np.bool_))


def utc_of(batch: Batch) -> Ints | None:
    """UTC of each sample; None if no sample has it."""
    if "UtcTime" not in batch.columns:
        return None
    rows = batch.columns["UtcTime"]
    times = np.where(rows["year"] >= EARLIEST_YEAR, utc_of_records(rows), UNKNOWN)
    return times if (times != UNKNOWN).any() else None
