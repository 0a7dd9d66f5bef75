"""Histogram of a signal: counts and density in bins of one width, and the normal distribution with the same mean and σ.

Without a number of bins their width is that of Freedman and Diaconis (1981), 2 · IQR / ∛n, as numpy's "fd" computes it;
where the middle half of the samples has one value, that of Scott. Samples beyond a given range are counted, not shown.
An angle that wraps is turned by whole turns to lie within half a turn of its mean.
"""

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.recordings.columns.statistics import statistics_of
from imuscope.server.extensions.analysis.noise.registry import (
    Analysis,
    AnalysisOption,
    Result,
    Settings,
    register_analysis,
)
from imuscope.server.extensions.analysis.signals.signals import Signal

MOST_BINS = 2000
MAX_RANGE = 1e15


def run(signal: Signal, options: Settings) -> Result:
    """The histogram of one signal; see the module docstring."""
    statistics = statistics_of(lambda: iter((signal.values,)), signal.period)
    values = _around(signal.values, statistics.mean, signal.period)
    low, high = options["low"], options["high"]
    least, greatest = float(values.min()), float(values.max())
    if options["within"]:
        reach = options["within"] * statistics.sigma
        low, high = max(least, statistics.mean - reach), min(greatest, statistics.mean + reach)
    elif low == high == 0.0:
        low, high = least, greatest
    within = values[(values >= low) & (values <= high)] if least < low or greatest > high else values
    notes = []
    if low >= high:  # one value only, or a range without a width
        low, high = low - 0.5, low + 0.5
    bins = int(options["bins"]) or _usual_bins(within, high - low)
    if bins > MOST_BINS:
        notes.append(f"{bins} bins would be too many: {MOST_BINS} are shown.")
        bins = MOST_BINS
    counts, edges = np.histogram(within, bins, (low, high))
    width = (high - low) / bins
    return {
        "edges": edges.tolist(),
        "counts": counts.tolist(),
        "density": (counts / (len(values) * width)).tolist(),
        "n": len(values),
        "below": int(np.count_nonzero(values < low)),
        "above": int(np.count_nonzero(values > high)),
        "mean": statistics.mean,
        "sigma": statistics.sigma,
        "min": least,
        "max": greatest,
        "at_min": int(np.count_nonzero(values == least)),
        "at_max": int(np.count_nonzero(values == greatest)),
        "width": width,
        "notes": notes,
    }


def _around(values: Floats, mean: float, period: float) -> Floats:
    """Angles within half a turn of their mean."""
    return values - period * np.round((values - mean) / period) if period else values


def _usual_bins(values: Floats, span: float) -> int:
    """Number of bins over `span` by the rule of Freedman and Diaconis, or that of Scott."""
    n = len(values)
    if n < 2:
        return 1
    quarter, three = np.percentile(values, (25, 75))
    width = 2.0 * float(three - quarter) / n ** (1 / 3)
    if width <= 0:
        width = (24 * np.sqrt(np.pi) / n) ** (1 / 3) * float(values.std())
    return max(1, int(np.ceil(span / width))) if width > 0 else 1


SAME = "{unit}"
register_analysis(
    Analysis(
        "histogram",
        "Histogram",
        "counts and density of the values, mean, σ, and what lies outside",
        run,
        {
            **dict.fromkeys(("edges", "mean", "sigma", "min", "max", "width"), SAME),
            "density": "1/{unit}",
        },
        (
            AnalysisOption("bins", 0.0, 0.0, MOST_BINS, doc="Number of bins; 0: by the rule of Freedman and Diaconis."),
            AnalysisOption("within", 0.0, 0.0, 100.0, doc="Values up to this many σ from the mean; 0: all values."),
            AnalysisOption(
                "low", 0.0, -MAX_RANGE, MAX_RANGE, doc="Least value shown; with high 0 as well: all values."
            ),
            AnalysisOption("high", 0.0, -MAX_RANGE, MAX_RANGE, doc="Greatest value shown."),
        ),
        order=2,
    )
)
