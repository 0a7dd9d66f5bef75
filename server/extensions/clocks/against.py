"""Difference of a clock to the time axis: its slope, its scatter, where it steps, and its course in few points.

difference  ╱╱╱╱      ╱╱╱     it begins at zero again after each step that lasts, so that drift and jitter stay
╱╱╱╱╱╱        visible beside a step of any size
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.recordings.tables.clocks.steps import StepOfClock

MOST_POINTS = 200  # of the course of a difference
SIDE_ROWS = (20, 4000)  # fewest and most rows on a side of a step that distinguish it from a stall
MAX_STALL_STEPS = 4.0  # lengths of a step in which one is caught up
LASTING_STEP_SHARE = 0.5  # of a step: a difference that changes by less comes back
MEAN_BLOCKS, FEWEST_BLOCKS = 24, 4
WALK_SHARES = tuple(10.0**power for power in range(-3, 7))  # variance over the whole length, of that of a block's mean
WHITE_WEIGHT = 100.0  # of errors that are white, which are usual, against each other share
DRIFT_DIGITS = 4


@dataclass(frozen=True, slots=True)
class ClockDifference:
    """Course of a difference, in parts of its length: those without samples are absent.

    Args:
        times: middle of each part on the axis, unix s.
        low, high: least and greatest difference in it, s; zero at the first sample after a step.
        edges: steps of the difference, on the axis, unix s.
    """

    times: list[float]
    low: list[float]
    high: list[float]
    edges: list[float]


@dataclass(frozen=True, slots=True)
class AgainstAxis:
    """Figures of a difference; None where they are unknown."""

    drift_ppm: float | None
    drift_error_ppm: float | None
    jitter_s: float | None
    series: ClockDifference | None


def difference_between(clock: Floats, axis: Floats, steps: Sequence[StepOfClock]) -> AgainstAxis:
    """Figures of the difference of a clock to the axis, both in s; drift and jitter of the longest stretch.

    Args:
        steps: of the clock.
    """
    raw = (clock - clock[0]) - (axis - axis[0])
    usual = float(np.median(np.diff(axis)))
    edges = list(_edges(raw, steps, usual))
    bounds = [0, *edges, len(clock)]
    begin, end = max(itertools.pairwise(bounds), key=lambda pair: pair[1] - pair[0])
    series = _series(raw, axis, bounds)
    x, y = axis[begin:end] - axis[begin], raw[begin:end]
    if len(x) < 3 or not np.ptp(x) > 0:
        return AgainstAxis(None, None, None, series)
    slope, offset = np.polyfit(x, y, 1)
    rest = y - slope * x - offset
    return AgainstAxis(float(slope * 1e6), _slope_error(x, rest), float(np.std(rest)), series)


def _edges(difference: Floats, steps: Sequence[StepOfClock], usual: float) -> Iterator[int]:
    """Rows at which a step of the clock is one of the difference, and stays."""
    fewest, most = SIDE_ROWS
    for step in steps:
        if not step.row:
            continue
        wide = MAX_STALL_STEPS * abs(step.by_s) / usual if usual > 0 else fewest
        n = int(min(max(wide, fewest), most))
        before, after = difference[max(step.row - n, 0) : step.row], difference[step.row : step.row + n]
        if abs(float(np.median(after) - np.median(before))) > LASTING_STEP_SHARE * abs(step.by_s):
            yield step.row


def _slope_error(x: Floats, rest: Floats) -> float | None:
    """Half of the 95 % interval of a slope, ppm, from means of blocks: samples of a burst are not independent.

    Clocks wander, so the errors are white noise with a random walk of the difference, or of its rate.
    """
    from scipy.special import stdtrit

    count = min(MEAN_BLOCKS, len(x) // FEWEST_BLOCKS)
    if count < FEWEST_BLOCKS:
        return None
    starts = np.linspace(0, len(x), count, endpoint=False).astype(np.int64)
    sizes = np.diff(np.append(starts, len(x)))
    means_x, means = np.add.reduceat(x, starts) / sizes, np.add.reduceat(rest, starts) / sizes
    span, size = float(np.ptp(means_x)), float(np.std(means))
    if not (span > 0 and size > 0):
        return 0.0 if span > 0 else None
    turn = (means_x - means_x[0]) / span
    early, late = np.minimum.outer(turn, turn), np.maximum.outer(turn, turn)
    walks = (early, early**2 * (3 * late - early) / 2)
    design = np.stack([np.ones(count), turn - turn.mean()], axis=1)
    covariances = np.array([np.eye(count), *(np.eye(count) + share * walk for walk in walks for share in WALK_SHARES)])
    # generalised least squares under each, which counts by its restricted likelihood
    inverse, values, freedom = np.linalg.inv(covariances), means / size, count - 2
    normal, right = design.T @ inverse @ design, design.T @ inverse @ values
    solution = np.linalg.solve(normal, right[..., np.newaxis])[..., 0]
    remains = np.maximum(values @ inverse @ values - np.sum(right * solution, axis=1), 1e-300)
    logs = np.linalg.slogdet(covariances)[1] + np.linalg.slogdet(normal)[1]
    likelihood = -0.5 * (freedom * np.log(remains) + logs)
    weights = np.exp(likelihood - likelihood.max())
    weights[0] *= WHITE_WEIGHT
    slopes, variances = solution[:, 1], remains / freedom * np.linalg.inv(normal)[:, 1, 1]
    # the stated slope is that of least squares, from which the others differ
    sigma = math.sqrt(float(weights @ (variances + np.square(slopes))) / float(weights.sum()))
    return float(stdtrit(freedom, 0.975)) * sigma * size / span * 1e6


def _series(difference: Floats, axis: Floats, bounds: Sequence[int]) -> ClockDifference | None:
    first, length = float(axis.min()), float(np.ptp(axis))
    if not length > 0:
        return None
    sizes = np.diff(bounds)
    values = difference - np.repeat(difference[np.array(bounds[:-1])], sizes)
    part = np.minimum(((axis - first) / length * MOST_POINTS).astype(np.int64), MOST_POINTS - 1)
    low, high = np.full(MOST_POINTS, np.inf), np.full(MOST_POINTS, -np.inf)
    np.minimum.at(low, part, values)
    np.maximum.at(high, part, values)
    filled = np.flatnonzero(np.isfinite(low))
    middles = first + (filled + 0.5) * length / MOST_POINTS
    return ClockDifference(
        middles.tolist(),
        [float(f"{value:.{DRIFT_DIGITS}g}") for value in low[filled].tolist()],
        [float(f"{value:.{DRIFT_DIGITS}g}") for value in high[filled].tolist()],
        axis[np.array(bounds[1:-1], np.int64)].tolist(),
    )
