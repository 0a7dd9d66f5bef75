"""Rest of a sensor, judged from the means of short intervals.

    samples ─> means of 0.1 s (the noise of a MEMS sensor and an idling engine average out, motion does not)
            ─> windows of 1 s: spread of their means, and change from one window to the next
            ─> runs of windows at rest

A gyroscope that turns steadily without change looks like one at rest with a bias; the accelerometer shows such a turn
unless its axis is vertical. Limits are for motion by hand or vehicle; they do not depend on the grade of the sensor.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.server.extensions.analysis.signals.spikes import without_spikes
from imuscope.server.extensions.analysis.signals.triads import Samples

STEP_S = 0.1
WINDOW_S = 1.0
TURN_SPREAD, TURN_CHANGE = 0.3, 0.15  # °/s: a hand that tries to hold still has 0.5 and more
FORCE_SPREAD, FORCE_CHANGE = 0.15, 0.15  # m/s²: 0.15 is a tilt of 0.9°
WINDOW_STEPS = 10  # of 0.1 s
MOST_STEPS = 100_000  # of samples, for the level of their noise


@dataclass(frozen=True, slots=True)
class StepMeans:
    """Means of short intervals.

    Attributes:
        time: (n,) unix s, middle of each interval.
        means: (n, 3).
        step: length of an interval, s.
        counts: (n,) samples in each.
    """

    time: Floats
    means: Floats
    step: float
    counts: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True, slots=True)
class RestRun:
    """A stretch of rest, from `begin` to `end`, unix s."""

    begin: float
    end: float

    @property
    def seconds(self) -> float:
        return self.end - self.begin


@dataclass(frozen=True, slots=True)
class Stillness:
    """Rest along time.

    Attributes:
        runs: in order.
        motion: of the newest window, as a share of what still counts as rest.
    """

    runs: list[RestRun]
    motion: float

    @property
    def longest(self) -> RestRun | None:
        return max(self.runs, key=lambda run: run.seconds, default=None)


def step_means(samples: Samples) -> StepMeans:
    """Means of intervals of STEP_S, or of five samples if they are slower."""
    rate = samples.rate
    step = max(STEP_S, 5 / rate) if rate else STEP_S
    if not len(samples):
        return StepMeans(np.empty(0), np.empty((0, 3)), step, np.empty(0, np.int64))
    number = np.floor((samples.time - samples.time[0]) / step).astype(np.int64)
    starts = np.concatenate(([0], np.flatnonzero(np.diff(number)) + 1))  # times do not decrease
    counts = np.diff(np.append(starts, len(number)))
    sums = np.add.reduceat(samples.values, starts, axis=0)
    times = np.add.reduceat(samples.time - samples.time[0], starts) + counts * samples.time[0]
    is_full = counts >= max(1, 0.3 * counts.max())  # a sliver at the end is noise
    return StepMeans((times / counts)[is_full], (sums / counts[:, None])[is_full], step, counts[is_full])


def stillness(turn: StepMeans | None, force: StepMeans | None) -> Stillness:
    """Rest of a sensor by its gyroscope, its accelerometer, or both."""
    parts = []
    if turn is not None and len(turn):
        parts.append((turn, TURN_SPREAD, TURN_CHANGE))
    if force is not None and len(force):
        parts.append((force, FORCE_SPREAD, FORCE_CHANGE))
    if not parts:
        return Stillness([], math.inf)
    begin = max(float(means.time[0]) - means.step / 2 for means, _, _ in parts)
    end = min(float(means.time[-1]) + means.step / 2 for means, _, _ in parts)
    # windows that overlap by half; beside motion they do not count, so that a rest is found to a window
    window = max(WINDOW_S, *(5 * means.step for means, _, _ in parts))
    starts = np.arange(begin, end - window + 1e-6, window / 2)
    if not len(starts):
        return Stillness([], math.inf)
    motion = np.max([_motion(means, starts, window, *limits) for means, *limits in parts], axis=0)
    return Stillness(_runs(starts, window, motion <= 1), float(motion[-1]))


def _motion(means: StepMeans, starts: Floats, window: float, spread: float, change: float) -> Floats:
    """Motion in each window as a share of the limits; infinite for a window with too few samples."""
    first = np.searchsorted(means.time, starts - 1e-9)
    last = np.searchsorted(means.time, starts + window - 1e-9)
    count = last - first
    sums = np.concatenate((np.zeros((1, 3)), np.cumsum(means.means, axis=0)))
    squares = np.concatenate((np.zeros((1, 3)), np.cumsum(np.square(means.means), axis=0)))
    n = np.maximum(count, 1)[:, None]
    mean = (sums[last] - sums[first]) / n
    variance = np.maximum((squares[last] - squares[first]) / n - np.square(mean), 0)
    spreads = np.sqrt(variance.sum(axis=1)) / spread
    # half a window apart, so that two that overlap by half are compared with the next but one
    changes = np.zeros(len(starts))
    if len(starts) > 2:
        steps = np.linalg.norm(mean[2:] - mean[:-2], axis=1) / change
        changes[2:] = steps
        changes[:-2] = np.maximum(changes[:-2], steps)
    motion: Floats = np.where(count >= 0.6 * window / means.step, np.maximum(spreads, changes), np.inf)
    return motion


def _runs(starts: Floats, window: float, still: NDArray[np.bool_]) -> list[RestRun]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], still, [False])).astype(np.int8)))
    return [
        RestRun(float(starts[a]), float(starts[b - 1] + window))
        for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    ]


def within(means: StepMeans, run: RestRun, margin: float = 0.0) -> StepMeans:
    """The intervals in a run, without a margin at its ends."""
    lo, hi = np.searchsorted(means.time, [run.begin + margin, run.end - margin])
    return StepMeans(means.time[lo:hi], means.means[lo:hi], means.step, means.counts[lo:hi])


def mean_and_uncertainty(means: StepMeans) -> tuple[Floats, Floats]:
    """Mean of each axis, and its standard uncertainty; both (3,).

    The uncertainty is the largest that batches of any length give, so that slow noise counts as much as it matters.
    """
    values = means.means
    mean = np.average(values, axis=0, weights=means.counts)
    uncertainty = np.zeros(3)
    length = 1
    while len(values) // length >= 5:
        count = len(values) // length
        batches = values[: count * length].reshape(count, length, 3).mean(axis=1)
        uncertainty = np.maximum(uncertainty, batches.std(axis=0, ddof=1) / math.sqrt(count))
        length *= 2
    return mean, uncertainty


def moving_intervals(
    samples: Samples, spread: float, change: float, means: StepMeans | None = None
) -> list[tuple[float, float]]:
    """Intervals of motion, unix s; they may overlap. Stretches without samples are in none of them.

    Spikes are not motion (spikes.py), and white noise of any level is not: for a sensor so noisy that its means scatter
    by a quarter of a limit, the limits grow with its noise.

    Args:
        spread: limit of the spread of the means of 0.1 s within a window of 1 s.
        change: limit of the change from one window to the next.
        means: of the samples, if they are known.
    """
    intervals = _moving(samples, spread, change, step_means(samples) if means is None else means)
    if intervals:
        cleaned = Samples(samples.time, without_spikes(samples.values))
        return _moving(cleaned, spread, change, step_means(cleaned))
    return intervals


def _moving(samples: Samples, spread: float, change: float, means: StepMeans) -> list[tuple[float, float]]:
    if len(means) < WINDOW_STEPS:
        return []
    grow = max(1.0, 4 * _white(samples) / math.sqrt(float(np.median(means.counts))) / spread)
    edges = np.flatnonzero(np.diff(means.time) > 1.5 * means.step) + 1
    intervals: list[tuple[float, float]] = []
    for part in np.split(np.arange(len(means)), edges):
        if len(part) < WINDOW_STEPS:
            continue
        starts = np.unique(
            np.append(np.arange(0, len(part) - WINDOW_STEPS, WINDOW_STEPS // 2), len(part) - WINDOW_STEPS)
        )
        values = means.means[part] - means.means[part[0]]
        sums, squares = (
            np.concatenate((np.zeros_like(one[:1]), np.cumsum(one, axis=0))) for one in (values, values**2)
        )
        mean = (sums[starts + WINDOW_STEPS] - sums[starts]) / WINDOW_STEPS
        variance = (squares[starts + WINDOW_STEPS] - squares[starts]) / WINDOW_STEPS - mean**2
        moving = np.sqrt(np.maximum(variance, 0).sum(axis=1)) > spread * grow
        # windows overlap by half, so one is compared with the next but one
        jumps = np.linalg.norm(mean[2:] - mean[:-2], axis=1) > change * grow
        moving[2:] |= jumps
        moving[:-2] |= jumps
        time = means.time[part]
        intervals += [
            (float(time[at] - means.step / 2), float(time[at + WINDOW_STEPS - 1] + means.step / 2))
            for at in starts[moving].tolist()
        ]
    return intervals


def _white(samples: Samples) -> float:
    """Standard deviation of the white noise of all axes together, from the differences of neighbouring samples."""
    at = np.arange(0, len(samples) - 1, max(1, len(samples) // MOST_STEPS))
    steps = np.median(np.abs(samples.values[at + 1] - samples.values[at]), axis=0) / 0.6745 / math.sqrt(2)
    return float(np.linalg.norm(steps))
