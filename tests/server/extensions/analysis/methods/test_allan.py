"""Allan deviation: against NIST's figures, allantools and noise of known parameters; motion and gaps are left out."""

import itertools
import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.arrays import Floats
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.noise.allan_deviation import allan_curve, averaging_lengths
from imuscope.server.extensions.analysis.noise.noise_model import fit_noise
from imuscope.server.extensions.analysis.noise.registry import analysis_named
from imuscope.server.extensions.analysis.noise.report import figures_of
from imuscope.server.extensions.analysis.signals.signals import Signal, SignalColumn, temperature_of
from imuscope.server.wire import ChannelInfo, ColumnInfo
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

GOLDEN = json.loads((ROOT / "tests" / "golden" / "analysis" / "allan.json").read_text())
START = 1_760_000_000.0


def pseudo_random(n: int) -> Floats:
    """Numbers of the generator in NIST SP 1065, 12.4."""
    state, result = 1234567890, []
    for _ in range(n):
        result.append(state / 2147483647)
        state = 16807 * state % 2147483647
    return np.array(result)


def samples(name: str) -> Floats:
    if name == "nist_1000":
        return pseudo_random(1000)
    numbers = pseudo_random(20000)
    walk: Floats = np.cumsum(numbers - 0.5) * 0.01 + (numbers[::-1] - 0.5)
    return walk


def signal(values: Floats, rate: float, time: Floats | None = None) -> Signal:
    times = np.arange(len(values)) / rate if time is None else time
    return Signal("Gyroscope.x", "°/s", 0.0, START + times, np.asarray(values, np.float64))


def analysed(of: Signal, **options: Any) -> dict[str, Any]:
    analysis = analysis_named("allan")
    return figures_of(analysis, of, analysis.settings(options))[0]


def test_figures_of_nist() -> None:
    thousand = allan_curve([pseudo_random(1000)], 1.0, [1, 10, 100])
    assert thousand.adev == pytest.approx([2.922319e-01, 9.159953e-02, 3.241343e-02], rel=1e-6)  # SP 1065, table 31
    nine = np.array([892, 809, 823, 798, 671, 644, 883, 903, 677.0])
    assert allan_curve([nine], 1.0, [1, 2]).adev == pytest.approx([91.22945, 85.95287], rel=1e-6)


@each_row("case", GOLDEN["cases"], ids=lambda case: case["name"])
def test_figures_of_allantools(case: dict[str, Any]) -> None:
    curve = allan_curve([samples(case["name"])], case["rate"], case["m"])
    assert curve.adev == pytest.approx(case["adev"], rel=1e-9)


def slow_deviation(runs: list[list[float]], m: int) -> float:
    """The definition, term by term: differences of the means of neighbouring stretches, in runs."""
    squares = []
    for run in runs:
        for begin in range(len(run) - 2 * m + 1):
            first = math.fsum(run[begin : begin + m]) / m
            second = math.fsum(run[begin + m : begin + 2 * m]) / m
            squares.append((second - first) ** 2)
    return math.sqrt(math.fsum(squares) / len(squares) / 2)


@given(st.lists(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=30), min_size=1, max_size=4), st.integers(1, 6))
def test_the_definition_in_runs(runs: list[list[float]], m: int) -> None:
    if max(map(len, runs)) < 2 * m:
        runs.append([1.0] * m + [2.0] * m)
    curve = allan_curve([np.array(run) for run in runs], 10.0, [m])
    scale = max(abs(value) for run in runs for value in run)
    assert curve.adev[0] == pytest.approx(slow_deviation(runs, m), rel=1e-9, abs=1e-9 * scale)
    assert curve.tau[0] == pytest.approx(m / 10)


def test_averaging_times_are_spaced_evenly_up_to_a_quarter() -> None:
    assert averaging_lengths(4, 8) == [1]
    assert averaging_lengths(1000, 1) == [1, 16, 250]
    results = averaging_lengths(1_000_000, 8)
    assert results[0] == 1
    assert results[-1] == 250_000
    ratios = [b / a for a, b in itertools.pairwise(results) if a > 50]
    assert max(ratios) < 1.36
    assert min(ratios) > 1.3


def noise(n: int, rate: float, density: float, walk: float, seed: int) -> Floats:
    """White noise of a density, unit/√Hz, and a random walk of its rate, unit/s/√Hz."""
    draw = np.random.default_rng(seed)
    values: Floats = draw.normal(0, density * math.sqrt(rate), n) + np.cumsum(draw.normal(0, walk / math.sqrt(rate), n))
    return values


@each_row(("density", "walk"), [(0.01, 0.0), (0.01, 1e-3), (2.0, 0.3)])
def test_the_parameters_of_known_noise_lie_in_their_intervals(density: float, walk: float) -> None:
    truth = {"random_walk": density, "rate_random_walk": walk, "quantisation": 0.0, "bias_instability": 0.0}
    outside, walks = 0, []
    for seed in range(10):
        result = analysed(signal(noise(60_000, 100.0, density, walk, seed), 100.0))["parameters"]
        outside += sum(not result[name]["low"] <= value <= result[name]["high"] for name, value in truth.items())
        assert result["random_walk"]["value"] == pytest.approx(density, rel=0.03)
        walks.append(result["rate_random_walk"]["value"])
    assert outside <= 4  # of 40 intervals of 95 %
    assert np.median(walks) == pytest.approx(walk, rel=0.25, abs=1e-9)


def test_the_interval_of_a_deviation_holds_the_true_one() -> None:
    inside, total = 0, 0
    for seed in range(20):
        result = analysed(signal(noise(20_000, 100.0, 1.0, 0.0, seed), 100.0))
        true = 1 / np.sqrt(result["tau"])
        inside += int(np.sum((result["low"] <= true) & (true <= np.array(result["high"]))))
        total += len(true)
    assert 0.9 <= inside / total <= 0.99


def test_quantisation_and_a_ramp_are_distinguished() -> None:
    draw = np.random.default_rng(3)
    step = np.diff(draw.uniform(-0.5, 0.5, 40_001)) * 0.02 * 100  # angle rounded to 0.02, at 100 Hz
    model = fit_noise(allan_curve([step], 100.0, averaging_lengths(40_000, 8)))
    assert model.parameters["quantisation"].value == pytest.approx(0.02 / math.sqrt(12), rel=0.05)
    ramp = noise(40_000, 100.0, 0.01, 0.0, 1) + np.arange(40_000) / 100 * 1e-3
    results = analysed(signal(ramp, 100.0))
    assert results["parameters"]["ramp"]["value"] == pytest.approx(1e-3, rel=0.05)
    assert "The bias drifts by 3.7 °/s/h" in results["notes"][0]


def test_motion_is_left_out_and_reported() -> None:
    still = noise(30_000, 100.0, 0.01, 0.0, 4)
    moved = still.copy()
    moved[10_000:11_000] += 20 * np.sin(np.arange(1000) / 20)
    results, whole = analysed(signal(moved, 100.0)), analysed(signal(moved, 100.0), motion="include")
    assert results["parameters"]["random_walk"]["value"] == pytest.approx(0.01, rel=0.05)
    assert whole["adev"][5] > 10 * results["adev"][5]
    assert 10.0 <= results["left_out"] <= 14.0
    assert "of motion left out, 4 % of the range" in results["notes"][0]
    assert analysed(signal(still, 100.0))["left_out"] == 0.0


def warmed(of: Signal, seed: int = 7, rise: float = 8.0) -> tuple[Signal, Floats]:
    """The signal in a device that warms up by `rise` °C within some minutes; and the temperature without its noise."""
    since = of.time - of.time[0]
    true = 22 + rise * (1 - np.exp(-since / 150))
    report = np.round((true + np.random.default_rng(seed).normal(0, 0.05, len(true)))[::100] / 0.0625) * 0.0625
    return replace(of, temperature=lambda: (of.time[::100], report)), true


@each_row("walk", [0.0, 1e-4])
def test_a_temperature_drift_is_removed_and_reported_and_the_noise_is_as_without_it(walk: float) -> None:
    coefficient, density, n = 0.02, 0.01, 60_000
    inside = 0
    for seed in range(6):
        still = signal(noise(n, 100.0, density, walk, seed), 100.0)
        device, true = warmed(still)
        drifting = replace(device, values=still.values + coefficient * (true - true.mean()))
        results, plain, stored = analysed(drifting), analysed(still), analysed(drifting, temperature="include")
        drift = results["temperature_drift"]
        assert drift["per_degree"] == pytest.approx(coefficient, rel=0.15)
        inside += abs(drift["per_degree"] - coefficient) <= drift["uncertainty"]
        assert results["parameters"]["random_walk"]["value"] == pytest.approx(density, rel=0.05)
        assert stored["adev"][-1] > 3 * plain["adev"][-1], "the drift would hide the noise"
        if walk == 0:
            assert results["adev"] == pytest.approx(plain["adev"], rel=0.5)
            assert results["parameters"]["ramp"]["low"] == 0.0
        assert "Temperature drift of +0.0" in results["notes"][0]
        assert "between 22." in results["notes"][0]
        assert "Set temperature to exclude" in stored["notes"][0]
    assert inside >= 5


def test_a_bias_that_wanders_by_itself_is_no_temperature_drift() -> None:
    removed = 0
    for seed in range(40):
        device, _ = warmed(signal(noise(30_000, 100.0, 0.01, 3e-3, seed), 100.0), seed)
        removed += "temperature_drift" in analysed(device)
    assert removed <= 2
    even, _ = warmed(signal(noise(30_000, 100.0, 0.01, 0.0, 1), 100.0), rise=0.05)
    assert "temperature_drift" not in analysed(even)


def test_motion_while_a_device_warms_up_is_left_out_first() -> None:
    still = signal(noise(60_000, 100.0, 0.01, 0.0, 4), 100.0)
    device, true = warmed(still)
    values = still.values + 0.02 * (true - true.mean())
    values[20_000:21_000] += 20 * np.sin(np.arange(1000) / 20)
    result = analysed(replace(device, values=values))
    assert result["temperature_drift"]["per_degree"] == pytest.approx(0.02, rel=0.1)
    assert 10.0 <= result["left_out"] <= 14.0
    assert len(result["notes"]) == 2


def test_the_temperature_is_that_of_the_same_device() -> None:
    def info(number: int, device: str, name: str, unit: str) -> ChannelInfo:
        return ChannelInfo(number, device, "M", name, name, "scalar", unit, "", [ColumnInfo("value", "f4", unit=unit)])

    gyro, own, other = info(3, "1", "Gyro", "°/s"), info(2, "1", "Temperature", "°C"), info(1, "2", "Temperature", "°C")
    result = temperature_of([other, gyro, own], SignalColumn(gyro, 0))
    assert result is not None
    assert result.info is own
    assert temperature_of([other, gyro], SignalColumn(gyro, 0)) is None
    assert temperature_of([other, gyro, own], SignalColumn(own, 0)) is None


def test_nothing_is_computed_across_a_gap() -> None:
    values = noise(20_000, 100.0, 0.01, 0.0, 5)
    time = np.arange(20_000) / 100
    rows = np.r_[0:8000, 8300:20_000]
    result = analysed(signal(values[rows], 100.0, time[rows]), motion="include")
    expected = allan_curve([values[:8000], values[8300:]], 100.0, averaging_lengths(11_700, 8))
    assert result["adev"] == pytest.approx(expected.adev.tolist(), rel=1e-6)
    assert result["gaps"] == 1
    assert result["notes"][0] == "1 gap, 3 s in sum: nothing is computed across a gap."


def test_jitter_is_reported() -> None:
    draw = np.random.default_rng(6)
    time = np.arange(5000) / 100 + draw.normal(0, 0.002, 5000)
    [note] = analysed(signal(draw.normal(0, 1, 5000), 100.0, time))["notes"]
    assert "jitter of 28 % of a step" in note


@each_row(
    ("values", "time", "words"),
    [
        (np.zeros(8), None, "only 8 samples"),
        (np.zeros(50), np.zeros(50), "share the time"),
    ],
)
def test_samples_that_determine_nothing_are_refused(values: Floats, time: Floats | None, words: str) -> None:
    with pytest.raises(DomainError, match=words) as raised:
        analysed(signal(values, 100.0, time))
    assert raised.value.kind == "no-result"
    assert raised.value.hint


def test_a_constant_signal_is_no_sensor_without_noise() -> None:
    results = analysed(signal(np.full(1000, 9.81), 100.0))
    assert max(results["adev"]) == pytest.approx(0.0, abs=1e-12)
    assert results["obstacles"][0]["message"] == "Stuck: all 1000 samples are 9.81 °/s."
    assert "parameters" not in results
