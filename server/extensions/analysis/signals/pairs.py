"""Pairs of two signals at the same moments, thinned for a plot of one over the other.

    leader      |  |  |  |  |  |  |  |  |     the signal with more samples: its times are those of the pairs
    follower    |        |        |     ·     linear between its samples, or the nearest one; none across a gap

Thinned pairs are samples as well: of each interval the first, the last and those with the least and the greatest x and
y, so that no extreme is lost. web/src/extensions/xy/pairs.ts does the same with what a page holds.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.recordings.columns.breaks import gaps_in
from imuscope.server.extensions.analysis.signals.signals import Signal

Pairing = Literal["interpolated", "nearest"]
SAMPLES_PER_INTERVAL = 6  # samples of an interval: first, last, and the extremes of x and y
FLOAT32_DIGITS = 7  # significant ones of the greatest value, as many as a 32-bit float has


@dataclass(frozen=True, slots=True)
class Pairs:
    """Values of two signals at the same moments.

    Attributes:
        time: (n,) unix s, non-decreasing.
        x, y: (n,) finite.
        starts: (n,) true where no line may come from the pair before: a gap, or an angle that wrapped.
        leader: name of the signal whose times these are; "" where both have the same.
    """

    time: Floats
    x: Floats
    y: Floats
    starts: NDArray[np.bool_]
    leader: str


def paired(x: Signal, y: Signal, how: Pairing) -> Pairs:
    """Pairs of two signals, at the times of the one with more samples.

    Args:
        how: values of the other one, where it has no sample of that time.
    """
    if len(x.time) == len(y.time) and np.array_equal(x.time, y.time):
        starts = _starts(np.arange(len(x.time)), x.time) | _wrapped(x.values, x.period) | _wrapped(y.values, y.period)
        return Pairs(x.time, x.values, y.values, starts, "")
    leads_x = len(x.time) >= len(y.time)
    leader, follower = (x, y) if leads_x else (y, x)
    values = _at(follower, leader.time, how)
    rows = np.flatnonzero(np.isfinite(values))
    time, own, other = leader.time[rows], leader.values[rows], values[rows]
    starts = _starts(rows, leader.time) | _wrapped(own, leader.period) | _wrapped(other, follower.period)
    return Pairs(time, own if leads_x else other, other if leads_x else own, starts, leader.name)


def thinned(pairs: Pairs, most: int) -> Pairs:
    """At most `most` of the pairs, with the extremes of x and y of each interval."""
    n = len(pairs.time)
    if n <= most:
        return pairs
    length = -(-n // max(1, most // SAMPLES_PER_INTERVAL))
    whole = n - n % length
    indices = [np.arange(0, n, length), np.minimum(np.arange(0, n, length) + length, n) - 1]
    for values in (pairs.x, pairs.y):
        blocks = values[:whole].reshape(-1, length)
        offsets = np.arange(len(blocks)) * length
        indices += [offsets + blocks.argmin(1), offsets + blocks.argmax(1)]
        if whole < n:
            rest = values[whole:]
            indices.append(whole + np.array([rest.argmin(), rest.argmax()]))
    at = np.unique(np.concatenate(indices))
    before = np.cumsum(pairs.starts)
    starts = np.diff(before[at], prepend=-1) > 0  # also where the start itself is not kept
    return Pairs(pairs.time[at], pairs.x[at], pairs.y[at], starts, pairs.leader)


def shortened(values: Floats) -> list[float]:
    """The values without digits that a 32-bit float does not have."""
    largest = float(np.abs(values).max(initial=0.0))
    decimals = FLOAT32_DIGITS - int(np.ceil(np.log10(largest))) if largest > 0 else 0
    return np.round(values, decimals).tolist()  # type: ignore[no-any-return]  # numpy: Any


def _at(signal: Signal, time: Floats, how: Pairing) -> Floats:
    """Values of a signal at these times; NaN across its gaps and beyond its ends."""
    own, n = signal.time, len(signal.time)
    if n < 2:
        return np.where(np.isin(time, own), signal.values[0] if n else np.nan, np.nan)
    after = np.clip(np.searchsorted(own, time, side="right"), 1, n - 1)
    before = after - 1
    steps = own[after] - own[before]
    share = np.divide(time - own[before], steps, out=np.zeros(len(time)), where=steps > 0)
    change = signal.values[after] - signal.values[before]
    if signal.period:
        change -= signal.period * np.round(change / signal.period)
    usual = float(np.median(np.diff(own)))
    if how == "nearest":
        values = np.where(share < 0.5, signal.values[before], signal.values[after])
    else:
        values = signal.values[before] + np.clip(share, 0, 1) * change
        if signal.period:
            values = on_circle(values, signal.period, signal.values)
    beyond = np.maximum(own[0] - time, time - own[-1]) > (usual / 2 if how == "nearest" else 0)
    bridged = np.isin(after, gaps_in(own)) & (share > 0) & (share < 1)
    return np.where(beyond | bridged, np.nan, values)


def on_circle(values: Floats, period: float, own: Floats) -> Floats:
    """Values on the circle that the signal uses: 0 to its period, or half of it to either side."""
    low = 0.0 if own.min(initial=0.0) >= 0 and own.max(initial=0.0) > period / 2 else -period / 2
    return (values - low) % period + low


def _starts(rows: NDArray[np.int64], time: Floats) -> NDArray[np.bool_]:
    """Of rows of the leader the first one, and those after a gap or after rows without a pair."""
    starts: NDArray[np.bool_] = (np.diff(rows, prepend=-2) > 1) | np.isin(rows, gaps_in(time))
    return starts


def _wrapped(values: Floats, period: float) -> NDArray[np.bool_]:
    """True for each sample at which an angle went over its edge."""
    is_wrap = np.zeros(len(values), np.bool_)
    if period and len(values):
        is_wrap[1:] = np.abs(np.diff(values)) > period / 2
    return is_wrap
