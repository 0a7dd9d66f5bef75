"""Arrival times reconstructed for captures that hold only bytes.

The frames contain the device's own clock. So the capture is decoded, block by block, and every run of bytes up to and
including a frame with a clock is due at that frame's time:

    bytes   ....[frame t0][frame, no clock][frame t1] .. [frame t2]
    pieces  └── at 0 ────┘└──── at t1 − t0 ────────┘└─ at t2 − t0 ─┘

    (a frame ends where the next one with a clock begins, so the bytes between two clocked frames belong to the earlier
    one)

For each device the busiest kind of frame is followed: a GNSS solution may carry a time older than the samples around
it. With several devices in one capture each has a clock of its own, which starts at the position of its first frame
among those of the others; from then on the newest of their times is due.

A clock that continues after a pause gives its length, and the capture lasts as long as the device's clock; a player
need not wait (`longest_ns`). A clock that restarts, is set, or receives the date is followed from there, one usual
interval later. `BLIND_BYTES` in a row without any clock are played at `BLIND_RATE`, and reported.

Pure: no thread, no clock, no sleep. Memory is bounded by one block and one undecided stretch.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.clocks.dates import UNKNOWN
from imuscope.protocols.embedded.gnss_time import GnssClock
from imuscope.protocols.events import Batch, ClockStep, Decoder, Event, Reply, Text

BLOCK_BYTES = 1 << 16
BLIND_BYTES = 1 << 16
BLIND_RATE = 11_520  # bytes/s: a full line at 115 200 Bd, 8N1
LONGEST_PAUSE_NS = 5_000_000_000  # the longest wait while a capture is played
LONGEST_LOG_NS = 30 * 86_400 * 1_000_000_000  # a clock that advanced by more was set, not paused
MAX_DATES = 2  # blocks: the first UTC after a fix may be off by one interval
BACK_NS = 500_000_000  # by less, messages of a receiver may be out of order
PAUSE_NS = 1_000_000_000  # a device whose clock advanced by more, while another's did not, was set

Kind = tuple[str, ...]  # the message's name and those of its fields
CaptureSender = tuple[str, bool]  # Batch.device and Batch.verified: the owner of a clock


GNSS: CaptureSender = ("", True)  # owner of the clock of a capture that has no other


@dataclass(frozen=True, slots=True)
class TimedBytes:
    """Bytes that arrived together, `due_ns` after the start of the capture. `blind`: without a clock."""

    data: bytes
    due_ns: int
    blind: bool = False


@dataclass(frozen=True, slots=True)
class TimedBytesBuffer:
    """Many pieces at once: (n,) end of each in `data`, and its due time."""

    data: bytes
    ends: Ints
    due_ns: Ints
    blind: bool = False

    def __iter__(self) -> Iterator[TimedBytes]:
        start = 0
        for end, due in zip(self.ends.tolist(), self.due_ns.tolist(), strict=True):
            yield TimedBytes(self.data[start:end], due, self.blind)
            start = end


@dataclass(slots=True)
class _Clock:
    """One device's clock.

    Args:
        shift_ns: added to its times to get the due times of its frames. None before its first frame.
        newest_ns: the newest time, shifted.
        usual_ns: interval of the followed kind of frames.
    """

    frames: Counter[Kind] = field(default_factory=Counter)
    shift_ns: int | None = None
    newest_ns: int = 0
    usual_ns: int = 0
    waiting: list[ClockStep] = field(default_factory=list)  # steps before a later frame

    def due(self, starts: Ints, times: Ints, steps: Sequence[ClockStep], longest_ns: int) -> tuple[Ints, int]:
        """Due times of the frames of a block by this clock alone, and the total of removed pauses, ns.

        Args:
            steps: of this clock in the block, from the decoder.
        """
        assert self.shift_ns is not None
        due = times + self.shift_ns
        intervals = np.diff(due)
        self.usual_ns = int(np.median(intervals[intervals > 0])) if (intervals > 0).any() else self.usual_ns
        wrong = np.flatnonzero((intervals[:-1] > PAUSE_NS) & (2 * intervals[1:] < -intervals[:-1])) + 1
        due[wrong] = due[wrong - 1] + self.usual_ns  # one wrong time, and the next is right again
        self._follow(starts, due, steps, {*wrong.tolist(), *(wrong + 1).tolist()})
        left_out = 0
        moved = np.diff(due, prepend=self.newest_ns)
        for at in np.flatnonzero(moved > min(longest_ns, LONGEST_LOG_NS)).tolist():
            left_out += int(moved[at]) - self.usual_ns
            due[at:] -= int(moved[at]) - self.usual_ns
        self.shift_ns = int(due[-1] - times[-1])
        self.newest_ns = max(self.newest_ns, int(due.max()))
        return due, left_out

    def _follow(self, starts: Ints, due: Ints, steps: Sequence[ClockStep], apart: Collection[int]) -> None:
        """Remove steps of the clock from `due`, except those at the rows `apart`."""
        waiting, self.waiting = [*self.waiting, *steps], []
        for step in waiting:
            at = int(np.searchsorted(starts, step.offset))
            if at == len(due):
                self.waiting.append(step)
            elif step.kind == "sync" and step.by_ns:
                due[at:] -= step.by_ns  # the same clock with another epoch
            elif at not in apart and (step.kind != "jump" or step.by_ns < 0):
                due[at:] += (int(due[at - 1]) if at else self.newest_ns) + self.usual_ns - int(due[at])

    def hold_back(self, newest_ns: int, starts: Ints, due: Ints, others_at: Ints, others: Ints) -> None:
        """Treat a clock that advanced by a pause, while later frames of other devices did not, as set: it is followed
        from there, a usual interval later.

        Args:
            newest_ns: before this block.
            starts, due: of its frames in this block; `due` is changed.
            others_at, others: of the frames of all other devices, in stream order.
        """
        moved = np.diff(due, prepend=newest_ns)
        for row in np.flatnonzero(moved > PAUSE_NS).tolist():
            after = int(np.searchsorted(others_at, starts[row]))
            if after < len(others) and due[row] > others[after] + PAUSE_NS and self.shift_ns is not None:
                by = int(moved[row]) - self.usual_ns
                due[row:] -= by
                self.shift_ns -= by
                self.newest_ns = max(newest_ns, int(due.max()))


class CaptureTiming:
    """Cuts a capture into timed pieces.

    Args:
        decoder: a new decoder of the capture's protocol; None if unknown: then all is played blind.
        longest_ns: longer pauses are left out.
        utc, dated: of the protocol (registry.ProtocolInfo).

    Attributes:
        skipped_ns: sum of the skipped pauses.
        blind: whether some of it had no clock.
        started_ns: start of the capture by the UTC in its samples, ns since the Unix epoch; None without.
        dated_ns: the same by the date at its head.
        by_gnss: whether its times are those in the messages of a GNSS receiver.
        gnss_steps: where these go back: due time after it, and by how much, ns.
        gnss_kind, gnss_within_ns: whether these count in a "day" or a "week", and the time in it at the start.
    """

    def __init__(
        self,
        file: BinaryIO,
        decoder: Decoder | None,
        longest_ns: int = LONGEST_LOG_NS,
        *,
        utc: Callable[[Batch], Ints | None] = lambda batch: None,
        dated: Callable[[Reply], int | None] = lambda reply: None,
    ) -> None:
        self._file = file
        self._decoder = decoder
        self._longest_ns = longest_ns
        self._base = 0  # offset in the file of the first byte held back
        self._held = bytearray()
        self._clocks: dict[CaptureSender, _Clock] = {}
        self._due_ns = 0
        self.skipped_ns = 0
        self.blind = False
        self.started_ns: int | None = None
        self.dated_ns: int | None = None
        self._utc = utc
        self._dated = dated
        self._dates = 0  # blocks used for the UTC
        self._gnss = GnssClock()
        self._gnss_last = 0
        self.by_gnss = False
        self.gnss_steps: list[tuple[int, int]] = []
        self.gnss_kind = ""
        self.gnss_within_ns = 0

    @property
    def is_dated(self) -> bool:
        """Whether reading on would not improve the start time of the capture."""
        return self._dates == MAX_DATES

    @property
    def lasted_ns(self) -> int:
        """Duration of the part read so far, ns."""
        return self._due_ns

    def __iter__(self) -> Iterator[TimedBytes]:
        for pieces in self.blocks():
            yield from pieces

    def blocks(self) -> Iterator[TimedBytesBuffer]:
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
        if self._held and not self._clocks:
            yield self._blind(len(self._held))
        elif self._held:
            yield self._take(np.array([len(self._held)]), np.array([self._due_ns]))

    def _clocked(self, events: list[Event]) -> Iterator[TimedBytesBuffer]:
        """Pieces up to the last frame with a clock among `events`; that one waits for the start of the next."""
        batches: dict[CaptureSender, list[Batch]] = {}
        for event in events:
            if isinstance(event, Reply) and self.dated_ns is None:
                self.dated_ns = self._dated(event)
            if isinstance(event, Batch) and event.time_ns is not None and len(event):
                batches.setdefault((event.device, event.verified), []).append(event)
        if not batches:
            yield from self._by_gnss([event for event in events if isinstance(event, Text)])
            return
        if self.by_gnss:  # the device has a clock of its own after all
            self._clocks.pop(GNSS)
            self.by_gnss = False
        unknown = not self._clocks  # then the first frame sets the clock and ends no piece
        steps = [event for event in events if isinstance(event, ClockStep)]
        starts, due = self._due(batches, steps)
        if self._dates < MAX_DATES:
            self._date(batches)
        if not len(starts):
            return
        yield from self._pieces(starts, due, unknown=unknown)

    def _by_gnss(self, texts: list[Text]) -> Iterator[TimedBytesBuffer]:
        """Pieces of a capture without a device clock, by the times in the messages of a GNSS receiver."""
        if self._clocks and not self.by_gnss:
            return
        times = self._gnss.times(texts)
        if not len(times.offset):
            return
        unknown = not self._clocks
        clock = self._clocks.setdefault(GNSS, _Clock())
        self.by_gnss = True
        if clock.shift_ns is None:
            clock.newest_ns, clock.shift_ns = self._due_ns, self._due_ns - int(times.time_ns[0])
            self.gnss_kind, self.gnss_within_ns = times.kind, -clock.shift_ns
        moved = np.diff(times.time_ns, prepend=self._gnss_last)
        back = np.flatnonzero(moved < -BACK_NS).tolist() if not unknown else np.flatnonzero(moved[1:] < -BACK_NS) + 1
        steps = [ClockStep(int(times.offset[row]), "reset", int(moved[row]), 0) for row in back]
        self._gnss_last = int(times.time_ns[-1])
        due, left_out = clock.due(times.offset, times.time_ns, steps, self._longest_ns)
        self.gnss_steps += [(int(due[row]), int(moved[row])) for row in back]
        self.skipped_ns += left_out
        if times.is_dated and self.started_ns is None:
            row = int(back[0]) - 1 if len(back) and back[0] else -1  # before the receiver was set back
            self.started_ns = int(times.time_ns[row]) - int(due[row])
        due = np.maximum.accumulate(np.maximum(due, self._due_ns))
        yield from self._pieces(times.offset, due, unknown=unknown)

    def _pieces(self, starts: Ints, due: Ints, *, unknown: bool) -> Iterator[TimedBytesBuffer]:
        """The bytes up to the last of these frames, each due at its time.

        Args:
            unknown: no frame before had a clock, so the first one ends no piece.
        """
        before = np.concatenate(([self._due_ns], due[:-1]))
        ends = starts - self._base
        ended = ends > 0
        ended[0] &= not unknown
        self._due_ns = int(due[-1])
        if ended.any():
            yield self._take(ends[ended], before[ended])

    def _date(self, by_sender: dict[CaptureSender, list[Batch]]) -> None:
        """Start of the capture, from the newest UTC in a block."""
        for sender, batches in by_sender.items():
            shift = self._clocks[sender].shift_ns
            for batch in batches if shift is not None else ():
                utc = self._utc(batch)
                if utc is not None and utc[-1] != UNKNOWN and batch.time_ns is not None and shift is not None:
                    self.started_ns = int(utc[-1] - batch.time_ns[-1]) - shift
                    self._dates += 1
                    return

    def _due(self, by_sender: dict[CaptureSender, list[Batch]], steps: list[ClockStep]) -> tuple[Ints, Ints]:
        """Starts and due times of the followed frames, in stream order."""
        rows = {sender: self._followed(sender, batches) for sender, batches in by_sender.items()}
        rows = {sender: (starts, times) for sender, (starts, times) in rows.items() if len(starts)}
        own: dict[CaptureSender, tuple[Ints, Ints]] = {}
        newest = {sender: clock.newest_ns for sender, clock in self._clocks.items()}
        for sender, (starts, times) in sorted(rows.items(), key=lambda one: int(one[1][0][0])):
            clock = self._clocks[sender]
            if clock.shift_ns is None:  # starts at its position among the others
                past = [due[: np.searchsorted(at, starts[0])] for at, due in own.values()]
                clock.newest_ns = max([self._due_ns, *(int(due.max()) for due in past if len(due))])
                newest[sender], clock.shift_ns = clock.newest_ns, clock.newest_ns - int(times[0])
            own_steps = [step for step in steps if step.device == sender[0]]
            due, left_out = clock.due(starts, times, own_steps, self._longest_ns)
            self.skipped_ns += left_out
            own[sender] = starts, due
        for sender, (starts, due) in own.items():
            if len(own) > 1:
                others_at, others = _merged([one for other, one in own.items() if other != sender])
                self._clocks[sender].hold_back(newest[sender], starts, due, others_at, others)
        starts, due = _merged(list(own.values()))
        return starts, np.maximum.accumulate(np.maximum(due, self._due_ns))

    def _followed(self, sender: CaptureSender, batches: list[Batch]) -> tuple[Ints, Ints]:
        """Starts and clocks of the frames of a device's most frequent kind."""
        clock = self._clocks.setdefault(sender, _Clock())
        for batch in batches:
            clock.frames[_kind(batch)] += len(batch)
        leader = clock.frames.most_common(1)[0][0]
        return _in_order([batch for batch in batches if _kind(batch) == leader])

    def _take(self, ends: Ints, due_ns: Ints, *, blind: bool = False) -> TimedBytesBuffer:
        size = int(ends[-1])
        data = bytes(self._held[:size])
        del self._held[:size]
        self._base += size
        return TimedBytesBuffer(data, ends, due_ns, blind)

    def _blind(self, size: int) -> TimedBytesBuffer:
        """The first `size` held bytes at a constant rate, in pieces of 10 ms."""
        ends = np.append(np.arange(BLIND_RATE // 100, size, BLIND_RATE // 100), size)
        due = self._due_ns + np.round(ends * (1e9 / BLIND_RATE)).astype(np.int64)
        self._due_ns = int(due[-1])
        self.blind = True
        return self._take(ends, due, blind=True)


def _kind(batch: Batch) -> Kind:
    """Message and layout: the items of MTData2 differ from frame to frame."""
    return batch.message.name, *(field.name for field in batch.message.fields)


def _in_order(batches: list[Batch]) -> tuple[Ints, Ints]:
    """Start and clock of each frame, in stream order."""
    starts = [batch.offset for batch in batches]
    times = [batch.time_ns for batch in batches if batch.time_ns is not None]
    if not starts:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    order = np.argsort(np.concatenate(starts), kind="stable")
    return np.concatenate(starts)[order], np.concatenate(times)[order]


def _merged(parts: list[tuple[Ints, Ints]]) -> tuple[Ints, Ints]:
    """Starts and values of several devices in stream order."""
    if len(parts) == 1:
        return parts[0]
    starts = np.concatenate([np.empty(0, np.int64), *(starts for starts, _ in parts)])
    order = np.argsort(starts, kind="stable")
    return starts[order], np.concatenate([np.empty(0, np.int64), *(values for _, values in parts)])[order]


def play(
    pieces: Iterator[TimedBytes], now_ns: Callable[[], int], wait: Callable[[float], bool], speed: float = 1.0
) -> Iterator[TimedBytes]:
    """Yield the pieces, each when it is due.

    Args:
        now_ns: a clock that does not step.
        wait: sleeps for the given seconds; True means stop.
        speed: 2 plays twice as fast.
    """
    start_ns = now_ns()
    for piece in pieces:
        late_ns = now_ns() - start_ns - piece.due_ns / speed
        if late_ns < 0 and wait(-late_ns / 1e9):
            return
        yield piece
