"""Temperature drift: the part of a signal at rest that follows the temperature of its device.

    means of blocks of the signal ──┐
                                    ├─ line y = a + b·T, errors white + random walk (generalised least squares) ─> b ± u
    means of the temperature ───────┘

A bias that wanders by itself resembles any slow curve, so ordinary least squares would find a dependence on temperature
where there is none. The errors are therefore white noise plus a random walk, each share of which counts by its
likelihood, and a coefficient counts only from some times its uncertainty. The removed part is b times the smoothed
temperature: its own noise and steps do not get into the signal. This is the usual correction before an Allan deviation
(IEEE Std 952, annex C: trends are estimated and removed, since they are not noise).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from imuscope.protocols.arrays import Floats

MEAN_BLOCKS = 60
MIN_BLOCKS = 12
LEAST_CHANGE = 0.2  # °C: less cannot be distinguished from the noise of the temperature sensor
SIGNIFICANT_BOUNDS = 2.5  # times the uncertainty, which depends on the estimated share of the walk
CURVED_SIGMAS = 4.0  # of the curvature of a dependence that is not linear
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
        uncertainty: half of its 95 % interval, if the signal does not drift by itself as the temperature does; NaN if
            the dependence is not linear; `per_degree` is then the mean slope.
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
    means -= means.mean()
    warmth = np.array([_mean_between(known, degrees, time[block.start], time[block.stop - 1]) for block in blocks])
    low, high = float(warmth.min()), float(warmth.max())
    if high - low < LEAST_CHANGE:
        return None
    slope, bound, is_curved = _slope(centres, warmth, means)
    steps = np.diff(np.unique(degrees))
    bound = math.hypot(bound, abs(slope) * float(steps.min()) / (high - low))  # both ends may be off by half a step
    if not abs(slope) >= SIGNIFICANT_BOUNDS * bound:
        return None
    part = slope * (_along(time, centres, warmth) - float(warmth.mean()))
    return ThermalDrift(slope, math.nan if is_curved else bound, low, high, part)


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


def _slope(centres: Floats, warmth: Floats, means: Floats) -> tuple[float, float, bool]:
    """Slope over the temperature, half of its 95 % interval, and whether the dependence is not linear."""
    from scipy.special import stdtrit

    count = len(means)
    steps = (centres - centres[0]) / np.median(np.diff(centres))
    walk = np.minimum.outer(steps, steps)
    degrees = warmth - warmth.mean()
    design = np.stack([np.ones(count), degrees, np.square(degrees)], axis=1)
    covariances = np.eye(count) + np.array(WALK_SHARES)[:, np.newaxis, np.newaxis] * walk
    likelihood, slopes, variances = _fitted(covariances, design[:, :2], means)
    weights = np.exp(likelihood - likelihood.max())
    weights /= weights.sum()
    slope = float(weights @ slopes)
    sigma = float(np.sqrt(weights @ (variances + np.square(slopes - slope))))
    _, curves, spreads = _fitted(covariances, design, means)
    is_curved = bool(weights @ (np.abs(curves) / np.sqrt(spreads)) > CURVED_SIGMAS)
    return slope, float(stdtrit(count - 2, 0.975)) * sigma, is_curved


def _fitted(covariances: Floats, design: Floats, means: Floats) -> tuple[Floats, Floats, Floats]:
    """Restricted likelihood, last coefficient and its variance of generalised least squares under each covariance."""
    inverse, freedom = np.linalg.inv(covariances), len(means) - design.shape[1]
    normal, right = design.T @ inverse @ design, design.T @ inverse @ means
    solution = np.linalg.solve(normal, right[..., np.newaxis])[..., 0]
    rest = np.maximum(means @ inverse @ means - np.sum(right * solution, axis=1), 1e-300)
    logs = np.linalg.slogdet(covariances)[1] + np.linalg.slogdet(normal)[1]
    likelihood: Floats = -0.5 * (freedom * np.log(rest) + logs)
    slopes: Floats = np.asarray(solution[:, -1], np.float64)
    return likelihood, slopes, rest / freedom * np.linalg.inv(normal)[:, -1, -1]


def _along(time: Floats, centres: Floats, warmth: Floats) -> Floats:
    """The temperature at each sample, on lines between the blocks that go on beyond the first and the last."""
    first = warmth[0] + (warmth[1] - warmth[0]) / (centres[1] - centres[0]) * (time[0] - centres[0])
    last = warmth[-1] + (warmth[-1] - warmth[-2]) / (centres[-1] - centres[-2]) * (time[-1] - centres[-1])
    along: Floats = np.interp(time, np.r_[time[0], centres, time[-1]], np.r_[first, warmth, last])
    return along
