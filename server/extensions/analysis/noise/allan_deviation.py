"""Overlapping Allan deviation of evenly spaced samples in several runs, and its confidence intervals.

Samples y are averages over their step (a rate, an acceleration); x is their running integral. For an averaging time
τ = m steps

    σ²(τ) = mean of (x[i + 2m] − 2 x[i + m] + x[i])² / (2 τ²)      over all i of all runs

Sources: W. J. Riley, Handbook of Frequency Stability Analysis, NIST Special Publication 1065 (2008): the overlapping
deviation in 5.2.4, its degrees of freedom by type of noise in table 5.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Floats

BLOCK_SAMPLES = 1 << 16  # fit into the cache, and threads rarely wait for the interpreter between steps
TAIL_PROBABILITY = 0.025  # probability beyond each end of the interval

WHITE_PHASE, WHITE, FLICKER, WALK = range(4)
"""Types of noise by the slope of σ over τ: −1, −1/2, 0, +1/2 (and more)."""


@dataclass(frozen=True, slots=True)
class AllanCurve:
    """Allan deviations by averaging time.

    Attributes:
        m: (n,) averaging times in samples, ascending.
        tau: (n,) averaging times, s.
        adev: (n,) deviations in the unit of the samples.
        lengths: number of samples of each run.
    """

    m: Sequence[int]
    tau: Floats
    adev: Floats
    lengths: Sequence[int]

    def degrees_of_freedom(self, noise: Sequence[int]) -> Floats:
        """Of each deviation, for the type of noise at its averaging time."""
        return np.array(
            [
                sum(_degrees(n + 1, m, kind) for n in self.lengths if n >= 2 * m)
                for m, kind in zip(self.m, noise, strict=True)
            ]
        )


def averaging_lengths(longest: int, per_decade: float) -> list[int]:
    """Averaging times in samples, evenly spaced on a logarithmic scale, up to a quarter of the longest run."""
    most = max(1, longest // 4)
    steps = round(per_decade * math.log10(most)) if most > 1 else 0
    spaced = {round(most ** (n / steps)) for n in range(steps + 1)} if steps else {1}
    return sorted(spaced | {1})


def allan_curve(runs: Sequence[Floats], rate: float, m: Sequence[int]) -> AllanCurve:
    """Allan deviations of samples.

    Args:
        runs: samples of each run, evenly spaced.
        rate: of the samples, Hz.
        m: averaging times in samples; at least one run has 2 m samples or more.
    """
    mean = sum(float(run.sum()) for run in runs) / sum(len(run) for run in runs)
    integrals = [_integral(run, mean) for run in runs]
    variances = []
    for span in m:
        total, count = 0.0, 0
        for x in integrals:
            n = len(x) - 2 * span
            if n > 0:
                total += _sum_of_squares(x, span, n)
                count += n
        variances.append(total / (2 * span * span * count))
    return AllanCurve(m, np.array(m) / rate, np.sqrt(variances), [len(run) for run in runs])


def _integral(run: Floats, mean: float) -> Floats:
    """Running sum of samples from 0 on, (n + 1,); without their mean, so that no digits are lost."""
    sums = np.empty(len(run) + 1)
    sums[0] = 0.0
    np.subtract(run, mean, out=sums[1:])
    np.cumsum(sums[1:], out=sums[1:])
    return sums


def _sum_of_squares(x: Floats, m: int, n: int) -> float:
    total = 0.0
    size, shared = min(BLOCK_SAMPLES, n), m < BLOCK_SAMPLES // 2
    part, other = np.empty(size), np.empty(size + m if shared else size)
    for begin in range(0, n, BLOCK_SAMPLES):
        end = min(begin + BLOCK_SAMPLES, n)
        a = part[: end - begin]
        if shared:  # both differences of a sample are differences of two: one pass instead of two
            b = other[: end - begin + m]
            np.subtract(x[begin + m : end + 2 * m], x[begin : end + m], out=b)
            np.subtract(b[m:], b[: end - begin], out=a)
        else:
            b = other[: end - begin]
            np.subtract(x[begin + 2 * m : end + 2 * m], x[begin + m : end + m], out=a)
            np.subtract(x[begin + m : end + m], x[begin:end], out=b)
            np.subtract(a, b, out=a)
        total += float(np.einsum("i,i", a, a))  # a product by BLAS would start threads of its own
    return total


def _degrees(n: int, m: int, noise: int) -> float:
    """Degrees of freedom of the overlapping deviation of n phases (NIST SP 1065, table 5)."""
    if noise == WHITE_PHASE:
        degrees = (n + 1) * (n - 2 * m) / (2 * (n - m))
    elif noise == WHITE:
        degrees = (3 * (n - 1) / (2 * m) - 2 * (n - 2) / n) * 4 * m * m / (4 * m * m + 5)
    elif noise == FLICKER:
        degrees = 2 * (n - 2) ** 2 / (2.3 * n - 4.9) if m == 1 else 5 * n * n / (4 * m * (n + 3 * m))
    else:
        degrees = (n - 2) / m * ((n - 1) ** 2 - 3 * m * (n - 1) + 4 * m * m) / max(1, n - 3) ** 2
    return max(1.0, degrees)


def intervals(deviation: Floats, freedom: Floats, outside: float = TAIL_PROBABILITY) -> tuple[Floats, Floats]:
    """Both ends of the interval of each deviation, 95 % by default (chi-squared, NIST SP 1065, 5.3.2)."""
    from scipy.special import chdtri

    return (
        deviation * np.sqrt(freedom / chdtri(freedom, outside)),
        deviation * np.sqrt(freedom / chdtri(freedom, 1 - outside)),
    )
