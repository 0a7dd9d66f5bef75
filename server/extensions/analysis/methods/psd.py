"""Power spectral density by Welch's method: one-sided, with its 95 % interval, cumulative rms and peaks.

Segments lie within the runs of a signal (sampling.py), so no gap is bridged. Where there is no gap the
result equals that of scipy.signal.welch with the same options.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.server.extensions.analysis.noise.peaks import peaks_of
from imuscope.server.extensions.analysis.noise.registry import Analysis, Result, Settings, register_analysis
from imuscope.server.extensions.analysis.noise.welch import MIN_LENGTH, OPTIONS, SCALES, mean_spectrum, segments_for
from imuscope.server.extensions.analysis.signals.sampling import sampling_of, unwrapped
from imuscope.server.extensions.analysis.signals.signals import Signal

MIN_EVENNESS = 0.65  # of the segments; below, a few loud ones may lie at an edge, and count as windows weigh them
MAX_IMBALANCE = 0.2  # of half the interval: by how much windows may weigh loud parts more or less than others
TAIL_PROBABILITY = 0.025  # probability beyond each end of the interval


def run(signal: Signal, options: Settings) -> Result:
    """The spectrum of one signal; see the module docstring."""
    from scipy.special import chdtri

    sampling = sampling_of(signal, MIN_LENGTH)
    segments = segments_for(sampling, options)
    values = unwrapped(signal)
    counts = [segments.count(part.stop - part.start) for part in sampling.runs]
    mean = mean_spectrum([values[part] for part in sampling.runs], counts, sampling.rate, segments)
    frequency, psd, freedom = mean.frequency, mean.psd, mean.freedom
    low, high = (freedom / float(chdtri(freedom, p)) for p in (TAIL_PROBABILITY, 1 - TAIL_PROBABILITY))
    root = SCALES[int(options["scale"])] == "amplitude"
    spacing = sampling.rate / segments.length

    peaks = peaks_of(frequency, psd, sampling.rate, segments, freedom)
    notes = [*sampling.notes(), _alias_note(frequency, psd, sampling.rate)]
    is_unknown = mean.evenness <= MIN_EVENNESS or abs(mean.balance - 1) > MAX_IMBALANCE * (high - low) / 2
    if mean.evenness < 1 or is_unknown:
        what = "of an unknown uncertainty" if is_unknown else "whose interval is wider for it"
        notes.append(f"The noise changes in this range: the density is its mean, {what}.")
    if is_unknown:
        low = high = math.nan
    if peaks:
        apart = f"{4 * segments.resolution(sampling.rate):.3g} Hz"
        notes.append(f"The uncertainty of a frequency is that of one steady line: two within {apart} may be one.")

    def shown(power: Floats) -> Any:
        return (np.sqrt(power) if root else power).tolist()

    return {
        "frequency": frequency.tolist(),
        "psd": shown(psd),
        "low": shown(psd * low),
        "high": shown(psd * high),
        "cumulative": np.sqrt(np.cumsum(psd) * spacing).tolist(),
        "peaks": [peak.figures() for peak in peaks],
        "rate": sampling.rate,
        "resolution": segments.resolution(sampling.rate),
        "segments": sum(counts),
        "length": segments.length,
        "degrees_of_freedom": freedom,
        "jitter": sampling.jitter,
        "gaps": sampling.gaps,
        "notes": notes,
    }


def _alias_note(frequency: Floats, psd: Floats, rate: float) -> str:
    """A sentence about aliases; a density that does not fall towards half the rate makes it a warning."""
    nyquist = rate / 2
    words = f"Vibration above {nyquist:.4g} Hz, half the rate, appears below it, at its distance from a multiple"
    words += f" of {rate:.4g} Hz."
    end = psd[frequency > 0.9 * nyquist]
    middle = psd[(frequency > 0.2 * nyquist) & (frequency <= 0.9 * nyquist)]
    if len(end) and len(middle) and float(np.median(end)) > 0.5 * float(np.median(middle)):
        words += " The density does not fall towards that frequency, so the signal may hold such parts."
    return words


def _units(settings: Settings) -> Mapping[str, str]:
    density = "{unit}/√Hz" if SCALES[int(settings["scale"])] == "amplitude" else "{unit}²/Hz"
    return {
        **dict.fromkeys(("frequency", "rate", "resolution"), "Hz"),
        **dict.fromkeys(("psd", "low", "high"), density),
        **{"cumulative": "{unit}", "jitter": "s"},
        **dict.fromkeys(("peaks.frequency", "peaks.uncertainty", "peaks.harmonic_of", "peaks.aliases"), "Hz"),
        **{"peaks.rms": "{unit}", "peaks.above_floor": "dB"},
    }


register_analysis(
    Analysis(
        "psd",
        "Power spectral density",
        "one-sided density by Welch's method, its 95 % interval, cumulative rms and peaks",
        run,
        _units,
        OPTIONS,
        order=10,
    )
)
