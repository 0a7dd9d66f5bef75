"""Disturbances that pass for noise in an Allan deviation: lines of a spectrum, and slow changes.

    lines     peaks of the power spectral density, with their part of the Allan variance; vibration, its images at a
              rate too low for it, a swing
    slow      a sine with less than some periods in the range, a drift that ends, or a bias that steps and may step
              back: fitted to means of blocks, against errors of white noise and random walk (thermal_drift.py), so that
              a bias that wanders by itself is none of them

Allan variance of a line of rms r and frequency f, of samples at a rate s and m samples averaged:

    σ² = 2 r² sin⁴(π f m/s) / (m² sin²(π f/s))
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.units import rounded
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.noise.allan_deviation import AllanCurve
from imuscope.server.extensions.analysis.noise.thermal_drift import WALK_SHARES, blocks_of
from imuscope.server.extensions.analysis.noise.welch import Segments, mean_spectrum, segments_for
from imuscope.server.extensions.analysis.signals.sampling import Sampling

FALSE_ALARM = 1e-8  # of all bins
LINE_VARIANCE_SHARE = 0.1  # of the Allan variance at some averaging time: a line with less changes little
NEAR_BINS, FAR_BINS = 8, 50  # bins beside a line by which its floor is judged
FILTERED_RATIO = 0.1  # of the density below
SMOOTHED_PARTS = 60  # parts of a spectrum
MIN_BLOCKS = 24
SIGNIFICANT_LIKELIHOOD = 24.0  # 2 ln of the likelihood ratio: one of 100 random walks reaches it with 27 shapes
SUSPECT_LIKELIHOOD = 14.0  # one of 7 reaches it: no reason to refuse, but to be careful with what a walk resembles
STEP = "a step"
MORE_STEPS = 8.0  # by how much steps, of which there are far more shapes, must be more likely
PERIODS = np.arange(1, 25) / 2  # in the range
END_TIME_CONSTANTS = (0.05, 0.15, 0.4)  # time constants of a drift that ends, as parts of the range
WELCH = {"length": 0.0, "overlap": 0.5, "window": 0.0, "detrend": 0.0}
"""Options of the spectrum: see server/extensions/analysis/noise/welch.py."""


@dataclass(frozen=True, slots=True)
class Spectrum:
    """A one-sided power spectral density: `frequency` and `psd` (n,), its degrees of freedom and its segments."""

    frequency: Floats
    psd: Floats
    freedom: float
    segments: Segments


@dataclass(frozen=True, slots=True)
class Line:
    """A line that changes an Allan deviation.

    Attributes:
        frequency: Hz.
        rms: in the unit of the signal.
        images: frequencies above half the rate that would appear there, Hz.
    """

    frequency: float
    rms: float
    images: tuple[float, float]


def spectrum_of(values: Floats, runs: Sequence[slice], sampling: Sampling) -> Spectrum | None:
    """Spectrum of the stretches that are judged; None if they are too short for one."""
    try:
        segments = segments_for(replace(sampling, runs=list(runs)), WELCH)
    except DomainError:
        return None
    counts = [segments.count(run.stop - run.start) for run in runs]
    mean = mean_spectrum([values[run] for run in runs], counts, sampling.rate, segments)
    frequency, psd, freedom = mean.frequency, mean.psd, mean.freedom
    return Spectrum(frequency, psd, freedom, segments)


def strongest_line(spectrum: Spectrum, rate: float, curve: AllanCurve) -> Line | None:
    """The line with the largest share of the Allan variance at some averaging time, if that is larger than SHARE."""
    lines = _lines(spectrum)
    share, (at, rms) = max(((_share(line, rate, curve), line) for line in lines), default=(0.0, (0.0, 0.0)))
    return Line(at, rms, (rate - at, rate + at)) if share > LINE_VARIANCE_SHARE else None


def bandwidth(spectrum: Spectrum) -> float:
    """Frequency above which hardly anything of the signal is left, Hz; 0 if there is none."""
    n = len(spectrum.psd)
    level = float(np.median(spectrum.psd[n // 20 : n // 5 + 1]))
    smooth = np.array([np.median(part) for part in np.array_split(spectrum.psd, min(n, SMOOTHED_PARTS))])
    if smooth[-2] > FILTERED_RATIO * level:
        return 0.0
    passed = int(np.flatnonzero(smooth > level / 2)[-1]) + 1
    return float(spectrum.frequency[-1]) * passed / len(smooth)


def _lines(spectrum: Spectrum) -> list[tuple[float, float]]:
    """Frequency and rms of lines that stand out of the density beside them."""
    from scipy.special import chdtri

    frequency, psd, freedom, segments = spectrum.frequency, spectrum.psd, spectrum.freedom, spectrum.segments
    n, spacing = len(psd), float(frequency[1])
    weights = segments.window
    lobe = math.ceil(len(weights) * float(np.square(weights).sum() / np.square(weights.sum()))) + 1
    limit = float(chdtri(freedom, FALSE_ALARM / n)) / float(chdtri(freedom, 0.5))
    lines = []
    inner = np.arange(lobe, n - 1)
    least = min(float(np.median(part)) for part in np.array_split(psd, min(n, SMOOTHED_PARTS)))  # no floor is lower
    tops = inner[(psd[inner] >= psd[inner - 1]) & (psd[inner] >= psd[inner + 1]) & (psd[inner] > limit * least)]
    for at in tops.tolist():
        width = int(min(max(NEAR_BINS, at // 2), FAR_BINS))
        beside = np.r_[psd[max(1, at - width) : at - lobe + 1], psd[at + lobe : at + width + 1]]
        floor = float(np.median(beside)) if len(beside) else math.inf
        # red noise rises towards 0 Hz: the level of both sides, the lower side counting by itself
        below = float(np.median(psd[max(1, at - width) : max(2, at - lobe + 1)]))
        if psd[at] <= limit * max(floor, below, 1e-300):
            continue
        power = float((psd[max(0, at - lobe) : at + lobe + 1] - floor).sum()) * spacing
        lines.append((float(frequency[at]), math.sqrt(max(power, 0.0))))
    return lines


def _share(line: tuple[float, float], rate: float, curve: AllanCurve) -> float:
    frequency, rms = line
    m = np.array(curve.m, np.float64)
    x = math.pi * frequency / rate
    own = 2 * rms**2 * np.sin(x * m) ** 4 / (m * math.sin(x)) ** 2
    return float((own / np.maximum(np.square(curve.adev), 1e-300)).max())


@dataclass(frozen=True, slots=True)
class SlowChange:
    """The slow change that fits best: words for it, and whether it is sure or only suspected."""

    words: str
    is_sure: bool
    is_suspected: bool


def slow_change(time: Floats, values: Floats, runs: Sequence[slice]) -> SlowChange:
    """A slow change that is neither noise nor a drift along a line."""
    blocks = blocks_of(runs, len(time))
    if len(blocks) < MIN_BLOCKS:
        return SlowChange("", False, False)
    centres = np.array([time[block].mean() for block in blocks])
    means = np.array([values[block].mean() for block in blocks])
    span = float(time[-1] - time[0])
    since = (centres - centres[0]) / (centres[-1] - centres[0])
    shapes = [(f"a swing with a period of {rounded(span / k)} s", _sine(since, k)) for k in PERIODS.tolist()]
    shapes += [("a drift that slows down", np.exp(-since / part)[:, None]) for part in END_TIME_CONSTANTS]
    significance = [(_significance(since, means, shape), words) for words, shape in shapes]
    best, words = max([*significance, (_step_significance(since, means) - MORE_STEPS, STEP)])
    return SlowChange(words, best > SIGNIFICANT_LIKELIHOOD, best > SUSPECT_LIKELIHOOD)


def _sine(since: Floats, periods: float) -> Floats:
    angle = 2 * np.pi * periods * since
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _significance(since: Floats, means: Floats, shape: Floats) -> float:
    """Twice the logarithm of the likelihood ratio of a shape beside a line and of the line alone, each with errors of
    white noise and the most likely share of a random walk.
    """
    count = len(means)
    line = np.stack([np.ones(count), since], axis=1)
    best = [-math.inf, -math.inf]
    for root, log in _roots(since.tobytes()):
        right = root @ means
        for at, design in enumerate((line, np.hstack([line, shape]))):
            rest = max(_rest(root @ design, right), 1e-300)
            best[at] = max(best[at], -count * math.log(rest) - log)
    return best[1] - best[0]


def _step_significance(since: Floats, means: Floats) -> float:
    """As `_significance`, of the step, or step and step back, between blocks that fits best."""
    count = len(means)
    line = np.stack([np.ones(count), since], axis=1)
    steps = np.tri(count)[:, 1:]  # from each block on
    best = [-math.inf, -math.inf]
    for root, log in _roots(since.tobytes()):
        q, _ = np.linalg.qr(root @ line)
        right, columns = root @ means, root @ steps
        right, columns = right - q @ (q.T @ right), columns - q @ (q.T @ columns)
        # one step, and the difference of two: gains of both follow from products of single ones
        parts, squares = np.append(columns.T @ right, 0.0), np.pad(columns.T @ columns, (0, 1))
        own = np.diagonal(squares)
        size = np.maximum(own[:, None] + own - 2 * squares, 1e-9 * own.max())
        gain = float((np.square(parts[:, None] - parts) / size).max())
        whole = float(right @ right)
        for at, rest in enumerate((whole, whole - gain)):
            best[at] = max(best[at], -count * math.log(max(rest, 1e-9 * whole, 1e-300)) - log)
    return best[1] - best[0]


def _rest(design: Floats, right: Floats) -> float:
    q, _ = np.linalg.qr(design)
    return float(np.square(right).sum() - np.square(q.T @ right).sum())


@functools.lru_cache(maxsize=8)
def _roots(since: bytes) -> list[tuple[Any, float]]:
    """For each share of the walk: the matrix that whitens the errors, and the logarithm of their determinant."""
    steps = np.frombuffer(since)
    steps = (steps - steps[0]) / np.median(np.diff(steps))
    walk = np.minimum.outer(steps, steps)
    roots = [np.linalg.cholesky(np.eye(len(steps)) + share * walk) for share in WALK_SHARES]
    return [(np.linalg.inv(root), 2 * float(np.log(np.diag(root)).sum())) for root in roots]
