"""Spectrogram: power spectral densities of successive segments, on the time axis of the samples.

Segments lie within the runs of a signal (server/extensions/analysis/signals/sampling.py): in a gap there is no column.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.server.extensions.analysis.noise.registry import (
    Analysis,
    AnalysisOption,
    Result,
    Settings,
    register_analysis,
)
from imuscope.server.extensions.analysis.noise.welch import MIN_LENGTH, OPTIONS, SCALES, Segments, segments_for
from imuscope.server.extensions.analysis.signals.sampling import sampling_of, unwrapped
from imuscope.server.extensions.analysis.signals.signals import Signal

MAX_CELLS = 1_000_000  # of the result, which is 20 MB as text


def run(signal: Signal, options: Settings) -> Result:
    """The spectrogram of one signal; see the module docstring."""
    from scipy.signal import detrend

    sampling = sampling_of(signal, MIN_LENGTH)
    total = sum(part.stop - part.start for part in sampling.runs)
    segments = segments_for(sampling, options, math.isqrt(total))  # as fine in time as in frequency
    values = unwrapped(signal)
    begins = _begins(sampling.runs, segments)
    limit = int(min(options["columns"], MAX_CELLS // (segments.length // 2 + 1)))
    thinned = max(1, -(-len(begins) // limit))
    chosen = begins[::thinned]
    scale = 2 / (sampling.rate * float(np.square(segments.window).sum()))
    power = np.empty((len(chosen), segments.length // 2 + 1))
    for row, begin in enumerate(chosen):
        part: Floats = values[begin : begin + segments.length]
        if segments.detrend:
            part = detrend(part, type=segments.detrend)
        power[row] = np.square(np.abs(np.fft.rfft(part * segments.window))) * scale
    power[:, 0] /= 2
    if segments.length % 2 == 0:
        power[:, -1] /= 2
    notes = sampling.notes()
    if thinned > 1:
        notes.append(f"One of {thinned} segments is shown; request a shorter range for all.")
    first = np.array(chosen)
    centres = (signal.time[first] + signal.time[first + segments.length - 1]) / 2
    root = SCALES[int(options["scale"])] == "amplitude"
    shown: Any = np.sqrt(power) if root else power
    return {
        "time": centres.tolist(),
        "frequency": np.fft.rfftfreq(segments.length, 1 / sampling.rate).tolist(),
        "psd": shown.tolist(),
        "rate": sampling.rate,
        "resolution": segments.resolution(sampling.rate),
        "length": segments.length,
        "step": segments.step * thinned,
        "gaps": sampling.gaps,
        "jitter": sampling.jitter,
        "notes": notes,
    }


def _begins(runs: Any, segments: Segments) -> list[int]:
    """Index of the first sample of each segment."""
    return [run.start + n * segments.step for run in runs for n in range(segments.count(run.stop - run.start))]


def _units(settings: Settings) -> Mapping[str, str]:
    density = "{unit}/√Hz" if SCALES[int(settings["scale"])] == "amplitude" else "{unit}²/Hz"
    return {"time": "s", **dict.fromkeys(("frequency", "rate", "resolution"), "Hz"), "psd": density, "jitter": "s"}


register_analysis(
    Analysis(
        "spectrogram",
        "Spectrogram",
        "power spectral density over time",
        run,
        _units,
        (*OPTIONS, AnalysisOption("columns", 1000, 1, 20000, "segments", "Most segments in the result.")),
        order=20,
    )
)
