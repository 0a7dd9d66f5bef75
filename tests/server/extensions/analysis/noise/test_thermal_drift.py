"""The ± of a temperature drift, against truths of many devices, some of which break what it presumes."""

import math

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.server.extensions.analysis.methods.allan import _drift_note
from imuscope.server.extensions.analysis.noise.thermal_drift import ThermalDrift, thermal_drift

RATE, SAMPLES, TRUTHS = 10.0, 6000, 480
CONDITIONS = ("white", "walk", "pink", "lag", "noisy thermometer", "coarse thermometer", "step", "curve")


def device(condition: str, random: np.random.Generator) -> tuple[float, ThermalDrift | None]:
    """The mean slope of a device over its temperatures, and what is stated of its signal."""
    time = np.arange(SAMPLES) / RATE
    length, rise = float(time[-1]), random.uniform(1, 12)
    match random.integers(3):
        case 0:
            course = 1 - np.exp(-time / random.uniform(0.1, 0.6) / length)
        case 1:
            course = np.sin(2 * np.pi * time / length / random.uniform(0.4, 1.5) + random.uniform(0, 6.28)) / 2
        case _:
            course = np.cumsum(random.normal(size=SAMPLES))
            course /= np.ptp(course)
    degrees = 25 + rise * course
    slope, white = random.choice([-1, 1]) * 10 ** random.uniform(-2, 1), 10 ** random.uniform(-1, 1.5)
    bias, thermometer = slope * degrees, degrees
    noise = random.normal(size=SAMPLES) * white
    match condition:
        case "walk":
            noise += np.cumsum(random.normal(size=SAMPLES)) * white * 10 ** random.uniform(-3.5, -1.3)
        case "pink":
            noise += pink(random) * white * 10 ** random.uniform(-1, 0.3)
        case "step":
            noise += (time > random.uniform(0.2, 0.8) * length) * white * random.uniform(1, 5)
        case "lag":
            thermometer = delayed(degrees, random.uniform(0.002, 0.02) * SAMPLES)
        case "noisy thermometer":
            thermometer = degrees + random.normal(size=SAMPLES) * 0.3
        case "coarse thermometer":
            thermometer = np.round(degrees * 2) / 2
        case "curve":
            bias = bias + slope * random.uniform(0.02, 0.1) * (degrees - 25) ** 2
            slope = float(np.polyfit(degrees, bias, 1)[0])
    return slope, thermal_drift(time, bias + noise, [slice(0, SAMPLES)], (time, thermometer))


def pink(random: np.random.Generator) -> Floats:
    """Flicker noise."""
    frequency = np.fft.rfftfreq(SAMPLES)
    frequency[0] = frequency[1]
    shaped: Floats = np.fft.irfft(np.fft.rfft(random.normal(size=SAMPLES)) / np.sqrt(frequency), SAMPLES)
    return shaped


def delayed(values: Floats, samples: float) -> Floats:
    """Behind a first-order lag."""
    kernel = np.exp(-np.arange(int(8 * samples)) / samples)
    padded = np.concatenate([np.full(len(kernel), values[0]), values])
    result: Floats = np.convolve(padded, kernel / kernel.sum())[len(kernel) : len(kernel) + len(values)]
    return result


def test_the_stated_slope_of_200_devices_lies_within_its_interval() -> None:
    """Regression: ± was one standard deviation, and two of them held 82 % of the slopes where the bias wanders."""
    inside: dict[str, list[bool]] = {name: [] for name in CONDITIONS}
    curved = 0
    for seed in range(TRUTHS):
        condition = CONDITIONS[seed % len(CONDITIONS)]
        slope, drift = device(condition, np.random.default_rng(seed))
        if drift is not None and math.isfinite(drift.uncertainty):
            inside[condition].append(abs(drift.per_degree - slope) <= drift.uncertainty)
        curved += drift is not None and not math.isfinite(drift.uncertainty)
    every = [one for some in inside.values() for one in some]
    assert len(every) >= 200
    assert 0.93 <= np.mean(every) <= 0.99
    assert curved > 10


def test_the_slope_stands_beside_what_it_presumes() -> None:
    """A drift of its own that runs as the temperature does cannot be told apart."""
    part = np.zeros(1)
    line, curve = ThermalDrift(0.02, 0.001, 22.0, 30.0, part), ThermalDrift(0.02, math.nan, 22.0, 30.0, part)
    for is_removed in (True, False):
        assert "+0.02 ± 0.001 °/s per °C" in _drift_note(line, "°/s", is_removed)
        assert "if no other drift coincides" in _drift_note(line, "°/s", is_removed)
        assert "±" not in _drift_note(curve, "°/s", is_removed)
        assert "not along a line" in _drift_note(curve, "°/s", is_removed)
