"""The ± of the drift of a clock against another, against truths of many pairs of clocks."""

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.server.extensions.clocks.figures import FileClock, _figures
from imuscope.server.extensions.clocks.print_clocks import PRESUMES, _drift_text

CONDITIONS = ("exact", "noise", "delays", "bursts", "coarse axis", "coarse clock", "wandering", "disciplined")
CONDITIONS += ("warming", "gaps", "step", "stalls")
TRUTHS = 240


def pair(condition: str, random: np.random.Generator) -> tuple[float, Floats, Floats]:
    """Mean drift of a clock against another in ppm, and the readings of both, s."""
    rate = 10 ** random.uniform(1, 2.5)
    count = int(np.clip(rate * 10 ** random.uniform(1, 2.8), 60, 15_000))
    true, ppm = np.arange(count) / rate, random.uniform(-200, 200)
    clock, axis, length = true * (1 + 1e-6 * ppm), true.copy(), count / rate
    match condition:
        case "noise":
            axis += random.normal(size=count) * 1e-4
        case "delays":
            axis = np.maximum.accumulate(axis + random.exponential(1e-3, count))
        case "bursts":
            axis = np.ceil(axis / 0.016) * 0.016 + random.exponential(5e-5, count)
        case "coarse axis":
            axis = np.floor(axis * 1e3) / 1e3
        case "coarse clock":
            clock = np.floor(clock * 100) / 100
        case "wandering":
            axis += np.cumsum(random.normal(size=count)) * 10 ** random.uniform(-7, -5.5)
        case "disciplined":  # by NTP, to and fro
            period = random.uniform(0.3, 3) * length
            axis += random.uniform(1e-4, 3e-3) * np.sin(2 * np.pi * true / period + random.uniform(0, 6.28))
        case "warming":
            change = random.uniform(-20, 20)
            clock += 1e-6 * change / 2 * length * np.square(true / length)
            ppm += change / 2
        case "gaps":
            there = np.ones(count, bool)
            for first in random.integers(1, count, 3):
                there[first : first + count // 20] = False
            clock, axis = clock[there], axis[there] + random.normal(size=there.sum()) * 1e-4
        case "step":
            axis += random.normal(size=count) * 1e-4
            clock[random.integers(count // 4, 3 * count // 4) :] += random.uniform(0.5, 5)
        case "stalls":
            axis += random.exponential(1e-4, count)
            for first in random.integers(0, count - 5, 4):
                late = slice(first, first + int(0.3 * rate) + 2)
                axis[late] = np.maximum(axis[late], axis[first] + 0.3)
            axis = np.maximum.accumulate(axis)
    return ppm, clock, axis


def figures(clock: Floats, axis: Floats) -> FileClock:
    return _figures("clock", clock, axis + 1.7e9)


def test_the_drift_of_240_clocks_lies_within_its_uncertainty() -> None:
    """Regression: of clocks that wander 40 % of the drifts lay in intervals of 95 %: blocks are not independent."""
    inside: dict[str, list[bool]] = {condition: [] for condition in CONDITIONS}
    widths: list[float] = []
    for seed in range(TRUTHS):
        condition = CONDITIONS[seed % len(CONDITIONS)]
        ppm, clock, axis = pair(condition, np.random.default_rng(seed))
        made = figures(clock, axis)
        if made.drift_ppm is not None and made.drift_error_ppm is not None:
            inside[condition].append(abs(made.drift_ppm - ppm) <= made.drift_error_ppm)
            widths.append(made.drift_error_ppm)
    every = [one for some in inside.values() for one in some]
    assert len(every) > 200
    assert 0.93 <= np.mean(every) <= 0.99
    assert min(np.mean(some) for some in inside.values()) >= 0.85
    assert np.median(widths) < 5


def test_a_delay_that_grows_is_presumed_not_to_be() -> None:
    """It is a drift of the clock as far as the readings show: words beside ± say so."""
    _, clock, axis = pair("noise", np.random.default_rng(1))
    growing = figures(clock, axis + np.linspace(0, 0.01, len(axis)))
    assert growing.drift_error_ppm is not None
    assert "±" in _drift_text(growing.drift_ppm, growing.drift_error_ppm)
    assert "delay" in PRESUMES
