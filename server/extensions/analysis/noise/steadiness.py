"""Regularity of noise: what a noise model presupposes of the samples at rest beside rest itself.

    level           one standard deviation all along: cumulative sums of the logarithms of the variances of windows
    distribution    that of Gauss: kurtosis and skewness. Saturation makes it flat or oblique, and averages of clipped
                    samples have no value at which they end; it also makes the noise smaller far from the mean. Bursts
                    and many small spikes make it long-tailed
    steps           a bias that jumps: means on both sides of each moment, at several lengths. Of a random walk they
                    differ everywhere, of a step only beside it

Their limits hold for noise of any colour: the scatter they are compared with comes from the samples themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from imuscope.protocols.arrays import Floats

WINDOW_S = 1.0
MIN_WINDOW, MAX_WINDOW = 25, 100  # samples
MAX_SAMPLES = 1 << 18  # that are examined, of windows all along
MIN_WINDOWS = 12
LEVEL_LIMIT = 2.2  # of the cumulative sum of a level without change: one of 10 000 reaches it
LEVELS = 10  # parts of which the levels are compared
GROUPS = 20  # by which the scatter of the moments is known
MOMENT_SIGMAS = 5.0  # with 19 degrees of freedom: one of 10 000 is so far out
COMPRESSION_SIGMAS = 5.0
TAIL_ERRORS = 10.0  # of white noise, from which a moment is that of bursts
MIN_FLATNESS, MAX_TAIL, MAX_SKEWNESS = 0.06, 0.3, 0.1
"""Kurtosis below and above that of Gauss, and skewness, that change noise parameters by less than 1 %, 5 % and 1 %."""
STEP_WINDOWS = 2000
SUSPECTED_SIGMAS = 5.2  # of a jump: one of 100 sensors without has it
STEP_SCALES = ((1, 6.5), (2, 6.5), (4, 6.5), (8, 7.0), (16, 7.5), (32, 9.0))
"""Windows on each side, and standard deviations of a jump: the fewer windows, the less sure the deviation."""


@dataclass(frozen=True, slots=True)
class Level:
    """A level of noise that changes: standard deviations of the quietest and loudest part, as shares of that of all."""

    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Jump:
    """The largest jump of a bias: the sample at which it is, and its size."""

    at: int
    size: float


@dataclass(frozen=True)
class Regularity:
    """Noise of the stretches of a signal at rest.

    Attributes:
        values: (n,) of the signal.
        runs: its stretches.
        rate: Hz.
    """

    values: Floats
    runs: Sequence[slice]
    rate: float

    @cached_property
    def _windows(self) -> tuple[Floats, Floats]:
        """Some of the windows, (windows, samples), without their own line; and their means."""
        length = int(min(max(MIN_WINDOW, self.rate * WINDOW_S), MAX_WINDOW))
        parts = [_rows(self.values[run], length) for run in self.runs]
        stride = 1 + sum(part.size for part in parts) // MAX_SAMPLES
        windows = np.concatenate([part[::stride] for part in parts])
        means = windows.mean(axis=1)
        windows = windows - means[:, np.newaxis]
        ramp = np.arange(length) - (length - 1) / 2
        slopes = np.einsum("ij,j->i", windows, ramp) / float(ramp @ ramp)
        return windows - slopes[:, np.newaxis] * ramp, means

    @cached_property
    def _variances(self) -> Floats:
        windows, _ = self._windows
        variances: Floats = np.einsum("ij,ij->i", windows, windows)
        return variances

    @cached_property
    def level(self) -> Level | None:
        """The level if it changes; None for one that is steady."""
        variances = self._variances
        if len(variances) < MIN_WINDOWS or not variances.min() > 0:
            return None
        logs = np.log(variances)
        scatter = float(np.square(np.diff(logs)).mean()) / 2
        sums = np.abs(np.cumsum(logs - logs.mean()))
        if float(sums.max()) <= LEVEL_LIMIT * np.sqrt(scatter * len(logs)):
            return None
        parts = np.array([part.mean() for part in np.array_split(variances, LEVELS)])
        low, high = np.sqrt(np.array([parts.min(), parts.max()]) / variances.mean())
        return Level(float(low), float(high))

    @cached_property
    def moments(self) -> tuple[float, float]:
        """Kurtosis beyond that of Gauss and skewness; 0 where they can be by chance.

        They are means of Hermite polynomials, whose scatter does not contain that of the level.
        """
        windows, _ = self._windows
        if len(windows) < GROUPS:
            return 0.0, 0.0
        scale = np.sqrt(np.einsum("ij,ij->j", windows, windows) / len(windows))  # of a walk the ends scatter more
        if not scale.min() > 0:
            return 0.0, 0.0
        z = windows / scale
        squares = np.square(z)
        third, fourth = ((squares - 3) * z).mean(axis=1), ((squares - 6) * squares + 3).mean(axis=1)
        return (
            _beyond_chance(fourth, np.sqrt(24 / windows.size)),
            _beyond_chance(third, np.sqrt(6 / windows.size)),
        )

    @cached_property
    def is_compressed(self) -> bool:
        """Whether the noise is smaller the further the mean of a window is from that of all."""
        _, means = self._windows
        if len(means) < MIN_WINDOWS or not self._variances.min() > 0 or not np.ptp(means) > 0:
            return False
        away, logs = np.square(means - means.mean()), np.log(self._variances)
        return bool(np.corrcoef(away, logs)[0, 1] * np.sqrt(len(means)) < -COMPRESSION_SIGMAS)

    @property
    def jump(self) -> Jump | None:
        """The largest jump of the mean that is none of a random walk; None without."""
        return self._jumps[1]

    @property
    def may_jump(self) -> bool:
        """Whether the mean may jump by less than is certain."""
        return self._jumps[0] > SUSPECTED_SIGMAS

    @cached_property
    def _jumps(self) -> tuple[float, Jump | None]:
        """The largest jump of the mean in standard deviations, and the one that is none of a random walk."""
        length = max(1, sum(run.stop - run.start for run in self.runs) // STEP_WINDOWS)
        best: tuple[float, Jump | None] = (1.0, None)
        sigmas = 0.0
        means = [_rows(self.values[run], length).mean(axis=1) for run in self.runs]
        for scale, limit in STEP_SCALES:
            jumps = [_differences(part, scale) for part in means]
            everything = np.concatenate(jumps)
            if len(everything) < 40 * scale:
                break
            sigma = float(np.median(np.abs(everything))) / 0.6745
            for run, own in zip(self.runs, jumps, strict=True):
                size = float(np.abs(own).max()) if len(own) else 0.0
                sigmas = max(sigmas, size / sigma if sigma > 0 else 0.0)
                if sigma > 0 and size > limit * sigma * best[0]:
                    at = int(np.abs(own).argmax())
                    best = size / limit / sigma, Jump(run.start + (at + scale) * length, float(own[at]))
        return sigmas, best[1]


def _rows(values: Floats, length: int) -> Floats:
    """Whole windows of samples, (windows, length)."""
    count = len(values) // length
    return values[: count * length].reshape(count, length)


def _differences(means: Floats, scale: int) -> Floats:
    """Mean of the `scale` windows after each edge of two, without that of as many before it."""
    if len(means) < 2 * scale:
        return np.empty(0)
    sums = np.concatenate(([0.0], np.cumsum(means - means.mean()))) / scale
    jumps: Floats = sums[2 * scale :] - 2 * sums[scale:-scale] + sums[: -2 * scale]
    return jumps


def _beyond_chance(moments: Floats, least: float) -> float:
    """Mean of some moments that are 0 for Gauss; 0 if it can be by chance."""
    groups = np.array([part.mean() for part in np.array_split(moments, GROUPS)])
    away = float(moments.mean())
    if away > TAIL_ERRORS * least:  # few bursts scatter from group to group as much as they add
        return away
    sigma = max(float(groups.std(ddof=1)) / np.sqrt(GROUPS), float(least))
    return away if abs(away) > MOMENT_SIGMAS * sigma else 0.0
