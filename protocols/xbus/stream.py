"""What does an MTi's port carry, piece by piece? Frames, sentences between them, and what was neither.

    bytes   [frame][frame]$GPGGA,…*hh\\r\\n[frame]··noise··[frame][fra
    Cut     table of the frames · Text for the sentence · Reject for each candidate that failed
    kept                                                         ^^^^ until the rest comes

Both the decoder (columns) and the inspector (one line a frame) stand on this.

Sentences and binary strings are looked for only where no frame was found, each kind from where it last stopped: a
sentence that is cut by the end of the data waits for its rest, and so does not hold up the frames after it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from protocols.events import Reject, Text
from protocols.framing import FRAME, OFFSET, REASONS, SIZE, STATUS, Buffer, Bytes, Ints, Room, scan_all
from protocols.nmea import Found
from protocols.nmea import find as find_sentences
from protocols.xbus.frames import scan
from protocols.xbus.strings import find as find_strings


@dataclass(slots=True)
class Cut:
    """What one drain found.

    Args:
        data: the bytes that `table` indexes; `array` is the same as uint8.
        start: position of `data[0]` in the stream.
        table: (QUANTITIES, n) of the accepted frames, see protocols/framing.py.
        arrival_ns: (n,) when each frame was complete.
        rejects, texts: in order of their offsets, within each kind.
    """

    data: bytes
    array: Bytes
    start: int
    table: Ints
    arrival_ns: Ints
    rejects: list[Reject]
    texts: list[Text]


class Stream:
    """Cuts a stream of bytes, given in chunks, into frames, texts and rejects."""

    def __init__(self) -> None:
        self._buffer = Buffer()
        self._room = Room()
        self._scan_at = 0  # positions in the stream: from where to look for frames …
        self._nmea_at = 0  # … for sentences …
        self._strings_at = 0  # … and for binary strings
        self._em1000_end: int | None = None
        self._known = 0  # bytes of accepted frames and of texts

    def feed(self, data: bytes, arrival_ns: int) -> None:
        """Append a chunk."""
        self._buffer.append(data, arrival_ns)

    @property
    def buffered(self) -> int:
        """Bytes that are not decided yet."""
        return len(self._buffer)

    @property
    def skipped(self) -> int:
        """Bytes so far that belong to no frame and no text."""
        return self._buffer.start - self._known

    def drain(self, *, stalled: bool = False) -> Cut:
        """Everything that is complete; see events.Decoder.drain."""
        buffer = self._buffer
        data = buffer.data()
        start = buffer.start
        array = np.frombuffer(data, np.uint8)
        scanned = scan_all(scan, array, self._scan_at - start, final=stalled, room=self._room)
        table = scanned.table
        rejects: list[Reject] = []
        if scanned.failed:
            rejects = self._rejects(table, start)
            table = np.ascontiguousarray(table[:, table[STATUS] == FRAME])
        arrivals = buffer.arrivals(table[OFFSET] + (table[SIZE] + (start - 1)))
        self._scan_at = start + scanned.at
        self._known += scanned.framed
        texts: list[Text] = []
        if scanned.framed != self._scan_at - min(self._nmea_at, self._strings_at):
            texts = self._texts(data, start, table, rejects, stalled)
        else:
            self._nmea_at = self._strings_at = self._scan_at
        buffer.release(min(self._scan_at, self._nmea_at, self._strings_at))
        return Cut(data, array, start, table, arrivals, rejects, texts)

    def _rejects(self, table: Ints, start: int) -> list[Reject]:
        """The failed candidates of a scan. One that is cut short has the size that is there."""
        failed = table[:, table[STATUS] != FRAME]
        end = start + len(self._buffer)
        rejects = []
        for offset, size, status in zip(*(failed[row].tolist() for row in (OFFSET, SIZE, STATUS)), strict=True):
            at = start + offset
            last = min(at + max(size, 1), end)
            rejects.append(Reject(at, last - at, REASONS[status], self._buffer.arrival(last - 1)))
        return rejects

    def _texts(self, data: bytes, start: int, table: Ints, rejects: list[Reject], stalled: bool) -> list[Text]:
        """Look through the stretches between the frames."""
        texts: list[Text] = []
        begins = np.concatenate(([0], table[OFFSET] + table[SIZE] + start))
        stops = np.concatenate((table[OFFSET] + start, [self._scan_at]))
        for i in np.flatnonzero(begins < stops).tolist():
            final = stalled or i < table.shape[1]
            self._stretch(data, start, int(begins[i]), int(stops[i]), final, texts, rejects)
        self._nmea_at, self._strings_at = max(self._nmea_at, int(begins[-1])), max(self._strings_at, int(begins[-1]))
        texts.sort(key=lambda text: text.offset)
        rejects.sort(key=lambda reject: reject.offset)
        return texts

    def _stretch(
        self, data: bytes, start: int, begin: int, stop: int, final: bool, texts: list[Text], rejects: list[Reject]
    ) -> None:
        self._nmea_at = at = max(begin, self._nmea_at)
        if at < stop:
            found, kept = find_sentences(data[at - start : stop - start], final=final)
            self._report(found, at, texts, rejects)
            self._nmea_at = at + kept
        self._strings_at = at = max(begin, self._strings_at)
        if at < stop:
            since = None if self._em1000_end is None else at - self._em1000_end
            found, kept = find_strings(data[at - start : stop - start], final=final, since=since)
            self._report(found, at, texts, rejects)
            self._strings_at = at + kept

    def _report(self, found: list[Found], at: int, texts: list[Text], rejects: list[Reject]) -> None:
        for one in found:
            offset = at + one.offset
            arrival = self._buffer.arrival(offset + one.size - 1)
            if not one.name:
                rejects.append(Reject(offset, one.size, "bad_checksum", arrival))
                continue
            texts.append(Text(one.protocol, one.name, one.line, offset, one.size, arrival, one.fields))
            self._known += one.size
            if one.name == "EM1000":
                self._em1000_end = offset + one.size
