"""Spikes: single samples far outside the noise around them, as faults of a link or a converter make them.

x   ·  ·  ·     ·  ·        far from the median of the seven samples around it, and alone: of 21 samples at most
^ spike           MOST_NEAR are outside the noise; motion, shocks and bursts change many in a row
"""

import math

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats

SPIKE_SIGMAS = 7.0  # of the noise around it: noise of 10 million samples hardly ever is so far out
LOUD_SIGMAS = 3.0  # of a sample outside the noise, and of the step to it
NEIGHBOURS = np.arange(-3, 4)
NEAR_SAMPLES, MOST_NEAR = 10, 2  # on each side
MOST_STEPS = 100_000  # of samples, for the level of their noise


def spikes_in(values: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Positions of the spikes among samples, (n,), and the median of the samples around each."""
    steps = np.diff(values)
    sigma = noise_level(steps)
    if not sigma:
        return np.empty(0, np.int64), np.empty(0)
    large = np.flatnonzero(np.abs(steps) > LOUD_SIGMAS * sigma)
    at = np.unique(np.concatenate((large, large + 1)))
    around = np.median(values[np.clip(at[:, None] + NEIGHBOURS, 0, len(values) - 1)], axis=1)
    away = np.abs(values[at] - around)
    loud = at[away > LOUD_SIGMAS * sigma]
    near = np.searchsorted(loud, at + NEAR_SAMPLES, "right") - np.searchsorted(loud, at - NEAR_SAMPLES, "left")
    is_spike = (away > SPIKE_SIGMAS * sigma) & (near <= MOST_NEAR)
    return at[is_spike], around[is_spike]


def noise_level(steps: Floats) -> float:
    """Standard deviation of white noise by the median of steps from each sample to the next, (n - 1,)."""
    some = steps[:: 1 + len(steps) // MOST_STEPS]
    return float(np.median(np.abs(some))) / 0.6745 / math.sqrt(2) if len(some) else 0.0


def without_spikes(values: Floats) -> Floats:
    """The samples, (n,) or (n, axes), with the median of those around each spike in its place."""
    cleaned = values.copy()
    for column in cleaned.reshape(len(values), -1).T:  # views of its columns
        at, around = spikes_in(column)
        column[at] = around
    return cleaned
