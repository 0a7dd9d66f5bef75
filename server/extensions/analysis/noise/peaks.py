"""Peaks of a power spectral density: lines that stand out of the floor, with frequency, rms and harmonics.

The floor is the running median of the density, raised to the mean that noise of that median has. A peak is a local
maximum so far above it that hardly any spectrum of noise alone reaches it.

The frequency of a line comes from the powers beside the maximum. Its uncertainty has two parts: the lower bound for the
frequency of a sine in white noise (Rife and Boorstyn, IEEE Trans. Inf. Theory 20 (1974) 591-598), for the independent
segments that the degrees of freedom stand for and the loss of the window; and the error of the interpolation.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.server.extensions.analysis.noise.welch import Segments

MAX_PEAKS = 16
FALSE_ALARM = 1e-8  # of the limit; in simulations about 0.3 % of the spectra of white noise show a peak
FLOOR_BINS = 101  # of the running median
INTERPOLATION_ERROR = 0.02  # of the spacing of the frequencies: the error of the parabola for the windows offered
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
    for at in sorted(tops.tolist(), key=lambda one: -psd[one]):
        if len(peaks) == MAX_PEAKS:
            break
        if any(abs(at - other) <= 2 * skip for other in bins) or _on_a_slope(psd, at, skip):
            continue
        bins.append(at)
        peaks.append(_peak(frequency, psd, floor, rate, segments, freedom, at))
    return _with_harmonics(peaks, float(frequency[1]))


def _floor(psd: Floats) -> Floats:
    from scipy.ndimage import median_filter

    width = min(FLOOR_BINS, len(psd) // 2 * 2 - 1)
    floor: Floats = median_filter(psd, width, mode="nearest")
    tiny = float(psd.max()) * 1e-30 + 1e-300
    return np.maximum(floor, tiny)


def _half_width(segments: Segments) -> int:
    """Half of the main lobe of the window, in bins."""
    weights = segments.window
    bandwidth = len(weights) * float(np.square(weights).sum() / np.square(weights.sum()))
    return max(1, math.ceil(bandwidth))


def _on_a_slope(psd: Floats, at: int, width: int) -> bool:
    """Whether the density rises further beside the peak: a bump on the flank of a stronger one or of 1/f noise."""
    beside = psd[max(0, at - 2 * width) : at + 2 * width + 1]
    return bool(psd[at] < beside.max())


def _peak(
    frequency: Floats, psd: Floats, floor: Floats, rate: float, segments: Segments, freedom: float, at: int
) -> Peak:
    spacing = float(frequency[1])
    a, b, c = np.log(np.maximum(psd[at - 1 : at + 2], 1e-300))
    bend = a - 2 * b + c
    shift = float(0.5 * (a - c) / bend) if bend < 0 else 0.0
    at_frequency = (at + min(max(shift, -0.5), 0.5)) * spacing
    width = _half_width(segments) + 1
    lobe = slice(max(0, at - width), at + width + 1)
    power = max(float((psd[lobe] - floor[lobe]).sum()) * spacing, 0.0)
    noise = float(floor[at]) * rate / 2  # of the samples, were all of it as the floor
    length = segments.length
    ratio = power / noise if noise > 0 else math.inf
    bound = math.sqrt(12 / (max(ratio, 1e-9) * float(length) ** 3 * max(freedom / 2, 1))) * rate / (2 * math.pi)
    bandwidth = length * float(np.square(segments.window).sum() / np.square(segments.window.sum()))
    uncertainty = math.hypot(1.96 * bound * bandwidth**1.5, INTERPOLATION_ERROR * spacing)
    above = 10 * math.log10(float(psd[at]) / float(floor[at]))
    folded = sorted(abs(turn * rate + sign * at_frequency) for turn in (1, 2) for sign in (-1, 1))
    return Peak(at_frequency, uncertainty, math.sqrt(power), above, 1, math.nan, folded[:MAX_ALIASES])


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
