"""MIP decoder: bytes in, events out; with the listing and the detection score.

Packets with the same fields in the same order are one batch. The time of a packet is its GPS timestamp, where it has
one; there is no counter, so nothing can be said of what was lost.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from imuscope.plugin import (
    ID,
    OFFSET,
    SIZE,
    STARTS,
    Batch,
    Direction,
    Event,
    Layout,
    Message,
    ParseResult,
    Reply,
    StreamDecoder,
    StreamParser,
    find,
    size_of,
    unpack,
)
from imuscope_mip.json_codec import frame_to_json, name_of, plain, rows_of
from imuscope_mip.messages import DATA, Row
from imuscope_mip.options import ARRIVAL
from imuscope_mip.packets import HEADER, parts_of, scan

NS = 1_000_000_000
WEEK_S = 604_800


class _Shape:
    """Packets of one sequence of fields."""

    def __init__(self, packet: bytes) -> None:
        rows = rows_of(packet)
        places, at = [], HEADER
        visited: set[str] = set()
        for row in rows:
            inside = at + 2 + len(row.prefix)
            for field in row.fields:
                size = size_of(field)
                if field.name not in visited:
                    places.append((field, ((inside, size),)))
                visited.add(field.name)
                inside += size
            at += 2 + row.size
        fields = tuple(field for field, _ in places)
        self.message = Message(packet[2], DATA.get(packet[2], name_of(rows)), fields, channel_per_field=True)
        self.layout = Layout(places, len(packet))
        self.timed = any(row.time for row in rows)


def _reply_message(number: int, rows: list[Row]) -> Message:
    fields = tuple(field for row in rows for field in row.fields)
    return Message(number, name_of(rows), fields, kind="reply")


class MipDecoder(StreamDecoder[StreamParser]):
    """See events.Decoder.

    Args:
        direction: kept for those who ask; packets are told apart by their numbers.
        timestamps: "arrival" leaves the time of samples to their arrival (options.py).
    """

    def __init__(self, *, direction: Direction = "to_host", timestamps: str = "device") -> None:
        self.direction = direction
        self._timed = timestamps != ARRIVAL
        super().__init__(StreamParser(scan, find, STARTS))
        self._shapes: dict[bytes, _Shape] = {}

    def drain(self, *, stalled: bool = False) -> list[Event]:
        """Everything complete, by offset; a batch stands where its first packet began."""
        cut = self._stream.drain(stalled=stalled)
        events: list[Event] = [*cut.rejects, *cut.texts]
        groups: dict[bytes, list[int]] = {}
        columns = zip(*(cut.table[row].tolist() for row in (OFFSET, SIZE, ID)), strict=True)
        for place, (offset, size, number) in enumerate(columns):
            packet = cut.data[offset : offset + size]
            if number in DATA:
                key = bytes((number, *(one for part, data in parts_of(packet) for one in (part, len(data)))))
                groups.setdefault(key, []).append(place)
            else:
                events.append(_reply(packet, cut, place))
        for key, places in groups.items():
            events.append(self._batch(key, np.array(places), cut))
        return sorted(events, key=_offset)

    def _batch(self, key: bytes, places: Any, cut: ParseResult) -> Batch:
        offsets = cut.table[OFFSET, places]
        size = int(cut.table[SIZE, places[0]])
        shape = self._shapes.get(key)
        if shape is None:
            if len(self._shapes) > 1024:
                self._shapes.clear()
            begin = int(offsets[0])
            shape = self._shapes[key] = _Shape(cut.data[begin : begin + size])
        rows = np.ascontiguousarray(cut.array[offsets[:, None] + np.arange(size)])
        columns = shape.layout.columns(rows)
        time_ns = None
        if shape.timed and self._timed:
            with np.errstate(invalid="ignore"):
                tow = np.nan_to_num(np.clip(columns["tow"], 0, WEEK_S), nan=0.0)
            time_ns = (columns["week"].astype(np.int64) * WEEK_S * NS) + np.rint(tow * NS).astype(np.int64)
        arrivals = np.asarray(cut.arrival_ns)[places]
        return Batch(shape.message, "", arrivals, offsets + cut.start, time_ns, columns, size=size)


def _reply(packet: bytes, cut: ParseResult, place: int) -> Reply:
    rows, values = rows_of(packet), {}
    for row, (_, data) in zip(rows, parts_of(packet), strict=True):
        values.update(unpack(row.fields, data, len(row.prefix)))
    offset = int(cut.table[OFFSET, place]) + cut.start
    message = _reply_message(packet[2], rows)
    return Reply(message, plain(values), offset, len(packet), int(cut.arrival_ns[place]))


def _offset(event: Event) -> int:
    if isinstance(event, Batch):
        return int(event.offset[0])
    return event.offset


class MipLister:
    """Chunks in, lines out; see imuscope.protocols.family.info.FrameLister.

    Args:
        timestamps: an option of the decoder; a listing shows what was sent.
    """

    def __init__(self, *, timestamps: str = "device") -> None:
        self._stream = StreamParser(scan, find, STARTS)

    def feed(self, data: bytes) -> None:
        """Append a chunk."""
        self._stream.feed(data, 0)

    def drain(self, *, stalled: bool = False) -> list[dict[str, Any]]:
        """Lines of everything complete."""
        cut = self._stream.drain(stalled=stalled)
        lines: list[dict[str, Any]] = [
            {
                "offset": cut.start + offset,
                "size": size,
                "protocol": "mip",
                **frame_to_json(cut.data[offset : offset + size]),
            }
            for offset, size in zip(cut.table[OFFSET].tolist(), cut.table[SIZE].tolist(), strict=True)
        ]
        lines += [{"offset": one.offset, "size": one.size, "reject": one.reason} for one in cut.rejects]
        for text in cut.texts:
            lines.append(
                {
                    "offset": text.offset,
                    "size": text.size,
                    "protocol": text.protocol,
                    "id": None,
                    "message": text.name,
                    "fields": dict(text.fields),
                    "wire": {"line": text.line},
                }
            )
        return sorted(lines, key=lambda line: int(line["offset"]))


def detection_score(data: bytes) -> tuple[float, str]:
    """(score 0..1, words) of some bytes."""
    stream = StreamParser(scan, find, STARTS)
    stream.feed(data, 0)
    cut = stream.drain()
    framed = int(cut.table[SIZE].sum())
    if not framed:
        return 0.0, "no packet in them"
    waiting = stream.buffered
    count = cut.table.shape[1]
    names = Counter(DATA.get(number, f"set 0x{number:02X}") for number in cut.table[ID].tolist())
    kinds = ", ".join(name for name, _ in names.most_common(3))
    score = min(1.0, framed / max(len(data) - waiting, framed))
    return score, f"{count} MIP packet{'s' * (count > 1)} ({kinds}) in {framed} of {len(data)} B"
