"""Steps of the clock of a log, which all its tables or topics share: a restart, a clock that was set, joined logs.

    sensor_combined  1.0 1.1 1.2 1.3 │ 0.1 0.2 0.3        the first table whose clock goes back begins a segment
    wheels           1.0         1.3 │     0.2            of all: the others are only compared within it

Records of different kinds may be out of order by seconds, those of one kind may not: so each kind of records is
compared with itself, in the order of the file. The axis goes on soon after the newest time before the step.

The log times of messages are such a clock as well: `LogTimes` continues them, block by block.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from imuscope.protocols.arrays import Floats, Ints
from imuscope.protocols.messages.records import MESSAGE, records_of
from imuscope.recordings.sources import ChunkBlock
from imuscope.recordings.tables.clocks.steps import MOST_STEPS, NEXT_ROWS, PAUSE_S, ClockWatch, StepOfClock

GAP_S, LOG_GAP_S = 1.0, 0.001
SECOND_NS = 1_000_000_000
_CHANNEL_AT = 9  # in the record of a message


@dataclass(slots=True)
class LogClock:
    """Search for the steps, block by block.

    Args:
        gap_s: on the axis, for the unknown time between two segments.

    Attributes:
        watch: the steps, whose rows are places of records in the file, and the shifts of the clock from there on.
    """

    gap_s: float = GAP_S
    watch: ClockWatch = field(default_factory=lambda: ClockWatch(0.0, np.inf))
    _last: dict[str, tuple[int, float]] = field(default_factory=dict)  # of each kind: place and time
    _begin: int = 0  # place of the newest segment
    _newest: float = -np.inf  # in it
    _shift: float = 0.0

    def feed(self, kinds: Mapping[str, tuple[Floats, Ints]]) -> None:
        """Add the records of a block: times, s, and places in the file by kind."""
        back = sorted(place for name, (times, places) in kinds.items() for place in self._back(name, times, places))
        for place, before, now, previous in back:
            if previous < self._begin or len(self.watch.steps) >= MOST_STEPS:
                continue  # the segment has begun at a record of another kind
            newest = max(self._newest, *(self._newest_of(one, self._begin, place) for one in kinds.values()))
            self._shift += newest + self.gap_s - now
            self.watch.steps.append(StepOfClock(place, "back", now - before, before, now))
            self.watch.shifts.append((place, self._shift))
            self._begin, self._newest = place, -np.inf
        end = max((int(places[-1]) for _, places in kinds.values() if len(places)), default=0) + 1
        self._ahead(kinds, end)
        self._newest = max(self._newest, *(self._newest_of(one, self._begin, end) for one in kinds.values()), -np.inf)
        for name, (times, places) in kinds.items():
            if len(times):
                self._last[name] = int(places[-1]), float(times[-1])

    def _back(self, name: str, times: Floats, places: Ints) -> list[tuple[int, float, float, int]]:
        """Steps back of the clock of a kind, for good: place, the times before and after, the place before."""
        if not len(times):
            return []
        place, last = self._last.get(name, (-1, float(times[0])))
        before, behind = np.concatenate(([last], times[:-1])), np.concatenate(([place], places[:-1]))
        rows = np.flatnonzero(times < before)
        is_back = [not (times[row + 1 : row + NEXT_ROWS] > before[row]).any() for row in rows.tolist()]
        return [
            (int(places[row]), float(before[row]), float(times[row]), int(behind[row]))
            for row, back in zip(rows.tolist(), is_back, strict=True)
            if back
        ]

    @staticmethod
    def _newest_of(kind: tuple[Floats, Ints], begin: int, end: int) -> float:
        times, places = kind
        some = times[(places >= begin) & (places < end)]
        return float(some.max()) if len(some) else -np.inf

    def _ahead(self, kinds: Mapping[str, tuple[Floats, Ints]], end: int) -> None:
        """Find long pauses of all kinds together, within the newest segment."""
        times = np.concatenate([one[0] for one in kinds.values()] or [np.empty(0)])
        places = np.concatenate([one[1] for one in kinds.values()] or [np.empty(0, np.int64)])
        order = np.argsort(places, kind="stable")
        order = order[places[order] >= self._begin]
        newest = np.maximum.accumulate(np.concatenate(([self._newest], times[order])))
        for row in np.flatnonzero(np.isfinite(newest[:-1]) & (np.diff(newest) > PAUSE_S)).tolist():
            if len(self.watch.steps) < MOST_STEPS:
                before, now = float(newest[row]), float(newest[row + 1])
                self.watch.steps.append(StepOfClock(int(places[order[row]]), "ahead", now - before, before, now))


class LogTimes:
    """Log times of messages that go on where they go back: a host whose clock was set, or bags that were joined.

    Topics that were written one after the other do not count.

    Attributes:
        steps: unix s after each step, on the axis, and its size, s.
    """

    def __init__(self) -> None:
        self.steps: list[tuple[float, float]] = []
        self._clock = LogClock(LOG_GAP_S)
        self._count = 0

    def continued(self, part: ChunkBlock) -> ChunkBlock:
        """The next block of a file, with the times on the axis."""
        channels, places = _channels(part), self._count + np.arange(len(part.times))
        self._count += len(part.times)
        times = part.times / SECOND_NS
        kinds = {str(one): (times[channels == one], places[channels == one]) for one in np.unique(channels).tolist()}
        self._clock.feed(kinds)
        shifts = self._clock.watch.shifts
        if len(shifts) == 1:
            return part
        at = np.array([place for place, _ in shifts])
        moved = np.array([round(by * SECOND_NS) for _, by in shifts], np.int64)
        after = part.times + moved[np.searchsorted(at, places, "right") - 1]
        back = [step for step in self._clock.watch.steps if step.kind == "back"]
        self.steps += [(int(after[step.row - places[0]]) / SECOND_NS, step.by_s) for step in back[len(self.steps) :]]
        return replace(part, times=after)


def _channels(part: ChunkBlock) -> Ints:
    """Number of the channel of each message of a block; definitions stand before the first."""
    data = np.frombuffer(part.data, np.uint8)
    first = 0
    for opcode, record in records_of(part.data[: int(part.ends[0])]):
        if opcode == MESSAGE:
            break
        first += len(record)
    begins = np.concatenate(([first], part.ends[:-1])) + _CHANNEL_AT
    begins = np.minimum(begins, max(len(data) - 2, 0))
    return np.asarray(data[begins].astype(np.int64) | data[begins + 1].astype(np.int64) << 8)
