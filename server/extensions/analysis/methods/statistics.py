"""Statistics of a signal: mean, spread, extremes, slope, integral, rate and gaps.

An angle that wraps has a circular mean and σ (recordings/columns/statistics.py). It is unwrapped for slope, peak to
peak and the ends `min` and `max` of the arc that it covers (none if it goes all the way round), and has no rms and no
integral. `slope` is that of the least-squares line, `integral` by the trapezoidal rule over the sample times, so both
hold for unevenly spaced samples. Where the clock steps (recordings/tables/clocks/steps.py) neither goes across.
"""

import itertools
from collections.abc import Mapping

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.recordings.columns.breaks import gaps_in
from imuscope.recordings.columns.statistics import statistics_of
from imuscope.server.extensions.analysis.noise.registry import Analysis, Result, register_analysis
from imuscope.server.extensions.analysis.signals.signals import Signal

NAN = float("nan")


def run(signal: Signal, options: Mapping[str, float]) -> Result:
    """The figures of one signal; see the module docstring."""
    time, values = signal.time, signal.values
    plain = statistics_of(lambda: iter((values,)), signal.period)
    runs = [slice(*edges) for edges in itertools.pairwise([0, *signal.begins.tolist(), len(time)])]
    duration = float(sum(time[run][-1] - time[run][0] for run in runs))
    longest = max(runs, key=lambda run: run.stop - run.start)
    unwrapped = np.unwrap(values, period=signal.period) if signal.period else values
    low, high = _arc(unwrapped, signal.period) if signal.period else (plain.min, plain.max)
    return {
        "n": plain.n,
        "mean": plain.mean,
        "sigma": plain.sigma,
        "rms": NAN if signal.period else float(np.sqrt(np.square(values).mean())),
        "min": low,
        "max": high,
        "peak_to_peak": float(np.ptp(unwrapped)),
        "slope": slope(time[longest], unwrapped[longest]),
        "integral": NAN if signal.period else float(sum(np.trapezoid(values[run], time[run]) for run in runs)),
        "duration": duration,
        "rate": (plain.n - len(runs)) / duration if duration > 0 else NAN,
        "gaps": len(np.setdiff1d(gaps_in(time), signal.begins)),
        **({"notes": [_segments_note(len(runs))]} if len(runs) > 1 else {}),
    }


def _segments_note(segments: int) -> str:
    return (
        f"The clock steps, so there are {segments} segments: duration and integral are sums of them, and slope is that "
        "of the longest; nothing is computed across a step."
    )


def _arc(unwrapped: Floats, period: float) -> tuple[float, float]:
    """Both ends of the arc of an angle, in −period/2 to period/2; NaN if it goes all the way round."""
    low, high = float(unwrapped.min()), float(unwrapped.max())
    if high - low >= period:
        return NAN, NAN
    return low - period * round(low / period), high - period * round(high / period)


def slope(time: Floats, values: Floats) -> float:
    """Slope of the least-squares line, per second; NaN if all samples share one time."""
    t = time - time.mean()
    square = float(np.dot(t, t))
    return float(np.dot(t, values - values.mean())) / square if square > 0 else NAN


SAME = "{unit}"
register_analysis(
    Analysis(
        "statistics",
        "Statistics",
        "mean, spread, extremes, slope, integral, rate and gaps",
        run,
        {
            **dict.fromkeys(("mean", "sigma", "rms", "min", "max", "peak_to_peak"), SAME),
            "slope": "{unit}/s",
            "integral": "{unit}·s",
            "duration": "s",
            "rate": "Hz",
        },
        order=0,
    )
)
