"""Rest of a sensor: the stretches of a signal without motion.

Noise is judged while the sensor rests. Two judgements are made, and both have to find rest:

    absolute    all axes of the device's gyroscope and accelerometer together, by limits of motion by hand or vehicle
                (stillness.py); without them the signal itself, if it is a rate of turn or acceleration
    relative    the variance of the signal in windows; one that exceeds that of its quiet windows by far is motion, with
                the windows beside it. White noise of any level never does so; a slow drift does not either.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.server.extensions.analysis.signals.sampling import Sampling
from imuscope.server.extensions.analysis.signals.signals import Signal
from imuscope.server.extensions.analysis.signals.stillness import (
    FORCE_CHANGE,
    FORCE_SPREAD,
    TURN_CHANGE,
    TURN_SPREAD,
    moving_intervals,
)
from imuscope.server.extensions.analysis.signals.triads import Samples
from imuscope.server.extensions.analysis.signals.units import Unit

WINDOW_S = 1.0
MIN_WINDOW = 25  # samples: a smaller window's variance scatters too much
MOVING_VARIANCE_RATIO = 5.0  # times the usual variance
QUIET_WINDOW_SHARE = 0.1  # part of the windows that are quiet even if the sensor moves most of the time
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
    for begin, end in _absolute(signal, values):
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


def _alone(signal: Signal, values: Floats, factor: float) -> Samples:
    """One axis as a sensor of one."""
    return Samples(signal.time, (values if factor == 1.0 else values * factor)[:, np.newaxis])


def _unmoved(run: slice, moving: NDArray[np.bool_]) -> list[slice]:
    if not moving[run].any():
        return [run]
    still = np.concatenate(([False], ~moving[run], [False])).astype(np.int8)
    edges = (np.flatnonzero(np.diff(still)) + run.start).tolist()
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _resting_runs(values: Floats, sampling: Sampling) -> list[slice]:
    """Runs without motion by the variance of the signal itself."""
    length = max(MIN_WINDOW, round(sampling.rate * WINDOW_S))
    variances = [_variances(values[run], length) for run in sampling.runs]
    everything = np.concatenate(variances) if variances else np.empty(0)
    if len(everything) < 4:
        return list(sampling.runs)
    limit = MOVING_VARIANCE_RATIO * _usual(everything, length)
    if limit <= 0:
        return list(sampling.runs)
    runs: list[slice] = []
    for run, own in zip(sampling.runs, variances, strict=True):
        moving = own > limit
        moving[1:] |= own[:-1] > limit
        moving[:-1] |= own[1:] > limit
        runs += _still(run, moving, length)
    return runs


def _usual(variances: Floats, length: int) -> float:
    """Variance of a window at rest, from the quiet ones: most of the others may be motion."""
    from scipy.special import chdtri

    freedom = length - 2
    return float(np.quantile(variances, QUIET_WINDOW_SHARE)) * freedom / float(chdtri(freedom, 1 - QUIET_WINDOW_SHARE))


def _variances(values: Floats, length: int) -> Floats:
    """Variance of each whole window, about its own line: (windows,)."""
    count = len(values) // length
    windows = values[: count * length].reshape(count, length)
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
