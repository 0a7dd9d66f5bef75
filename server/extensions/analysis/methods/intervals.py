"""Intervals in which a condition is true: an expression with a comparison, such as `norm(Acceleration) > 3 g`.

An interval begins at the first sample at which the condition is true and ends at the last one before it is false. A
request gets a page of them: those that begin after one time and before another, from either end.
"""

import numpy as np

from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.noise.registry import (
    Analysis,
    AnalysisOption,
    Result,
    Settings,
    choice,
    register_analysis,
)
from imuscope.server.extensions.analysis.signals.signals import Signal

MAX_TIME = 9e9  # unix s
DESCENDING = 1.0


def run(signal: Signal, options: Settings) -> Result:
    """Begins and ends, their number, and the number of samples at which the condition is true.

    Raises:
        DomainError: "bad-expression": the signal is not a condition.
    """
    is_true = signal.values == 1.0
    if not np.all(is_true | (signal.values == 0.0)):
        hint = f"Compare it with a value, for example {signal.name:.40} > 3{f' {signal.unit}' if signal.unit else ''}."
        raise DomainError("bad-expression", f"{signal.name:.80} is a signal, no condition.", hint)
    edges = np.diff(is_true.astype(np.int8), prepend=0, append=0)
    begins, ends = signal.time[np.flatnonzero(edges == 1)], signal.time[np.flatnonzero(edges == -1) - 1]
    is_within = (begins > options["after"]) & (begins < options["before"])
    begins, ends = begins[is_within], ends[is_within]
    total = len(begins)
    if options["order"] == DESCENDING:
        begins, ends = begins[::-1], ends[::-1]
    page = slice(int(options["offset"]), int(options["offset"]) + int(options["limit"]))
    return {
        "total": total,
        "begin": begins[page].tolist(),
        "end": ends[page].tolist(),
        "samples": int(np.count_nonzero(is_true)),
    }


register_analysis(
    Analysis(
        "intervals",
        "Intervals",
        "intervals in which a condition is true",
        run,
        {"begin": "s", "end": "s"},
        (
            AnalysisOption("after", -MAX_TIME, -MAX_TIME, MAX_TIME, "s", "Only intervals that begin after this time."),
            AnalysisOption("before", MAX_TIME, -MAX_TIME, MAX_TIME, "s", "Only intervals that begin before this time."),
            choice("order", ("ascending", "descending"), "From the first one on, or from the last one back."),
            AnalysisOption("offset", 0.0, 0.0, 1e9, doc="Intervals to skip."),
            AnalysisOption("limit", 100.0, 1.0, 1000.0, doc="Intervals to give at most."),
        ),
        order=6,
    )
)
