"""Segments, windows and confidence of Welch's method, as used by spectra.

Sources: P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70-73, for the variance of overlapping segments.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.noise.registry import AnalysisOption, choice
from imuscope.server.extensions.analysis.signals.sampling import Sampling

WINDOWS = ("hann", "hamming", "blackmanharris", "flattop", "boxcar")
DETRENDING = ("constant", "linear", "none")
SCALES = ("power", "amplitude")
AUTOMATIC_SEGMENTS = 8  # of the automatic length, at half overlap
MIN_LENGTH, MAX_LENGTH = 16, 1 << 16
BLOCK_SAMPLES = 1 << 18  # samples transformed together
EDGE_BINS = 3  # beside 0 Hz, where the trend was taken out
CHANCE_SIGMAS = 3.0  # of the mean of the ratios of as many bins

OPTIONS = (
    AnalysisOption("length", 0, 0, 1 << 22, "samples", "Length of a segment; 0 chooses one."),
    AnalysisOption("overlap", 0.5, 0, 0.95, "", "Part of a segment that it shares with the next."),
    choice("window", WINDOWS, "Window of a segment."),
    choice("detrend", DETRENDING, "Trend that is subtracted from each segment."),
    choice("scale", SCALES, "amplitude is the root of power."),
)


@dataclass(frozen=True, slots=True)
class Segments:
    """Division of a signal into segments.

    Attributes:
        length: samples of a segment.
        step: samples from the beginning of one segment to that of the next.
        window: (length,) weights.
        detrend: as scipy takes it.
    """

    length: int
    step: int
    window: Floats
    detrend: str | bool

    def count(self, n: int) -> int:
        """Number of segments in a run of n samples."""
        return 0 if n < self.length else (n - self.length) // self.step + 1

    def resolution(self, rate: float) -> float:
        """Equivalent noise bandwidth of the window, Hz."""
        return rate * float(np.square(self.window).sum() / np.square(self.window.sum()))

    def degrees_of_freedom(self, counts: Sequence[int]) -> float:
        """Of the mean of the segments of several runs; overlapping segments are correlated (Welch 1967)."""
        energy = float(np.square(self.window).sum())
        shared = []
        for shift in range(self.step, self.length, self.step):
            shared.append((float(np.dot(self.window[shift:], self.window[:-shift])) / energy) ** 2)
        total = sum(counts)
        variance = sum(
            count + 2 * sum((count - n) * one for n, one in enumerate(shared, 1) if n < count) for count in counts
        )
        return 2 * total * total / variance


def segments_for(sampling: Sampling, settings: Mapping[str, float], count: int = AUTOMATIC_SEGMENTS) -> Segments:
    """Segments for a signal.

    Args:
        count: number of segments of the automatic length.

    Raises:
        DomainError: "no-result": no run is as long as a segment.
    """
    from scipy.signal import get_window

    longest = sampling.longest
    total = sum(run.stop - run.start for run in sampling.runs)
    length = int(settings["length"])
    if not length:
        length = 1 << max(0, int(math.log2(2 * total / (count + 1))))
        length = max(MIN_LENGTH, min(length, MAX_LENGTH, 1 << int(math.log2(longest))))
    if not 2 <= length <= longest:
        hint = "Request a longer range, or give a shorter length."
        message = (
            f"A segment of {length} samples does not fit; {longest} samples are the longest stretch without a gap."
        )
        raise DomainError("no-result", message, hint)
    step = max(1, length - int(length * settings["overlap"]))
    window = get_window(WINDOWS[int(settings["window"])], length)
    detrend = DETRENDING[int(settings["detrend"])]
    return Segments(length, step, window, False if detrend == "none" else detrend)


@dataclass(frozen=True, slots=True)
class MeanSpectrum:
    """Mean over all segments of all runs.

    Attributes:
        frequency, psd: (n,), one-sided.
        freedom: degrees of freedom of each density.
        evenness: 1 if all segments are alike but for chance; less where few of them make up the mean, as the noise
            changes. The degrees of freedom are fewer by its square, for it is an estimate itself.
        balance: power of the differences from sample to sample as the windows weigh them, by that of all alike: not 1
            where loud parts lie at edges of segments, or in their middle.
    """

    frequency: Floats
    psd: Floats
    freedom: float
    evenness: float
    balance: float


def mean_spectrum(runs: list[Floats], counts: list[int], rate: float, segments: Segments) -> MeanSpectrum:
    """The mean spectrum of these runs, with `counts` segments in each."""
    from scipy.fft import rfft, rfftfreq
    from scipy.signal import detrend

    sums, squares = np.zeros((2, segments.length // 2 + 1))
    changes, steps = 0.0, 0
    together = max(1, BLOCK_SAMPLES // segments.length)
    for values, count in zip(runs, counts, strict=True):
        if not count:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(values, segments.length)[:: segments.step]
        differences = np.diff(values)
        changes, steps = changes + float(np.dot(differences, differences)), steps + len(differences)
        for begin in range(0, count, together):
            block = windows[begin : min(begin + together, count)]
            if segments.detrend == "constant":
                block = block - block.mean(axis=1, keepdims=True)
            elif segments.detrend:
                block = detrend(block, axis=1, type=segments.detrend)
            parts = rfft(block * segments.window, axis=1).view(np.float64)
            powers = np.square(parts[:, 0::2]) + np.square(parts[:, 1::2])
            sums += powers.sum(axis=0)
            squares += np.einsum("ij,ij->j", powers, powers)
    power = sums / (sum(counts) * rate * float(np.square(segments.window).sum()))
    power[1 : (segments.length + 1) // 2] *= 2  # one-sided; 0 Hz and half the rate have no other side
    freedom = segments.degrees_of_freedom([count for count in counts if count])
    inner = slice(EDGE_BINS, -1)  # of noise as even as chance the square of a power has twice the mean of its own
    ratios = sum(counts) * squares[inner] / np.maximum(np.square(sums[inner]), 1e-300)
    excess = float(ratios.mean()) * (freedom / 2 + 1) / freedom if len(ratios) else 1.0
    evenness = 1.0 if excess < 1 + CHANCE_SIGMAS / math.sqrt(max(len(ratios), 1)) else 1 / excess
    frequency = rfftfreq(segments.length, 1 / rate)
    turned = float(np.dot(power, 2 - 2 * np.cos(2 * np.pi * frequency / rate))) * rate / segments.length
    is_weighed = changes > 0 and segments.window.min() < segments.window.max()
    balance = turned * steps / changes if is_weighed else 1.0  # the differences, as the windows let them through
    return MeanSpectrum(frequency, power, freedom * evenness**2, evenness, balance)
