"""Rest of a sensor: the stretches of a signal without motion.

Noise is judged while the sensor rests. The variance is taken in windows; one that exceeds the usual variance by far is
motion, with the windows beside it. White noise of any level never does so; a slow drift does not either.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from server.analysis.sampling import Sampling
from server.analysis.signals import Floats

WINDOW_S = 1.0
MIN_WINDOW = 25  # samples: a smaller window's variance scatters too much
EXCESS = 5.0  # times the usual variance


def resting_runs(values: Floats, sampling: Sampling) -> tuple[list[slice], float]:
    """Runs without motion.

    Returns:
        The slices, in order, and the time left out, s.
    """
    length = max(MIN_WINDOW, round(sampling.rate * WINDOW_S))
    variances = [_variances(values[run], length) for run in sampling.runs]
    everything = np.concatenate(variances) if variances else np.empty(0)
    if len(everything) < 4:
        return list(sampling.runs), 0.0
    limit = EXCESS * float(np.median(everything))
    if limit <= 0:
        return list(sampling.runs), 0.0
    found: list[slice] = []
    for run, own in zip(sampling.runs, variances, strict=True):
        moving = own > limit
        moving[1:] |= own[:-1] > limit
        moving[:-1] |= own[1:] > limit
        found += _still(run, moving, length)
    kept = sum(one.stop - one.start for one in found)
    total = sum(run.stop - run.start for run in sampling.runs)
    return found, (total - kept) / sampling.rate


def _variances(values: Floats, length: int) -> Floats:
    """Variance of each whole window, about its own line: (windows,)."""
    count = len(values) // length
    windows = values[: count * length].reshape(count, length)
    centred = windows - windows.mean(axis=1, keepdims=True)
    ramp = np.arange(length) - (length - 1) / 2
    slope = centred @ ramp / float(ramp @ ramp)
    variance: Floats = np.square(centred).mean(axis=1) - np.square(slope) * float(ramp @ ramp) / length
    return variance


def _still(run: slice, moving: Sequence[bool] | np.ndarray, length: int) -> list[slice]:
    """The stretches of a run between windows that move; what is left at its end belongs to the last window."""
    count = len(moving)
    if not count:
        return [run]
    edges = [*(run.start + n * length for n in range(count)), run.stop]
    found: list[slice] = []
    for n in range(count):
        if not moving[n]:
            if found and found[-1].stop == edges[n]:
                found[-1] = slice(found[-1].start, edges[n + 1])
            else:
                found.append(slice(edges[n], edges[n + 1]))
    return found
