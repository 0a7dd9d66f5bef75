"""Rest of a sensor: the stretches of a signal without motion.

Noise is judged while the sensor rests. Two judgements are made, and both have to find rest:

    absolute    all axes of the device's gyroscope and accelerometer together, by limits of motion by hand or vehicle
                (stillness.py); without them the signal itself, if it is a rate of turn or acceleration
    relative    the variance of the signal in windows; one that exceeds that of its quiet windows by far is motion, with
                the windows beside it, and so is one of another axis of its triad. White noise of any level never does
                so; a slow drift does not either.

Spikes do not count (spikes.py). Where most windows have one level of white noise and the others much less, the quiet
ones are the fault, and nothing moves.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.units import Unit
from imuscope.server.extensions.analysis.signals.sampling import Sampling
from imuscope.server.extensions.analysis.signals.signals import Signal
from imuscope.server.extensions.analysis.signals.spikes import without_spikes
from imuscope.server.extensions.analysis.signals.stillness import (
    FORCE_CHANGE,
    FORCE_SPREAD,
    TURN_CHANGE,
    TURN_SPREAD,
    StepMeans,
    moving_intervals,
)
from imuscope.server.extensions.analysis.signals.triads import Samples

WINDOW_S = 1.0
MIN_WINDOW = 25  # samples: a smaller window's variance scatters too much
MOVING_VARIANCE_RATIO = 5.0  # times the usual variance
QUIET_WINDOW_SHARE = 0.1  # part of the windows that are quiet even if the sensor moves most of the time
NOISE_SHARE = 0.5  # part of the windows that are noise of the sensor if they are alike and white
MAX_NOISE_RATIO = 3.0  # of their variances, between the 90th and the 10th percentile; motion of hands has 10 and more
MIN_WHITENESS = 0.5  # of the mean square of steps to twice the variance: white noise has 1
TURN, FORCE = Unit.parse("°/s"), Unit.parse("m/s²")


@dataclass(frozen=True, slots=True)
class Rest:
    """Rest of a signal.

    Attributes:
        runs: slices of the signal at rest, in order.
        moving: time that they leave out, s.
        whole: time of all samples, s.
    """

    runs: Sequence[slice]
    moving: float
    whole: float


def rest_of(signal: Signal, values: Floats, sampling: Sampling) -> Rest:
    """Rest of a signal by itself and by its companions.

    Args:
        values: of the signal, unwrapped.
    """
    moving = np.zeros(len(values), np.bool_)
    beside = [] if signal.siblings is None else _uneven(signal.siblings())
    for begin, end in (*_absolute(signal, values), *beside):
        lo, hi = np.searchsorted(signal.time, (begin, end))
        moving[lo:hi] = True
    runs = [part for run in _resting_runs(values, sampling) for part in _unmoved(run, moving)]
    total = sum(run.stop - run.start for run in sampling.runs)
    samples = sum(run.stop - run.start for run in runs)
    return Rest(runs, (total - samples) / sampling.rate, total / sampling.rate)


def _absolute(signal: Signal, values: Floats) -> Iterable[tuple[float, float]]:
    beside = None if signal.companions is None else signal.companions()
    unit = Unit.parse(signal.unit)
    if beside is not None and (len(beside.gyroscope) or len(beside.accelerometer)):
        return beside.moving
    if unit.fits(TURN):
        return moving_intervals(_alone(signal, values, unit.to(TURN)), TURN_SPREAD, TURN_CHANGE)
    if unit.fits(FORCE):
        return moving_intervals(_alone(signal, values, unit.to(FORCE)), FORCE_SPREAD, FORCE_CHANGE)
    return []


def _uneven(means: StepMeans) -> list[tuple[float, float]]:
    """Intervals in which one of some axes moves, unix s, by the relative judgement of each on its means."""
    edges = np.flatnonzero(np.diff(means.time) > 1.5 * means.step) + 1
    parts = [slice(a, b) for a, b in pairwise([0, *edges.tolist(), len(means)])]
    moving = np.zeros(len(means), np.bool_)
    for axis in range(means.means.shape[1]):
        still = np.zeros(len(means), np.bool_)
        sampling = Sampling(1 / means.step, parts, 0, 0.0, 0.0)
        for run in _resting_runs(means.means[:, axis], sampling, spread=False):  # its windows are long enough
            still[run] = True
        moving |= ~still
    half = means.step / 2
    runs = _unmoved(slice(0, len(means)), ~moving) if moving.any() else []
    return [(float(means.time[run.start]) - half, float(means.time[run.stop - 1]) + half) for run in runs]


def _alone(signal: Signal, values: Floats, factor: float) -> Samples:
    """One axis as a sensor of one."""
    return Samples(signal.time, (values if factor == 1.0 else values * factor)[:, np.newaxis])


def _unmoved(run: slice, moving: NDArray[np.bool_]) -> list[slice]:
    if not moving[run].any():
        return [run]
    still = np.concatenate(([False], ~moving[run], [False])).astype(np.int8)
    edges = (np.flatnonzero(np.diff(still)) + run.start).tolist()
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _resting_runs(values: Floats, sampling: Sampling, *, spread: bool = True) -> list[slice]:
    """Runs without motion by the variance of the signal itself.

    Args:
        spread: the windows beside one that moves do so as well.
    """
    length = max(MIN_WINDOW, round(sampling.rate * WINDOW_S))
    variances = [_variances(values[run], length) for run in sampling.runs]
    limit = _limit(variances, length)
    if not any((own > limit).any() for own in variances):
        return list(sampling.runs)
    calm = [without_spikes(values[run]) for run in sampling.runs]
    variances = [_variances(one, length) for one in calm]
    limit = _limit(variances, length)
    loud = np.concatenate([_windows(one, length)[own > limit] for one, own in zip(calm, variances, strict=True)])
    if len(loud) > NOISE_SHARE * sum(map(len, variances)) and _is_noise(loud):
        return list(sampling.runs)
    runs: list[slice] = []
    for run, own in zip(sampling.runs, variances, strict=True):
        moving = own > limit
        if spread:
            moving[1:] |= own[:-1] > limit
            moving[:-1] |= own[1:] > limit
        runs += _still(run, moving, length)
    return runs


def _limit(variances: Sequence[Floats], length: int) -> float:
    """Variance of a window from which it is motion; infinite if the windows are too few."""
    everything = np.concatenate(variances) if variances else np.empty(0)
    limit = MOVING_VARIANCE_RATIO * _usual(everything, length) if len(everything) >= 4 else 0.0
    return limit if limit > 0 else np.inf


def _is_noise(windows: Floats) -> bool:
    """Whether windows, (n, samples), all have one level of white noise."""
    variances = windows.var(axis=1)
    low, high = np.quantile(variances, (0.1, 0.9))
    whiteness = float(np.square(np.diff(windows, axis=1)).mean() / 2 / max(float(variances.mean()), 1e-300))
    return bool(high <= MAX_NOISE_RATIO * low and whiteness >= MIN_WHITENESS)


def _usual(variances: Floats, length: int) -> float:
    """Variance of a window at rest, from the quiet ones: most of the others may be motion."""
    from scipy.special import chdtri

    freedom = length - 2
    return float(np.quantile(variances, QUIET_WINDOW_SHARE)) * freedom / float(chdtri(freedom, 1 - QUIET_WINDOW_SHARE))


def _windows(values: Floats, length: int) -> Floats:
    """The whole windows of samples, (windows, length)."""
    count = len(values) // length
    return values[: count * length].reshape(count, length)


def _variances(values: Floats, length: int) -> Floats:
    """Variance of each whole window, about its own line: (windows,)."""
    windows = _windows(values, length)
    centred = windows - windows.mean(axis=1, keepdims=True)
    ramp = np.arange(length) - (length - 1) / 2
    slope = np.einsum("ij,j->i", centred, ramp) / float(ramp @ ramp)  # BLAS would start threads of its own
    squares = np.einsum("ij,ij->i", centred, centred)
    variance: Floats = (squares - np.square(slope) * float(ramp @ ramp)) / length
    return variance


def _still(run: slice, moving: Sequence[bool] | NDArray[np.bool_], length: int) -> list[slice]:
    """The stretches of a run between windows that move; the remainder at its end belongs to the last window."""
    count = len(moving)
    if not count:
        return [run]
    edges = [*(run.start + n * length for n in range(count)), run.stop]
    runs: list[slice] = []
    for n, (begin, end) in enumerate(pairwise(edges)):
        if not moving[n]:
            if runs and runs[-1].stop == begin:
                runs[-1] = slice(runs[-1].start, end)
            else:
                runs.append(slice(begin, end))
    return runs
