"""Parser of a stream, chunk by chunk. Yields frames of its protocol, messages of other protocols, and noise.

    bytes   [frame][frame]$GPGGA,…*hh\\r\\n[frame]··noise··[frame][fra
    ParseResult   table of the frames · Text for the sentence · Reject for each candidate that failed
    kept                                                         ^^^^ until the rest arrives

Both a decoder (columns) and a listing (one line a frame) build on this. Other messages are searched for only outside
frames; one that is cut by the end of the data waits for its rest without delaying the frames after it.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Generic, Protocol, TypeVar

import numpy as np

from imuscope.protocols.arrays import UINT8, Bytes, Ints
from imuscope.protocols.events import Decoder, ParsedMessage, RejectedFrame, Text
from imuscope.protocols.framing.stream_buffer import (
    OFFSET,
    REASONS,
    SIZE,
    STATUS,
    TINY_BYTES,
    Scan,
    ScanCapacity,
    StreamBuffer,
    compact_rejected,
    one_number,
    scan_all,
)

Find = Callable[..., tuple[list[ParsedMessage], int]]
"""find(data, final=…) -> (messages found, where bytes must be kept from); see protocols/embedded/finders.py."""


@dataclass(slots=True)
class ParseResult:
    """Result of one drain; `table` is valid until the next one.

    Args:
        data: the bytes that `table` indexes; `array` is the same as uint8.
        start: position of `data[0]` in the stream.
        table: (QUANTITIES, n) of the accepted frames, see protocols/framing/stream_buffer.py.
        arrival_ns: (n,) arrival of each frame's last byte.
        rejects, texts: in order of their offsets, within each kind.
    """

    data: bytes
    array: Bytes
    start: int
    table: Ints
    arrival_ns: Ints
    rejects: list[RejectedFrame]
    texts: list[Text]


_NEVER = re.compile(rb"(?!)")


def _nothing(data: bytes, *, final: bool) -> tuple[list[ParsedMessage], int]:
    return [], len(data)


class StreamParser:
    """Cuts a stream of bytes, given in chunks, into frames, texts and rejects.

    Args:
        scan: finds frames.
        find: finds other messages between them; without it there are none.
        starts: how each of these messages begins; a final stretch without a match need not be searched.
        result: makes the result, for a protocol that adds to it.
    """

    def __init__(
        self,
        scan: Scan,
        find: Find = _nothing,
        starts: re.Pattern[bytes] = _NEVER,
        result: type[ParseResult] = ParseResult,
    ) -> None:
        self._result = result
        self._scan = scan
        self._find = find
        self._starts = starts
        self._buffer = StreamBuffer()
        self._room = ScanCapacity()
        self._scan_at = 0  # positions in the stream: from where to look for frames …
        self._find_at = 0  # … and for other messages
        self._known = 0  # bytes of accepted frames and of texts

    def feed(self, data: bytes, arrival_ns: int) -> None:
        self._buffer.append(data, arrival_ns)

    def feed_chunks(self, data: bytes, ends: Ints, arrival_ns: Ints) -> None:
        """Append many chunks; see events.Decoder."""
        self._buffer.extend(data, ends, arrival_ns)

    @property
    def buffered(self) -> int:
        """Bytes that are not decided yet."""
        return len(self._buffer)

    @property
    def skipped(self) -> int:
        """Bytes so far that belong to no frame and no text."""
        return self._buffer.start - self._known

    def drain(self, *, stalled: bool = False) -> ParseResult:
        """Return everything complete; see events.Decoder.drain."""
        data = self._buffer.data()
        array = np.frombuffer(data, UINT8)
        at = self._scan_at - self._buffer.start
        if len(data) - at < TINY_BYTES:  # the usual case of a live stream: a frame or two
            frames, at, failed, framed = self._scan(array, at, stalled, self._room.tiny)
            return self._cut(data, array, self._room.tiny[:, :frames], at, failed, framed, stalled)
        scanned = scan_all(self._scan, array, at, final=stalled, room=self._room)
        return self._cut(data, array, scanned.table, scanned.at, scanned.failed, scanned.framed, stalled)

    def drain_full(self, chunks: Sequence[tuple[bytes, int]]) -> ParseResult | None:
        """Return everything in chunks that are each full: consecutive frames, the last of which ends with the chunk.

        Searching them together then gives the same result as searching each, and costs less.

        Args:
            chunks: each with its arrival, ns. Nothing else is undecided.

        Returns:
            None if one of them is not full; then none is consumed.
        """
        data = b"".join(chunk for chunk, _ in chunks)
        array = np.frombuffer(data, np.uint8)
        ends = list(accumulate(len(chunk) for chunk, _ in chunks))
        scanned = scan_all(self._scan, array, 0, final=True, room=self._room)
        table = scanned.table
        if (
            scanned.failed
            or scanned.framed != len(data)
            or not set(ends) <= set((table[OFFSET] + table[SIZE]).tolist())
        ):
            return None
        self.feed_chunks(data, np.array(ends, np.int64), np.array([arrival_ns for _, arrival_ns in chunks], np.int64))
        return self._cut(data, array, table, scanned.at, scanned.failed, scanned.framed, True)

    def _cut(
        self, data: bytes, array: Bytes, table: Ints, at: int, failed: int, framed: int, stalled: bool
    ) -> ParseResult:
        """Decide the scanned frames; `data` is the whole buffer, the others are those of a ScanResult."""
        buffer = self._buffer
        start = buffer.start
        rejects: list[RejectedFrame] = []
        if failed:
            rejects = self._rejects(table, start)
            table = table[:, : compact_rejected(table)]
        if buffer.arrived_at_once:  # the usual case of a live stream
            arrivals = buffer.same_arrivals(table.shape[1])
        elif table.shape[1] == 1:
            arrivals = one_number(buffer.arrival(start + table.item(OFFSET) + table.item(SIZE) - 1))
        else:
            arrivals = buffer.arrivals(table[OFFSET] + (table[SIZE] + (start - 1)))
        self._scan_at = start + at
        self._known += framed
        texts: list[Text] = []
        if framed != self._scan_at - self._find_at:
            self._spans(data, start, table, texts, rejects, stalled)
            rejects.sort(key=lambda reject: reject.offset)
        else:
            self._find_at = self._scan_at
        buffer.release(min(self._scan_at, self._find_at))
        return self._result(data, array, start, table, arrivals, rejects, texts)

    def _rejects(self, table: Ints, start: int) -> list[RejectedFrame]:
        """The failed candidates of a scan. The size of a truncated one is that of its available bytes."""
        failed = table[:, np.flatnonzero(table[STATUS])]
        end = start + len(self._buffer)
        rejects = []
        for offset, size, status in zip(*(failed[row].tolist() for row in (OFFSET, SIZE, STATUS)), strict=True):
            at = start + offset
            last = min(at + max(size, 1), end)
            rejects.append(RejectedFrame(at, last - at, REASONS[status], self._buffer.arrival(last - 1)))
        return rejects

    def _spans(
        self, data: bytes, start: int, table: Ints, texts: list[Text], rejects: list[RejectedFrame], stalled: bool
    ) -> None:
        """Search the stretches between the frames."""
        begins = np.concatenate(([self._find_at], table[OFFSET] + table[SIZE] + start))
        stops = np.concatenate((table[OFFSET] + start, [self._scan_at]))
        which = np.flatnonzero(begins < stops)
        for i, at, stop in zip(which.tolist(), begins[which].tolist(), stops[which].tolist(), strict=True):
            final = stalled or i < table.shape[1]
            if final and not self._starts.search(data, at - start, stop - start):
                self._find_at = stop
                continue
            messages, end = self._find(data[at - start : stop - start], final=final)
            for one in messages:
                self._report(one, at + one.offset, texts, rejects)
            self._find_at = at + end
        self._find_at = max(self._find_at, int(begins[-1]))

    def _report(self, one: ParsedMessage, offset: int, texts: list[Text], rejects: list[RejectedFrame]) -> None:
        arrival = self._buffer.arrival(offset + one.size - 1)
        if not one.name:
            rejects.append(RejectedFrame(offset, one.size, "bad_checksum", arrival))
            return
        texts.append(Text(one.protocol, one.name, one.line, offset, one.size, arrival, one.fields))
        self._known += one.size


class FrameParser(Protocol):
    """Parser of one protocol's frames, driven by StreamParser."""

    def feed(self, data: bytes, arrival_ns: int) -> None: ...
    def feed_chunks(self, data: bytes, ends: Ints, arrival_ns: Ints) -> None: ...
    @property
    def buffered(self) -> int: ...
    @property
    def skipped(self) -> int: ...


S = TypeVar("S", bound=FrameParser)


class StreamDecoder(Decoder, Generic[S]):
    """The input side of a decoder; `drain` is each protocol's own.

    Args:
        stream: cuts the bytes into frames.
    """

    def __init__(self, stream: S) -> None:
        self._stream = stream

    @property
    def buffered(self) -> int:
        return self._stream.buffered

    @property
    def skipped(self) -> int:
        return self._stream.skipped

    def feed(self, data: bytes, arrival_ns: int) -> None:
        self._stream.feed(data, arrival_ns)

    def feed_chunks(self, data: bytes, ends: Ints, arrival_ns: Ints) -> None:
        self._stream.feed_chunks(data, ends, arrival_ns)
