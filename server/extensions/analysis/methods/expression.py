"""Samples of a signal or of an expression, as they are: for programs, and to see what an expression gives."""

from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.noise.registry import Analysis, Result, Settings, register_analysis
from imuscope.server.extensions.analysis.signals.signals import Signal

MAX_SAMPLES = 1_000_000


def run(signal: Signal, options: Settings) -> Result:
    """Times and values.

    Raises:
        DomainError: "too-many": more than MAX_SAMPLES.
    """
    n = len(signal.time)
    if n > MAX_SAMPLES:
        hint = f"Request a shorter range, or resample it; at most {MAX_SAMPLES:,} are given.".replace(",", " ")
        raise DomainError("too-many", f"{signal.name} has {n} samples in that range.", hint)
    return {"time": signal.time.tolist(), "values": signal.values.tolist(), "n": n}


register_analysis(
    Analysis(
        "expression",
        "Expression",
        "samples of a signal or an expression",
        run,
        {"time": "s", "values": "{unit}"},
        order=5,
    )
)
