"""At what moment did each byte of a capture arrive, when the capture holds nothing but the bytes?

The device's own clock is in the frames. So the capture is decoded, block by block, and every stretch of bytes up to and
including a frame with a clock is due when that clock stands at that frame's time:

    bytes   ....[frame t0][frame, no clock][frame t1] .. [frame t2]
    pieces  └── at 0 ────┘└──── at t1 − t0 ────────┘└─ at t2 − t0 ─┘

    (a frame is told from its neighbours by where the next one with a clock begins, so what stands between two clocked
    frames leaves with the earlier one)

The busiest kind of frame leads: a GNSS solution may carry a time that is seconds older than the samples around it, and
two clocks in one stream (a receiver's and a sensor's) need not agree. A clock that starts anew is followed from there;
one that jumps ahead by more than `LONGEST_PAUSE_NS` (the device was off) is not waited for. Where `BLIND_BYTES` in a
row hold no clock at all, they are played at `BLIND_RATE`, and it is said so.

Pure: no thread, no clock, no sleep. Memory is bounded by one block and one undecided stretch.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from protocols.events import Batch, Decoder, Event
from protocols.framing import Ints

BLOCK_BYTES = 1 << 16
BLIND_BYTES = 1 << 16
BLIND_RATE = 11_520  # bytes/s: a full line at 115 200 Bd, 8N1
LONGEST_PAUSE_NS = 5_000_000_000

Kind = tuple[str, ...]  # the message's name and those of its fields


@dataclass(frozen=True, slots=True)
class Piece:
    """Bytes that arrived together, `due_ns` after the start of the capture. `blind`: no clock said so."""

    data: bytes
    due_ns: int
    blind: bool = False


@dataclass(frozen=True, slots=True)
class Pieces:
    """Many pieces at once: (n,) where each ends in `data`, and when it is due."""

    data: bytes
    ends: Ints
    due_ns: Ints
    blind: bool = False

    def __iter__(self) -> Iterator[Piece]:
        start = 0
        for end, due in zip(self.ends.tolist(), self.due_ns.tolist(), strict=True):
            yield Piece(self.data[start:end], due, self.blind)
            start = end


class Pace:
    """Cuts a capture into pieces with their time.

    Args:
        decoder: a fresh decoder of the capture's protocol; None when it is not known: then all is played blind.
    Attributes:
        skipped_ns: sum of the pauses that were not waited for.
    """

    def __init__(self, file: BinaryIO, decoder: Decoder | None) -> None:
        self._file = file
        self._decoder = decoder
        self._base = 0  # offset in the file of the first byte held back
        self._held = bytearray()
        self._frames: Counter[Kind] = Counter()  # how many clocked frames of each kind there were so far
        self._leader: Kind = ()  # the kind whose clock sets the pace
        self._clock_ns: int | None = None  # device time of its last frame
        self._due_ns = 0
        self.skipped_ns = 0

    def __iter__(self) -> Iterator[Piece]:
        for pieces in self.blocks():
            yield from pieces

    def blocks(self) -> Iterator[Pieces]:
        """All pieces, many at once."""
        while block := self._file.read(BLOCK_BYTES):
            self._held += block
            if self._decoder is None:
                yield self._blind(len(self._held))
                continue
            self._decoder.feed(block, 0)
            yield from self._clocked(self._decoder.drain())
            if len(self._held) > BLIND_BYTES + self._decoder.buffered:
                yield self._blind(len(self._held) - self._decoder.buffered)
        if self._decoder is not None:
            yield from self._clocked(self._decoder.drain(stalled=True))
        if self._held and self._clock_ns is None:
            yield self._blind(len(self._held))
        elif self._held:
            yield self._take(np.array([len(self._held)]), np.array([self._due_ns]))

    def _clocked(self, events: list[Event]) -> Iterator[Pieces]:
        """Pieces up to the last frame with a clock among `events`; that one waits for the start of the next."""
        clocked = [event for event in events if isinstance(event, Batch) and event.time_ns is not None and len(event)]
        for batch in clocked:
            self._frames[_kind(batch)] += len(batch)
        if not self._frames:
            return
        leader = self._frames.most_common(1)[0][0]
        if leader != self._leader:
            self._leader, self._clock_ns = leader, None
        starts, times = _in_order([batch for batch in clocked if _kind(batch) == leader])
        if not len(starts):
            return
        unknown = self._clock_ns is None  # then the first frame sets the clock and ends nothing
        steps = np.diff(times, prepend=times[0] if self._clock_ns is None else self._clock_ns)
        self.skipped_ns += int(steps[steps > LONGEST_PAUSE_NS].sum())
        due = self._due_ns + np.cumsum(np.where((steps > 0) & (steps <= LONGEST_PAUSE_NS), steps, 0))
        before = np.concatenate(([self._due_ns], due[:-1]))
        ends = starts - self._base
        ended = ends > 0
        ended[0] &= not unknown
        self._clock_ns, self._due_ns = int(times[-1]), int(due[-1])
        if ended.any():
            yield self._take(ends[ended], before[ended])

    def _take(self, ends: Ints, due_ns: Ints, *, blind: bool = False) -> Pieces:
        size = int(ends[-1])
        data = bytes(self._held[:size])
        del self._held[:size]
        self._base += size
        return Pieces(data, ends, due_ns, blind)

    def _blind(self, size: int) -> Pieces:
        """The first `size` held bytes at a constant rate, in pieces of 10 ms."""
        ends = np.append(np.arange(BLIND_RATE // 100, size, BLIND_RATE // 100), size)
        due = self._due_ns + np.round(ends * (1e9 / BLIND_RATE)).astype(np.int64)
        self._due_ns = int(due[-1])
        return self._take(ends, due, blind=True)


def _kind(batch: Batch) -> Kind:
    """Message and layout: the items of MTData2 differ from frame to frame."""
    return batch.message.name, *(field.name for field in batch.message.fields)


def _in_order(batches: list[Batch]) -> tuple[Ints, Ints]:
    """Where each frame begins and what its clock says, in stream order."""
    starts = [batch.offset for batch in batches]
    times = [batch.time_ns for batch in batches if batch.time_ns is not None]
    if not starts:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    order = np.argsort(np.concatenate(starts), kind="stable")
    return np.concatenate(starts)[order], np.concatenate(times)[order]


def play(
    pieces: Iterator[Piece], now_ns: Callable[[], int], wait: Callable[[float], bool], speed: float = 1.0
) -> Iterator[Piece]:
    """The pieces, each when it is due.

    Args:
        now_ns: a clock that does not step.
        wait: sleeps for so many seconds; True means stop.
        speed: 2 plays twice as fast.
    """
    start_ns = now_ns()
    for piece in pieces:
        late_ns = now_ns() - start_ns - piece.due_ns / speed
        if late_ns < 0 and wait(-late_ns / 1e9):
            return
        yield piece
