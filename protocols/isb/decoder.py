"""Bytes of an Inertial Sense device in, events out: data sets as columns, everything else by name.

    chunks ──> StreamParser ──> packets ──┬─ DATA of sets that stream ──> sort ──> one Batch for each form
                  │                 └─ others ─────────────────────────────> Reply
                  ├─> Text (NMEA, u-blox, RTCM 3), Reject
                  └─ clocks, in stream order over all sets ──> ClockStep, times

Packets of one data set, offset, size and variant have one form (messages.py) and become one batch. A packet with a part
of a set whose whole value was received gives a row of the whole: the last value with the part written over it. A part
of a set never received whole gives its own fields. Neither has a device time: the part does not contain the clock, and
the last value's may be hours old when a device streams parts alone.

The structure of a payload depends on its size and on the firmware named by the last device information (DID 1; 93 of an
EVB, 120 of a GPX). time_base.py computes the time.

Source: ISB document; inertial-sense-sdk 2.7.1.
"""

from typing import Any

import numpy as np

from imuscope.protocols.arrays import UINT8, Ints
from imuscope.protocols.embedded.finders import STARTS, find
from imuscope.protocols.events import Batch, ClockStep, Event, LazyMapping, Reply, stream_order
from imuscope.protocols.framing.grouping import group
from imuscope.protocols.framing.stream_buffer import BODY, OFFSET, SIZE, ScanCapacity, one_number
from imuscope.protocols.framing.stream_parser import ParseResult, StreamDecoder, StreamParser
from imuscope.protocols.isb import messages
from imuscope.protocols.isb.classify import (
    ABOUT,
    BY,
    FAMILIES,
    KEY,
    NO_FIRMWARE,
    PART,
    SORTED,
    STEP,
    TIME,
    TIMED,
    WHOLE_KEY,
    empty_state,
    gather,
    sort,
)
from imuscope.protocols.isb.dataset_loader import VERSIONS
from imuscope.protocols.isb.frames import SET_DATA, TYPE_MASK, WITH_OFFSET, scan
from imuscope.protocols.isb.json_codec import values_of
from imuscope.protocols.isb.time_base import NO_STEP, STEPS, store_offset
from imuscope.protocols.schema.fields import Direction, Message

RULES = messages.rules()
VERSION_NUMBERS = messages.version_numbers()
_MAX_FORMS = 4096  # forms remembered; a device has some dozens
_NOTHING = np.empty(0, np.uint8)


class IsbDecoder(StreamDecoder[StreamParser]):
    """See events.Decoder. The packet type gives the direction, so one decoder reads either.

    Args:
        direction: whose side is read; kept for callers that need it.
    """

    def __init__(self, *, direction: Direction = "to_host") -> None:
        self.direction = direction
        super().__init__(StreamParser(scan, find, STARTS))
        self._room = ScanCapacity()
        self._forms: dict[int, messages.PayloadLayout] = {}
        self._memory = np.array(store_offset(), np.int64)
        self._wholes = empty_state()
        self._firmware = np.full(FAMILIES, NO_FIRMWARE, np.int64)
        self._whole: dict[int, bytes] = {}  # the last whole value of each set

    def drain(self, *, stalled: bool = False) -> list[Event]:
        """Return every complete event by offset; a batch is placed at its first packet."""
        cut = self._stream.drain(stalled=stalled)
        events: list[Event] = [*cut.rejects, *cut.texts]
        n = cut.table.shape[1]
        if n:
            out = self._room.table(SORTED, n)[:, :n]
            sort(cut.array, cut.table, RULES, VERSION_NUMBERS, self._firmware, self._memory, self._wholes, out)
            if n == 1:
                self._single(cut, out, events)
            else:
                self._many(cut, out, events)
        return sorted(events, key=stream_order) if len(events) > 1 else events

    def _single(self, cut: ParseResult, out: Ints, events: list[Event]) -> None:
        """One packet: same as `_many`, with plain numbers instead of arrays."""
        key, part, _, timed, step, _ = out[:, 0].tolist()
        if step != NO_STEP:
            self._steps(cut, out, events)
        if key < 0:
            self._replies(cut, np.zeros(1, np.int64), out[KEY], events)
        elif part >= 0:
            self._batches(cut, out, np.zeros(1, np.int64), events)
        else:
            form = self._forms.get(key) or self._form(key)
            begin = cut.table.item(BODY)
            width = form.layout.size
            payload = cut.data[begin : begin + width]
            if not key >> 27 & 0x7FF:
                self._whole[form.message.id] = payload
            columns = form.layout.columns(np.ndarray((1, width), UINT8, payload))
            offset = one_number(cut.start + cut.table.item(OFFSET))
            size, time = cut.table.item(SIZE), out[TIME] if timed else None
            events.append(Batch(form.message, "", cut.arrival_ns, offset, time, columns, size=size))

    def _many(self, cut: ParseResult, out: Ints, events: list[Event]) -> None:
        n = out.shape[1]
        order = np.empty(n, np.int64)
        bounds = np.empty(n + 1, np.int64)
        groups = group(out[KEY], order, bounds)
        streamed = int(bounds[groups])
        if streamed < n:
            self._replies(cut, np.flatnonzero(out[KEY] < 0), out[KEY], events)
        if out[STEP].any():
            self._steps(cut, out, events)
        for g in range(groups):
            self._batches(cut, out, order[bounds[g] : bounds[g + 1]], events)

    # -- data ----------------------------------------------------------------------------------------------------------

    def _batches(self, cut: ParseResult, out: Ints, which: Ints, events: list[Event]) -> None:
        """One batch for the packets of one key; two if only some have a device time."""
        first = int(which[0])
        key, size = int(out[KEY, first]), int(cut.table[SIZE, first])
        form = self._forms.get(key) or self._form(key)
        did = form.message.id
        whole = np.frombuffer(self._whole[did], np.uint8) if out[PART, first] >= 0 else _NOTHING
        rows = np.empty((len(which), form.layout.size), np.uint8)
        about = np.empty((ABOUT, len(which)), np.int64)
        timed = gather(cut.array, cut.table, out, cut.arrival_ns, which, whole, rows, about)
        if not key >> 27 & 0x7FF and int(self._wholes[did, WHOLE_KEY]) == key:
            self._whole[did] = rows[-1].tobytes()
        offsets, arrivals, times = about
        offsets += cut.start
        if timed in (0, len(which)):
            columns = form.layout.columns(rows)
            events.append(Batch(form.message, "", arrivals, offsets, times if timed else None, columns, size=size))
            return
        has_time = out[TIMED][which] > 0
        for part, time in ((has_time, times[has_time]), (~has_time, None)):
            columns = form.layout.columns(rows[part])
            events.append(Batch(form.message, "", arrivals[part], offsets[part], time, columns, size=size))

    def _form(self, key: int) -> messages.PayloadLayout:
        if len(self._forms) >= _MAX_FORMS:
            self._forms.clear()
        form = self._forms[key] = messages.form_for_key(key)
        return form

    @staticmethod
    def _steps(cut: ParseResult, out: Ints, events: list[Event]) -> None:
        for i in np.flatnonzero(out[STEP] != NO_STEP).tolist():
            offset, arrival = cut.start + int(cut.table[OFFSET, i]), int(cut.arrival_ns[i])
            events.append(ClockStep(offset, STEPS[int(out[STEP, i])], int(out[BY, i]), arrival))

    # -- replies -------------------------------------------------------------------------------------------------------

    def _replies(self, cut: ParseResult, which: Any, keys: Ints, events: list[Event]) -> None:
        arrivals, row_keys = cut.arrival_ns[which].tolist(), keys[which].tolist()
        for i, (offset, size, body, length, did, flags) in enumerate(cut.table[:6, which].T.tolist()):
            kind = flags & TYPE_MASK
            payload = cut.data[body : body + length]
            part = int.from_bytes(cut.data[body - 2 : body], "little") if flags & WITH_OFFSET and kind in (4, 5) else 0
            message = self._row(kind, did)
            if kind == 4:
                part, payload = self._merged(did, part, payload)
            version_index = -1 - row_keys[i]
            version = None if version_index == NO_FIRMWARE else VERSIONS[version_index]
            values = LazyMapping(values_of, kind, did, payload, part, version)
            events.append(Reply(message, values, cut.start + offset, size, arrivals[i]))

    @staticmethod
    def _row(kind: int, did: int) -> Message:
        if kind in messages.COMMANDS:
            return messages.COMMANDS[kind]
        return messages.set_row(did) if kind == SET_DATA else messages.ROWS[did]

    def _merged(self, did: int, part: int, payload: bytes) -> tuple[int, bytes]:
        """A value, or the last whole one with a part of it written over."""
        whole = self._whole.get(did)
        if part and (whole is None or part + len(payload) > len(whole)):
            return part, payload
        if part and whole is not None:
            payload = whole[:part] + payload + whole[part + len(payload) :]
        self._whole[did] = payload
        return 0, payload
