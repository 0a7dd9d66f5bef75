"""Temperature drift: the part of a signal at rest that follows the temperature of its device.

    means of blocks of the signal ──┐
                                    ├─ line y = a + b·T, errors white + random walk (generalised least squares) ─> b ± σ
    means of the temperature ───────┘

A bias that wanders by itself resembles any slow curve, so ordinary least squares would find a dependence on temperature
where there is none. The errors are therefore white noise plus a random walk whose share maximises the likelihood, and
a coefficient counts only from SIGNIFICANT standard deviations. The removed part is b times the smoothed temperature:
its own noise and steps do not get into the signal. This is the usual correction before an Allan deviation (IEEE Std
952, annex C: trends are estimated and removed, since they are not noise).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from imuscope.protocols.arrays import Floats

MEAN_BLOCKS = 60
MIN_BLOCKS = 12
LEAST_CHANGE = 0.2  # °C: less cannot be distinguished from the noise of the temperature sensor
SIGNIFICANT_SIGMAS = 5.0  # of the coefficient, whose uncertainty depends on the estimated share of the walk
WALK_SHARES = (
    0.0,
    0.01,
    0.03,
    0.1,
    0.3,
    1.0,
    3.0,
    10.0,
    100.0,
)  # variance of the walk per block over that of the white noise


@dataclass(frozen=True, slots=True)
class ThermalDrift:
    """Dependence of a signal on temperature.

    Attributes:
        per_degree: unit/°C.
        uncertainty: standard uncertainty (1 σ) of it.
        low, high: °C, of the blocks.
        part: (n,) of each sample, 0 at the mean temperature.
    """

    per_degree: float
    uncertainty: float
    low: float
    high: float
    part: Floats


def thermal_drift(
    time: Floats, values: Floats, runs: Sequence[slice], temperature: tuple[Floats, Floats]
) -> ThermalDrift | None:
    """The dependence of a signal on temperature; None if there is none that is significant.

    Args:
        time, values: (n,) of the signal.
        runs: its stretches at rest.
        temperature: times and values, °C.
    """
    finite = np.isfinite(temperature[1])
    known, degrees = temperature[0][finite], temperature[1][finite]
    if len(known) < MIN_BLOCKS:
        return None
    blocks = blocks_of(runs, len(time))
    if len(blocks) < MIN_BLOCKS:
        return None
    centres = np.array([time[block].mean() for block in blocks])
    means = np.array([values[block].mean() for block in blocks])
    warmth = np.array([_mean_between(known, degrees, time[block.start], time[block.stop - 1]) for block in blocks])
    low, high = float(warmth.min()), float(warmth.max())
    if high - low < LEAST_CHANGE:
        return None
    slope, sigma = _slope(centres, warmth, means)
    if not abs(slope) >= SIGNIFICANT_SIGMAS * sigma:
        return None
    part = slope * (_along(time, centres, warmth) - float(warmth.mean()))
    return ThermalDrift(slope, sigma, low, high, part)


def blocks_of(runs: Sequence[slice], whole: int) -> list[slice]:
    """Parts of all runs, of about the same length."""
    return [block for run in runs for block in _blocks(run, whole)]


def _blocks(run: slice, whole: int) -> list[slice]:
    """Parts of a run of about the same length, in proportion to its share of all samples."""
    length = max(1, whole // MEAN_BLOCKS)
    count = (run.stop - run.start) // length
    edges = np.linspace(run.start, run.stop, max(count, 1) + 1).astype(int)
    if not count:
        return []
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def _mean_between(known: Floats, degrees: Floats, begin: float, end: float) -> float:
    """Mean temperature of a time; between two samples the value on their line."""
    first, last = np.searchsorted(known, (begin, end), side="left")
    if last > first:
        return float(degrees[first:last].mean())
    return float(np.interp((begin + end) / 2, known, degrees))


def _slope(centres: Floats, warmth: Floats, means: Floats) -> tuple[float, float]:
    """Slope of the means over the temperature, and its standard uncertainty."""
    count = len(means)
    steps = (centres - centres[0]) / np.median(np.diff(centres))
    walk = np.minimum.outer(steps, steps)
    design = np.stack([np.ones(count), warmth - warmth.mean()], axis=1)
    best, estimate = -np.inf, (0.0, np.inf)
    for share in WALK_SHARES:
        root = np.linalg.cholesky(np.eye(count) + share * walk)
        rows, right = np.linalg.solve(root, design), np.linalg.solve(root, means)
        normal = rows.T @ rows
        solution = np.linalg.solve(normal, rows.T @ right)
        rest = float(np.sum(np.square(right - rows @ solution)))
        if rest <= 0:
            return float(solution[1]), 0.0
        # restricted likelihood: the coefficients are estimated too
        logs = 2 * float(np.log(np.diag(root)).sum()) + float(np.linalg.slogdet(normal)[1])
        likelihood = -0.5 * ((count - 2) * np.log(rest) + logs)
        if likelihood > best:
            variance = rest / (count - 2) * float(np.linalg.inv(normal)[1, 1])
            best, estimate = likelihood, (float(solution[1]), float(np.sqrt(variance)))
    return estimate


def _along(time: Floats, centres: Floats, warmth: Floats) -> Floats:
    """The temperature at each sample, on lines between the blocks that go on beyond the first and the last."""
    first = warmth[0] + (warmth[1] - warmth[0]) / (centres[1] - centres[0]) * (time[0] - centres[0])
    last = warmth[-1] + (warmth[-1] - warmth[-2]) / (centres[-1] - centres[-2]) * (time[-1] - centres[-1])
    along: Floats = np.interp(time, np.r_[time[0], centres, time[-1]], np.r_[first, warmth, last])
    return along
