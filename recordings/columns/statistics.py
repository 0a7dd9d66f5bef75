"""Mean, standard deviation and extremes of any range of a column, linear or circular.

The page holds only the data on screen: for an hour at 1 kHz, the extremes of a few thousand ranges, which give no mean.
So the store is queried block by block: memory is that of one block, and an hour takes milliseconds for each column.

A wrapping angle has no linear mean. Its circular mean is the angle from which the deviations, each taken the short way
round, add up to zero; σ is the standard deviation (n − 1) of those. The page does the same with its data
(web/src/data/statistics.ts, which explains more).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.recordings.columns.store import ColumnStore

MIN_RESULTANT = 0.05  # of unit vectors; below it the direction is meaningless: the mean is NaN
MEAN_PASSES = 3
SETTLED_SHARE = 1e-6  # of the period: an anchor that moves by less has converged


@dataclass(frozen=True, slots=True)
class Statistics:
    """Statistics of the finite values; NaN if there are none."""

    n: int
    mean: float
    sigma: float
    min: float
    max: float


@dataclass(slots=True)
class _Moments:
    """Number, mean and sum of squared deviations; blocks are combined without cancellation (Chan et al.)."""

    n: int = 0
    mean: float = 0.0
    m2: float = 0.0

    def add(self, values: Floats) -> None:
        n = len(values)
        if n == 0:
            return
        mean = float(values.mean())
        m2 = float(np.square(values - mean).sum())
        off, total = mean - self.mean, self.n + n
        self.m2 += m2 + off * off * self.n * n / total
        self.mean += off * n / total
        self.n = total

    @property
    def sigma(self) -> float:
        return float(np.sqrt(self.m2 / (self.n - 1))) if self.n > 1 else 0.0


def wrapped(angle: Any, period: float) -> Any:
    """`angle` in [−period/2, period/2]."""
    return angle - period * np.round(angle / period)


def statistics(store: ColumnStore, channel: int, column: int, lo: int, hi: int, period: float = 0.0) -> Statistics:
    """Statistics of the rows lo ≤ row < hi of a channel's own column, by position; period 0: it never wraps."""

    def parts() -> Iterator[Floats]:
        for values in store.values(channel, column, lo, hi):
            numbers = values.astype(np.float64)
            yield numbers[np.isfinite(numbers)]

    return statistics_of(parts, period)


def norm_statistics(store: ColumnStore, channel: int, columns: Sequence[int], lo: int, hi: int) -> Statistics:
    """Statistics of the length of the vectors formed by these columns."""

    def parts() -> Iterator[Floats]:
        for axes in zip(*(store.values(channel, column, lo, hi) for column in columns), strict=True):
            with np.errstate(over="ignore"):
                norms = np.sqrt(np.sum([np.square(axis.astype(np.float64)) for axis in axes], axis=0))
            yield norms[np.isfinite(norms)]

    return statistics_of(parts)


def statistics_of(parts: Callable[[], Iterator[Floats]], period: float = 0.0) -> Statistics:
    """Statistics of finite values given in parts; `parts` is called once for every pass over them."""
    line, least, most = _Moments(), float("inf"), float("-inf")
    for values in parts():
        line.add(values)
        if len(values):
            least, most = min(least, float(values.min())), max(most, float(values.max()))
    if line.n == 0:
        return Statistics(0, float("nan"), float("nan"), float("nan"), float("nan"))
    if period <= 0 or most - least <= period / 2:
        return Statistics(line.n, line.mean, line.sigma, least, most)
    mean, sigma = _around(parts, period, line.mean)
    if least >= 0 and mean < 0:  # a heading counted from 0 to 360
        mean += period
    return Statistics(line.n, mean, sigma, least, most)


def _around(parts: Callable[[], Iterator[Floats]], period: float, other: float) -> tuple[float, float]:
    total, n = 0j, 0
    for values in parts():
        total += complex(np.exp(2j * np.pi / period * values).sum())
        n += len(values)
    has_direction = abs(total) / n >= MIN_RESULTANT
    anchor = float(np.angle(total)) * period / (2 * np.pi) if has_direction else other
    moments = _Moments()
    for _ in range(MEAN_PASSES):
        moments = _Moments()
        for values in parts():
            moments.add(wrapped(values - anchor, period))
        if not has_direction or abs(moments.mean) < SETTLED_SHARE * period:
            break
        anchor += moments.mean
    return (float(wrapped(anchor, period)) if has_direction else float("nan")), moments.sigma
