"""The ± of the drift of a clock against another, against truths of many pairs of clocks."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from imuscope.protocols.arrays import Floats
from imuscope.protocols.clocks.clock_sync import ClockSync
from imuscope.server.extensions.clocks import figures as clock_figures
from imuscope.server.extensions.clocks.figures import FileClock, _figures
from imuscope.server.extensions.clocks.print_clocks import PRESUMES, _drift_text

CONDITIONS = ("exact", "noise", "delays", "bursts", "coarse axis", "coarse clock", "wandering", "disciplined")
CONDITIONS += ("warming", "gaps", "step", "stalls")
TRUTHS = 240
EPOCH_NS, SIZE, BYTE_NS = 17 * 10**17, 60, 10_850


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


LINKS = ("free", "unknown grid", "known timer", "network", "stalls")


def mapped(link: str, random: np.random.Generator) -> tuple[float, Floats, Floats, list[float | None]]:
    """Drift of a device in ppm, its clock, the axis mapped by arrivals, and the ± of its times in ms."""
    rate, length = float(random.choice([100, 200, 400])), 10 ** random.uniform(1.2, 2.2)
    true, ppm = np.arange(int(rate * length)) / rate + random.uniform(0, 0.01), random.uniform(-100, 100)
    device = (np.floor((true * (1 + 1e-6 * ppm) + 5) * 1e4) * 1e5).astype(np.int64)
    end, wait = true + SIZE * BYTE_NS * 1e-9, random.exponential(3e-3 if link == "network" else 5e-5, len(true))
    match link:
        case "unknown grid" | "known timer":
            period = 0.016 if link == "known timer" else random.choice([0.004, 0.01, 0.02])
            end = np.ceil(end / period) * period
        case "stalls":
            for first in random.integers(0, len(end), 3):
                late = slice(first, first + int(rate / 2))
                end[late] = np.maximum(end[late], end[first] + 0.5)
    arrival = np.maximum.accumulate(end + wait)
    clock = ClockSync(BYTE_NS, holds_ns=16e6 * (link == "known timer"), unknown_ns=1e6 * (link == "network"))
    bounds: list[float | None] = []
    axis = []
    ends = [*(np.flatnonzero(np.diff(np.floor(arrival))) + 1).tolist(), len(arrival)]
    for first, last in zip([0, *ends[:-1]], ends, strict=True):
        axis.append(clock.add(device[first:last], (arrival[first:last] * 1e9).astype(np.int64) + EPOCH_NS, SIZE))
        bounds.append(clock.uncertainty_ns / 1e6)
    return ppm, device / 1e9, (np.concatenate(axis) - EPOCH_NS) / 1e9, bounds


def test_the_drift_of_a_device_lies_within_the_uncertainty_of_an_axis_mapped_by_arrivals(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It is a bound: what delays all frames alike is in ± of the times, and not in their rate."""
    for seed in range(200):
        ppm, clock, axis, bounds = mapped(LINKS[seed % len(LINKS)], np.random.default_rng(seed))
        monkeypatch.setattr(clock_figures, "health_history", lambda *_, b=bounds: SimpleNamespace(uncertainty_ms=b))
        store: Any = SimpleNamespace(manifest={"health": {"1": "1"}}, folder=None)
        made, error = figures(clock, axis), clock_figures._axis_error_ppm(store, "1", axis)
        assert made.drift_ppm is not None
        assert made.drift_error_ppm is not None
        assert abs(made.drift_ppm - ppm) <= np.hypot(made.drift_error_ppm, error)


def test_a_delay_that_grows_is_presumed_not_to_be() -> None:
    """It is a drift of the clock as far as the readings show: words beside ± say so."""
    _, clock, axis = pair("noise", np.random.default_rng(1))
    growing = figures(clock, axis + np.linspace(0, 0.01, len(axis)))
    assert growing.drift_error_ppm is not None
    assert "±" in _drift_text(growing.drift_ppm, growing.drift_error_ppm)
    assert "delay" in PRESUMES
