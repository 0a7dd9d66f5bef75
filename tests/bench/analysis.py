"""Benchmark of the analyses of an hour of 1 kHz, six signals.

    python tests/bench/analysis.py [--minutes 60] [--save]

The samples are in memory; decoding is tests/bench/opening.py's. The yardstick, in the same run, is the sum of the same
samples' squares by numpy, ten times.

Budgets (2 cores): Allan deviation of six axes ≤ 2 s, PSD ≤ 1 s.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from server.analysis.registry import analysis_named  # noqa: E402
from server.analysis.report import figures_of, in_parallel  # noqa: E402
from server.analysis.signals import Signal  # noqa: E402
from tests.bench.report import report  # noqa: E402

RATE = 1000.0
AXES = 6


def signals(minutes: float) -> list[Signal]:
    """Noise of a good gyroscope, each with another seed."""
    n = int(minutes * 60 * RATE)
    time_of = 1.76e9 + np.arange(n) / RATE
    draws = [np.random.default_rng(seed).normal(0, 0.3, n) for seed in range(AXES)]
    return [Signal(f"Gyroscope.{seed}", "°/s", 0.0, time_of, values) for seed, values in enumerate(draws)]


def best_s(work: Callable[[], Any], turns: int = 3) -> float:
    """Shortest time of some turns: the machine may be busy with something else."""
    times = []
    for _ in range(turns):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    """Run the benchmark."""
    minutes = float(sys.argv[sys.argv.index("--minutes") + 1]) if "--minutes" in sys.argv else 60.0
    rows = signals(minutes)
    found = {}
    for name in ("allan", "psd", "spectrogram", "statistics"):
        analysis = analysis_named(name)
        settings = analysis.settings({})
        found[f"{name}_s"] = best_s(lambda: in_parallel(lambda one: figures_of(analysis, one, settings), rows))  # noqa: B023
    found["yardstick_s"] = best_s(lambda: [float(np.einsum("i,i", one.values, one.values)) for one in rows * 10])
    report("analysis", {"minutes": minutes, "signals": AXES, **found})


if __name__ == "__main__":
    main()
