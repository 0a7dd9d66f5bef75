"""Benchmark of the analyses of an hour of 1 kHz, six signals.

    python tests/bench/analysis.py [--minutes 60] [--save]

The samples are those of one device at rest, with its temperature, in memory; decoding is tests/bench/opening.py's.
Processor seconds of an Allan deviation, one axis after the other, stand beside its time: they depend less on what else
runs. The yardstick, in the same run, is the sum of the same samples' squares by numpy, ten times.

Budgets (2 cores): Allan deviation of six axes ≤ 2 s, PSD ≤ 1 s.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from imuscope.server.extensions.analysis.noise.registry import analysis_named
from imuscope.server.extensions.analysis.noise.report import figures_of, in_parallel
from imuscope.server.extensions.analysis.signals.companions import Companions
from imuscope.server.extensions.analysis.signals.signals import Signal
from imuscope.server.extensions.analysis.signals.triads import Samples
from tests.bench.support.report import report

RATE = 1000.0
AXES = 6
G = 9.80665


def signals(minutes: float) -> list[Signal]:
    """Noise of a good gyroscope and accelerometer, three axes each; their companions are looked at as by a request."""
    n = int(minutes * 60 * RATE)
    time_of = 1.76e9 + np.arange(n) / RATE
    draws = [np.random.default_rng(seed).normal(0, 0.3 if seed < 3 else 0.02, n) for seed in range(AXES)]
    draws[5] += G
    gyroscope, accelerometer = (Samples(time_of, np.stack(axes, axis=1)) for axes in (draws[:3], draws[3:]))
    beside = Companions(gyroscope, accelerometer)
    warmth = time_of[::10], np.random.default_rng(AXES).normal(40, 0.05, len(time_of[::10]))
    units = ["°/s"] * 3 + ["m/s²"] * 3
    return [
        Signal(f"{seed}", unit, 0.0, time_of, values, temperature=lambda: warmth, companions=lambda: beside)
        for seed, (unit, values) in enumerate(zip(units, draws, strict=True))
    ]


def best_s(work: Callable[[], Any], turns: int = 3, clock: Callable[[], float] = time.perf_counter) -> float:
    """Shortest time of some turns: the machine may be busy with something else."""
    times = []
    for _ in range(turns):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times)


def main() -> None:
    """Run the benchmark."""
    minutes = float(sys.argv[sys.argv.index("--minutes") + 1]) if "--minutes" in sys.argv else 60.0
    rows = signals(minutes)
    results = {}
    for name in ("allan", "psd", "spectrogram", "statistics"):
        analysis = analysis_named(name)
        settings = analysis.settings({})

        def work(how: Callable[..., Any] = in_parallel) -> Any:
            for one in rows:  # each request reads its companions anew
                beside = one.companions() if one.companions else Companions()
                beside.__dict__.pop("moving", None)
                beside.__dict__.pop("steps", None)
            return how(lambda one: figures_of(analysis, one, settings), rows)  # noqa: B023

        results[f"{name}_s"] = best_s(work)
        if name == "allan":
            results["allan_processor_s"] = best_s(
                lambda: work(lambda do, all_: list(map(do, all_))), clock=time.process_time
            )
    results["yardstick_s"] = best_s(lambda: [float(np.einsum("i,i", one.values, one.values)) for one in rows * 10])
    report("analysis", {"minutes": minutes, "signals": AXES, **results})


if __name__ == "__main__":
    main()
