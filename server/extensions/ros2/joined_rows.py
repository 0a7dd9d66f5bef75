"""Rows of several channels as rows of one: what a message with several quantities needs. Pure.

    driver    t0    t1    t2    t3           one message for each of its rows
    other     t0          t2                 the row of the same time, else the last one before, at most MAX_AGE_NS old

Channels of one message of the device have the same times and arrive together. Another message with the same time may
arrive a moment later: rows of the driver wait for it, at most WAIT_NS.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.recordings.exporters.topics import stamps
from imuscope.server.extensions.ros2.quantities import Place
from imuscope.server.wire.codec import SampleFrame

Times = NDArray[np.int64]

WAIT_NS = 50_000_000  # ns
MAX_AGE_NS = 500_000_000  # ns
MAX_ROWS = 1024  # rows of a channel


@dataclass(frozen=True, slots=True)
class RowBlock:
    """Rows of a driver with those of the others.

    Args:
        times, arrivals: (n,) ns since 1970.
        values: (n, k) of the driver's place, in the unit of ROS.
        others: (n, k) of each other place; NaN where there is none.
    """

    times: Times
    arrivals: Times
    values: Floats
    others: Mapping[str, Floats]


class RowJoin:
    """Joins the channels of a message of ours.

    Args:
        driver: gives the times.
        others: the places to join, by name.
    """

    def __init__(self, driver: Place, others: Mapping[str, Place]) -> None:
        self._driver, self._others = driver, dict(others)
        self._pending = RecentRows(driver)
        self._recent = {name: RecentRows(place) for name, place in others.items()}

    def take(self, samples: Mapping[int, Sequence[SampleFrame]], *, waits: bool = True) -> RowBlock | None:
        """The rows that are complete, after newly received samples by channel; None for no rows.

        Args:
            waits: whether other rows of the same time may still arrive.
        """
        for name, place in self._others.items():
            for frame in samples.get(place.channel, ()):
                self._recent[name].add(frame)
        for frame in samples.get(self._driver.channel, ()):
            self._pending.add(frame)
        n = self._complete() if waits else len(self._pending.times)
        if n == 0:
            return None
        times, arrivals, values = self._pending.pop(n)
        return RowBlock(times, arrivals, values, {name: rows.at(times) for name, rows in self._recent.items()})

    def _complete(self) -> int:
        """Number of pending rows that need not wait."""
        times = self._pending.times
        if not len(times):
            return 0
        until = int(times[-1])
        for name, place in self._others.items():
            newest = self._recent[name].newest
            if place.message != self._driver.message and newest is not None and until - newest < MAX_AGE_NS:
                until = min(until, newest)
        until = max(until, int(times[-1]) - WAIT_NS)
        return int(np.searchsorted(times, until, "right"))


class RecentRows:
    """The last rows of a place, ascending in time."""

    def __init__(self, place: Place) -> None:
        self._place = place
        self.times: Times = np.zeros(0, np.int64)
        self._arrivals: Times = np.zeros(0, np.int64)
        self._values: Floats = np.zeros((0, len(place.columns)))

    @property
    def newest(self) -> int | None:
        return int(self.times[-1]) if len(self.times) else None

    def add(self, frame: SampleFrame) -> None:
        """Append received samples; earlier ones than those here discard them, as after a restart of a clock."""
        if frame.n == 0:
            return
        times = stamps(frame.columns[0], frame.columns[1])
        arrivals = stamps(frame.columns[0], frame.columns[0])
        values = values_of(self._place, frame.columns)
        if len(self.times) and times[0] < self.times[-1]:
            self.times, self._arrivals, self._values = times, arrivals, values
            return
        self.times = np.concatenate((self.times, times))[-MAX_ROWS:]
        self._arrivals = np.concatenate((self._arrivals, arrivals))[-MAX_ROWS:]
        self._values = np.concatenate((self._values, values))[-MAX_ROWS:]

    def pop(self, n: int) -> tuple[Times, Times, Floats]:
        """Remove the first n rows and return them: times, arrivals, values."""
        first = self.times[:n], self._arrivals[:n], self._values[:n]
        self.times, self._arrivals, self._values = self.times[n:], self._arrivals[n:], self._values[n:]
        return first

    def at(self, times: Times) -> Floats:
        """The row of each time, else the last one before it; NaN where that is too old."""
        result = np.full((len(times), self._values.shape[1]), np.nan)
        index = np.searchsorted(self.times, times, "right") - 1
        rows = np.flatnonzero(index >= 0)
        rows = rows[times[rows] - self.times[index[rows]] <= MAX_AGE_NS]
        result[rows] = self._values[index[rows]]
        return result


def values_of(place: Place, columns: Sequence[NDArray[Any]]) -> Floats:
    """Values (n, k) of a place in the unit of ROS.

    Args:
        columns: arrival, time, then those of the channel.
    """
    values = np.column_stack([columns[2 + at] for at in place.columns]).astype(np.float64)
    return values if place.scale == 1.0 else values * place.scale
