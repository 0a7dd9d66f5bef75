"""Steps of the clock of a flight log, which all its tables share: a restart, or logs that were joined.

    sensor_combined  1.0 1.1 1.2 1.3 │ 0.1 0.2 0.3        the first table whose clock goes back begins a segment
    wheels           1.0         1.3 │     0.2            of all: the others are only compared within it

Records of different kinds may be out of order by seconds, those of one kind may not: so each kind of records is
compared with itself, in the order of the file. The axis goes on a second after the newest time before the step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.framing import Ints
from imuscope.recordings.clock_steps import MOST_STEPS, NEXT_ROWS, PAUSE_S, ClockWatch, StepOfClock

Floats = NDArray[np.float64]

GAP_S = 1.0


@dataclass(slots=True)
class LogClock:
    """Search for the steps, block by block.

    Attributes:
        watch: the steps, whose rows are places of records in the file, and the shifts of the clock from there on.
    """

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
            self._shift += newest + GAP_S - now
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
        """Where the clock of a kind goes back for good: place, the times before and after, the place before."""
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
