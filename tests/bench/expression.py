"""Benchmark of expressions over an hour of 1 kHz.

    python tests/bench/expression.py [--minutes 60] [--save]

The samples are in memory. Each expression has three operations; a vector counts as one signal of three columns.

Budget (2 cores): ≥ 20 million samples a second of a signal.
"""

from __future__ import annotations

import sys

import numpy as np

from imuscope.protocols.schema.units import Unit
from imuscope.server.extensions.analysis.expressions.expression_functions import Context
from imuscope.server.extensions.analysis.expressions.expression_syntax import parse
from imuscope.server.extensions.analysis.expressions.expressions import evaluate
from imuscope.server.extensions.analysis.signals.quantities import Quantity
from tests.bench.analysis import RATE, best_s
from tests.bench.support.report import report

TEXTS = {
    "comparison": "Acc.x * 2 + 1 m/s² > 3 g",
    "arithmetic": "abs(Acc.x) * 2 - 1 m/s²",
    "vector": "norm(Acc) - 1 g > 3 g",
}


def main() -> None:
    """Run the benchmark."""
    minutes = float(sys.argv[sys.argv.index("--minutes") + 1]) if "--minutes" in sys.argv else 60.0
    n, unit = int(minutes * 60 * RATE), Unit.parse("m/s²")
    time = 1.76e9 + np.arange(n) / RATE
    columns = tuple(np.random.default_rng(seed).normal(0, 3, n) for seed in range(3))
    known = {"Acc": Quantity(columns, unit, time, ("x", "y", "z")), "Acc.x": Quantity(columns[:1], unit, time)}
    results = {}
    for name, text in TEXTS.items():
        node = parse(text)
        batch = best_s(lambda: evaluate(node, known.__getitem__, Context(zero_phase=True)), 9)  # noqa: B023
        results[f"{name}_million_per_s"] = n / batch / 1e6
    report("expression", {"minutes": minutes, **results})


if __name__ == "__main__":
    main()
