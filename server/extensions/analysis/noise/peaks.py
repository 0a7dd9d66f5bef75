"""Peaks of a power spectral density: lines that stand out of the floor, with frequency, rms and harmonics.

The floor is the running median of the density, raised to the mean that noise of that median has. A peak is a local
maximum so far above it that hardly any spectrum of noise alone reaches it.

The frequency of a line is that of the steady sine whose powers in five bins, for this window, fit best. Its uncertainty
is that of the fit, from the scatter of the floor and its product with the line, and the error of the interpolation. A
peak that does not fit is of several lines, or of one that wanders: its frequency is uncertain by its width.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.server.extensions.analysis.noise.welch import Segments

MAX_PEAKS = 16
FALSE_ALARM = 1e-8  # of the limit; in simulations about 0.3 % of the spectra of white noise show a peak
FLOOR_BINS = 101  # of the running median
INTERPOLATION_ERROR = 0.02  # of the spacing of the frequencies: leakage of the rest into the powers of the parabola
SHAPE_SIGMAS, SHAPE_ERROR = 4.0, 0.05  # from the shape of a steady sine, as a part of its top
SHIFTS = np.linspace(-0.6, 0.6, 61)  # of a sine from a frequency, in bins
LOBE_BINS = np.arange(-2, 3)
LOBE_SAMPLES = 512  # of a window, for its lobe
MAX_ALIASES = 3  # frequencies of which a peak may be the image


@dataclass(frozen=True, slots=True)
class Peak:
    """One line of a spectrum.

    Attributes:
        frequency: Hz.
        uncertainty: half of the 95 % interval of the frequency, Hz.
        rms: of the line, without the floor, in the unit of the signal.
        above_floor: dB.
        order: 1, or n if it lies at n times the frequency of `harmonic_of`.
        harmonic_of: frequency of the fundamental, Hz; NaN for none.
        aliases: frequencies above half the rate that would appear here, Hz.
    """

    frequency: float
    uncertainty: float
    rms: float
    above_floor: float
    order: int
    harmonic_of: float
    aliases: list[float]

    def figures(self) -> dict[str, Any]:
        """The attributes by name."""
        return {name: getattr(self, name) for name in self.__slots__}


def peaks_of(frequency: Floats, psd: Floats, rate: float, segments: Segments, freedom: float) -> list[Peak]:
    """Peaks, the strongest first, at most MAX_PEAKS.

    Args:
        frequency, psd: one-sided, evenly spaced from 0.
        rate: of the samples, Hz.
        freedom: degrees of freedom of each density.
    """
    from scipy.special import chdtri

    n = len(psd)
    if n < 8:
        return []
    floor = _floor(psd) * freedom / float(chdtri(freedom, 0.5))  # from the median of noise to its mean
    limit = float(chdtri(freedom, FALSE_ALARM / n)) / freedom
    skip = _half_width(segments)  # beside 0 Hz stands what the trend has left
    inner = np.arange(skip + 1, n - 1)
    tops = inner[(psd[inner] > psd[inner - 1]) & (psd[inner] >= psd[inner + 1]) & (psd[inner] > limit * floor[inner])]
    peaks: list[Peak] = []
    bins: list[int] = []
    lobe = Lobe.of(segments.window)
    for at in sorted(tops.tolist(), key=lambda one: -psd[one]):
        if len(peaks) == MAX_PEAKS:
            break
        if any(abs(at - other) <= 2 * skip for other in bins) or _on_a_slope(psd, at, skip):
            continue
        bins.append(at)
        peaks.append(_peak(frequency, psd, floor, rate, segments, freedom, at, lobe))
    return _with_harmonics(peaks, float(frequency[1]))


def _floor(psd: Floats) -> Floats:
    from scipy.ndimage import median_filter

    width = min(FLOOR_BINS, len(psd) // 2 * 2 - 1)
    floor: Floats = median_filter(psd, width, mode="nearest")
    tiny = float(psd.max()) * 1e-30 + 1e-300
    return np.maximum(floor, tiny)


def _half_width(segments: Segments) -> int:
    """Half of the main lobe of the window, in bins."""
    return max(1, math.ceil(_bandwidth(segments)))


def _bandwidth(segments: Segments) -> float:
    """Equivalent noise bandwidth of the window, in bins."""
    weights = segments.window
    return len(weights) * float(np.square(weights).sum() / np.square(weights.sum()))


def _on_a_slope(psd: Floats, at: int, width: int) -> bool:
    """Whether the density rises further beside the peak: a bump on the flank of a stronger one or of 1/f noise."""
    beside = psd[max(0, at - 2 * width) : at + 2 * width + 1]
    return bool(psd[at] < beside.max())


def _peak(
    frequency: Floats,
    psd: Floats,
    floor: Floats,
    rate: float,
    segments: Segments,
    freedom: float,
    at: int,
    own_lobe: Lobe,
) -> Peak:
    spacing = float(frequency[1])
    fit = own_lobe.fit(psd[np.clip(at + LOBE_BINS, 0, len(psd) - 1)], float(floor[at]), freedom)
    at_frequency = (at + fit.shift) * spacing
    width = _half_width(segments) + 1
    lobe = slice(max(0, at - width), at + width + 1)
    power = max(float((psd[lobe] - floor[lobe]).sum()) * spacing, 0.0)
    shared = max(1.0, _bandwidth(segments) / 2)  # of a wide window: its bins depend on each other
    uncertainty = spacing * math.hypot(1.96 * shared * fit.sigma, INTERPOLATION_ERROR)
    if not fit.is_steady:
        uncertainty = max(uncertainty, width * spacing)
    above = 10 * math.log10(float(psd[at]) / float(floor[at]))
    folded = sorted(abs(turn * rate + sign * at_frequency) for turn in (1, 2) for sign in (-1, 1))
    return Peak(at_frequency, uncertainty, math.sqrt(power), above, 1, math.nan, folded[:MAX_ALIASES])


@dataclass(frozen=True, slots=True)
class Lobe:
    """The powers that a steady sine has in the bins beside it with a window, for each of SHIFTS.

    Attributes:
        powers: (n, 5), as parts of that at the sine itself.
    """

    powers: Floats

    @classmethod
    def of(cls, window: Floats) -> Lobe:
        """The lobe of a window."""
        weights = window[:: max(1, len(window) // LOBE_SAMPLES)]
        turns = np.arange(len(weights)) / len(weights)
        away = LOBE_BINS - SHIFTS[:, np.newaxis]
        sums = np.exp(-2j * np.pi * away[..., np.newaxis] * turns) @ weights
        return cls(np.square(np.abs(sums) / weights.sum()))

    def fit(self, psd: Floats, floor: float, freedom: float) -> LobeFit:
        """The sine that five densities around a maximum come from."""
        powers = psd - floor
        weights = freedom / 2 / (floor**2 + 2 * floor * np.maximum(powers, floor))
        sizes = (self.powers * weights) @ powers / np.maximum(np.square(self.powers) @ weights, 1e-300)
        fitted = sizes[:, np.newaxis] * self.powers
        costs = np.square(powers - fitted) @ weights
        at = int(costs.argmin())
        inner = min(max(at, 1), len(SHIFTS) - 2)
        low, middle, high = costs[inner - 1 : inner + 2]
        bend, step = low - 2 * middle + high, float(SHIFTS[1] - SHIFTS[0])
        shift = float(SHIFTS[inner]) + (0.5 * (low - high) / bend * step if bend > 0 else 0.0)
        sigma = math.sqrt(2 / bend) * step if bend > 0 else 1.0
        off = (powers - fitted[at]) / powers[len(powers) // 2]
        limit = SHAPE_ERROR + SHAPE_SIGMAS / np.sqrt(weights) / powers[len(powers) // 2]
        return LobeFit(min(max(shift, -0.6), 0.6), sigma, not bool((np.abs(off) > limit).any()))


@dataclass(frozen=True, slots=True)
class LobeFit:
    """A fitted sine: its distance to the bin and the standard deviation of that, in bins; and whether it is steady."""

    shift: float
    sigma: float
    is_steady: bool


def _with_harmonics(peaks: list[Peak], spacing: float) -> list[Peak]:
    """Mark peaks at multiples of the frequency of a stronger or lower one."""
    roots: list[Peak] = []
    marked: dict[float, Peak] = {}
    for peak in sorted(peaks, key=lambda one: one.frequency):
        for root in roots:
            order = round(peak.frequency / root.frequency)
            allowed = max(spacing / 2, peak.uncertainty + order * root.uncertainty)
            if order >= 2 and abs(peak.frequency - order * root.frequency) <= allowed < root.frequency / 8:
                marked[peak.frequency] = Peak(
                    peak.frequency, peak.uncertainty, peak.rms, peak.above_floor, order, root.frequency, peak.aliases
                )
                break
        else:
            roots.append(peak)
            marked[peak.frequency] = peak
    return [marked[peak.frequency] for peak in peaks]
