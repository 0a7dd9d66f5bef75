"""Stamps of one topic as times of measurement.

    stamp near the arrival           the time itself
    stamp of another clock           its steps count, placed by the earliest arrival: uptime beside UTC
    stamp that goes back and stays   a step of the clock: the times go on as the arrivals do
    stamp that goes ahead and stays  the same, if it is not near the arrival after that
    stamp that goes back for a few   not used, until the stamps have passed where they were
    stamp that stands still          not used
    no stamp                         not used

A clock that is not that of the host needs `MIN_BLOCK_STAMPS` in a row before it is trusted; until then the arrival is
used. The stamp itself is a column then, so nothing is lost.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Ints

LATE_NS, AHEAD_NS = 60_000_000_000, 5_000_000_000  # an earlier or later stamp comes from another clock
BACK_NS = 1_000_000_000
STEP_BACK_NS = 50_000_000  # messages overtake each other by less
MIN_BLOCK_STAMPS, MIN_STAMPS = 20, 100  # stamps in a row in one block; in several
STILL_NS = 500_000_000  # messages that are sent at once may have one stamp


@dataclass(frozen=True, slots=True)
class StampStep:
    """A step of the clock of stamps: row after it, and how far it moved against the arrivals."""

    row: int
    by_ns: int


@dataclass(slots=True)
class StampTimes:
    """Times of n messages.

    Args:
        used: (n,) whether the stamp gives the time.
        time_ns: (n,) where it does.
        apart: whether any of these times is not the stamp itself.
    """

    used: NDArray[np.bool_]
    time_ns: Ints
    apart: bool = False
    steps: list[StampStep] = field(default_factory=list)


@dataclass(slots=True)
class StampTrack:
    """The clock of the stamps of a topic.

    Attributes:
        newest_ns: the newest time given.
        stamped, unstamped: messages whose stamp was used, and was not.
        missing, still: messages without a stamp, and with one that stands still.
        off_ns: arrival less stamp, of the last stamp that is not of the host's clock.
        is_apart: whether the stamps are those of another clock.
    """

    newest_ns: int = 0
    stamped: int = 0
    unstamped: int = 0
    missing: int = 0
    still: int = 0
    off_ns: int = 0
    is_apart: bool = False
    _offset_ns: int = 0
    _last: tuple[int, int] | None = None  # stamp and arrival of the last message
    _begin: tuple[int, int] = (0, 0)  # of the first since the last step
    _newest_arrived: int = 0  # arrival of the message with the newest time
    _most_ahead: int = 0  # of the arrival, since the last step
    _same: tuple[int, int, int] = (0, 0, 0)  # last stamp, how many messages have it, and arrival of the first
    _waiting: int = 0  # stamps in a row of a clock that is not trusted yet
    _was_used: bool = False  # whether the last stamp gave a time
    _unreported_ns: int | None = None  # step to a clock that is not trusted yet

    @property
    def is_kept(self) -> bool:
        """Whether the stamps are a column of their own."""
        return self.is_apart or self.still > 0

    def times(self, stamps: Ints, arrivals: Ints) -> StampTimes:
        """Times of the next messages of the topic, (n,) each; a stamp is 0 if the message has none."""
        result = StampTimes(np.zeros(len(stamps), bool), np.zeros(len(stamps), np.int64))
        if not len(stamps):
            return result
        stands = self._stand_still(stamps, arrivals)
        rows = np.flatnonzero((stamps > 0) & ~stands)
        if len(rows):
            run = stamps[rows], arrivals[rows]
            some = StampTimes(np.zeros(len(rows), bool), np.zeros(len(rows), np.int64))
            self._stamped(*run, some)
            result.used[rows], result.time_ns[rows], result.apart = some.used, some.time_ns, some.apart
            result.steps = [StampStep(int(rows[step.row]), step.by_ns) for step in some.steps]
        count = int(result.used.sum())
        self.stamped += count
        self.unstamped += len(stamps) - count
        self.still += int(stands.sum())
        self.missing += int((stamps <= 0).sum())
        if count < len(stamps):
            stamp = int(stamps[~result.used][-1])
            self.off_ns = int(arrivals[~result.used][-1]) - stamp if stamp > 0 else 0
        return result

    def _stand_still(self, stamps: Ints, arrivals: Ints) -> NDArray[np.bool_]:
        """Mask of messages whose stamp is that of many before or after them, which arrived one after the other."""
        begins = np.flatnonzero(np.diff(stamps, prepend=self._same[0]))
        if not len(begins) or begins[0]:  # the first stamps are those of the block before
            begins = np.concatenate(([0], begins))
            before, since = self._same[1:] if self._same[0] == stamps[0] else (0, int(arrivals[0]))
        else:
            before, since = 0, int(arrivals[0])
        ends = np.append(begins[1:], len(stamps))
        counts, first = ends - begins, arrivals[begins]
        counts[0] += before
        first[0] = since
        self._same = int(stamps[-1]), int(counts[-1]), int(first[-1])
        stands = (counts >= MIN_BLOCK_STAMPS) & (arrivals[ends - 1] - first >= STILL_NS) & (stamps[begins] > 0)
        return np.repeat(stands, ends - begins)

    def _stamped(self, stamps: Ints, arrivals: Ints, result: StampTimes) -> None:
        """Times of messages that have a stamp each."""
        previous = (int(stamps[0]), int(arrivals[0])) if self._last is None else self._last
        moved = np.diff(stamps, prepend=previous[0])
        passed = np.diff(arrivals, prepend=previous[1])
        new = (moved < -STEP_BACK_NS) | (moved - passed > AHEAD_NS + LATE_NS)
        new |= self._steps_ahead(stamps - arrivals, new)
        edges = np.unique(np.concatenate(([0], np.flatnonzero(new), [len(stamps)])))
        for begin, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            self._run(stamps, arrivals, slice(begin, end), result, is_new=self._last is None or bool(new[begin]))

    def _steps_ahead(self, ahead: Ints, new: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Mask of messages before which another clock than the host's went ahead, beside steps that are known.

        No message arrives before it is stamped: stamps that are further ahead of the arrivals than any before are those
        of a clock that was set.

        Args:
            ahead: stamps less arrivals.
            new: the known steps.
        """
        begins = np.unique(np.concatenate(([0], np.flatnonzero(new))))
        most = self._most_ahead if self._last is not None and not new[0] else int(ahead[0])
        before = np.empty_like(ahead)
        for begin, end in zip(begins.tolist(), [*begins[1:].tolist(), len(ahead)], strict=True):
            part = np.maximum.accumulate(np.concatenate(([most if not begin else int(ahead[begin])], ahead[begin:end])))
            before[begin:end] = part[:-1]
            most = int(part[-1])
        self._most_ahead = most
        is_foreign = (ahead <= -LATE_NS) | (ahead >= AHEAD_NS)
        return is_foreign & (ahead - before > BACK_NS)

    def _run(self, stamps: Ints, arrivals: Ints, rows: slice, result: StampTimes, *, is_new: bool) -> None:
        """Times of messages whose clock does not step between them."""
        run, arrived = stamps[rows], arrivals[rows]
        last = self._last
        if is_new:
            self._waiting, self._begin = 0, (int(run[0]), int(arrived[0]))
            self._unreported_ns = None if last is None else self._step(int(run[0]) - last[0], int(arrived[0]) - last[1])
        self._waiting += len(run)
        goes_on = self._offset_ns != 0 and not is_new
        if not goes_on and self._is_foreign(run, arrived) and self._is_trusted(len(run)):
            self._offset_ns = self._placed(run, arrived)
            self.is_apart = goes_on = True
            self._report(rows.start, result)
        elif is_new and self._offset_ns and self._is_host(run, arrived):
            self._offset_ns = 0
            self._report(rows.start, result)
        if goes_on:
            result.used[rows] = True
            result.time_ns[rows] = run + self._offset_ns
            result.apart = True
            self.off_ns = self._offset_ns
        else:
            result.used[rows] = self._usable(run, arrived)
            result.time_ns[rows] = run
        if (used := result.used[rows]).any():
            times = result.time_ns[rows][used]
            if (newest := int(times.max())) > self.newest_ns:
                self.newest_ns, self._newest_arrived = newest, int(arrived[used][times.argmax()])
        self._last = int(run[-1]), int(arrived[-1])
        self._was_used = bool(result.used[rows][-1])

    def _step(self, moved_ns: int, passed_ns: int) -> int | None:
        """Move of the clock against the arrivals since a stamp was used; None if none was."""
        if self._was_used:
            return moved_ns - passed_ns
        return None if self._unreported_ns is None else self._unreported_ns + moved_ns - passed_ns

    def _report(self, row: int, result: StampTimes) -> None:
        if self._unreported_ns is not None:
            result.steps.append(StampStep(row, self._unreported_ns))
        self._unreported_ns = None

    def _is_trusted(self, count: int) -> bool:
        return count >= MIN_BLOCK_STAMPS or self._waiting >= MIN_STAMPS

    def _is_host(self, run: Ints, arrived: Ints) -> bool:
        ahead = int(run[0]) - int(arrived[0])
        return -LATE_NS < ahead < AHEAD_NS and int(run[0]) >= self.newest_ns - STEP_BACK_NS

    def _is_foreign(self, run: Ints, arrived: Ints) -> bool:
        """Whether these stamps run like a clock, but not like that of the host from where it was."""
        if self._is_host(run, arrived):
            return False
        lasted, took = int(run[-1]) - self._begin[0], int(arrived[-1]) - self._begin[1]
        return lasted > 0 and abs(lasted - took) < max(BACK_NS, took // 10)

    def _placed(self, run: Ints, arrived: Ints) -> int:
        """Offset to the host's clock: that of the message that was least late, and none before earlier times."""
        if self.newest_ns and abs(self.newest_ns - self._newest_arrived) < LATE_NS:
            return self.newest_ns + max(int(arrived[0]) - self._newest_arrived, 1) - int(run[0])
        return max(int((arrived - run).min()), self.newest_ns + 1 - int(run[0]) if self.newest_ns else -(1 << 62))

    def _usable(self, run: Ints, arrived: Ints) -> NDArray[np.bool_]:
        """Mask of the stamps that are times of the host's clock."""
        ahead = run - arrived
        used: NDArray[np.bool_] = (ahead > -LATE_NS) & (ahead < AHEAD_NS)
        newest = np.maximum.accumulate(np.concatenate(([self.newest_ns], np.where(used, run, 0))))
        return used & (run >= newest[:-1] - BACK_NS)
