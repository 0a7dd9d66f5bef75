"""Verdicts on a data sheet, and noise parameters as the YAML of other programs: noise of known parameters."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

from imuscope.protocols.arrays import Floats
from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.noise.data_sheet import TOLERANCE, data_sheet_of
from imuscope.server.extensions.analysis.noise.registry import FiguresOfSignal, analysis_named
from imuscope.server.extensions.analysis.noise.report import figures_of
from imuscope.server.extensions.analysis.signals.signals import DataSheetNoise, Signal
from imuscope.server.wire import ChannelInfo, ColumnInfo

RATE = 100.0
SHEET = DataSheetNoise("MTi-630", 0.005, 8 / 3600)


def resting(density: float, walk: float = 0.0, *, n: int = 60_000, unit: str = "°/s", seed: int = 1) -> Signal:
    """Noise of a density, unit/√Hz, and of a rate random walk, unit/s/√Hz."""
    draw = np.random.default_rng(seed)
    noise: Floats = draw.normal(0, density * math.sqrt(RATE), n)
    drift: Floats = np.cumsum(draw.normal(0, walk / math.sqrt(RATE), n))
    return Signal("RateOfTurn.x", unit, 0.0, 1.76e9 + np.arange(n) / RATE, noise + drift)


def verdicts(signal: Signal, sheet: DataSheetNoise = SHEET) -> dict[str, tuple[str, str]]:
    analysis = analysis_named("allan")
    figures, units = figures_of(analysis, replace(signal, data_sheet=sheet), analysis.settings({}))
    assert len(figures["data_sheet"]) == len(figures["tau"])
    assert units["data_sheet"] == signal.unit
    return {one["parameter"]: (one["state"], one["words"]) for one in figures["verdicts"]}


def test_a_sensor_as_its_data_sheet_states_meets_it() -> None:
    state, words = verdicts(resting(0.005))["random_walk"]
    assert state == "met"
    assert "0.3 °/√h of the MTi-630 data sheet" in words


def test_a_sensor_with_three_times_the_noise_does_not() -> None:
    state, words = verdicts(resting(0.015))["random_walk"]
    assert state == "above"
    assert words.startswith(("Random walk 0.8", "Random walk 0.9"))
    assert "3 times the 0.3 °/√h" in words


def test_a_bias_is_judged_only_where_the_curve_has_its_lowest_part() -> None:
    short = verdicts(resting(0.05, n=6_000))["bias_instability"]
    assert short[0] == "open"
    assert "Record longer" in short[1]
    assert verdicts(resting(0.0005))["bias_instability"][0] == "met"
    state, words = verdicts(resting(0.002, 0.01))["bias_instability"]
    assert state == "above"
    assert "times the 8 °/h of the MTi-630 data sheet" in words


def test_a_figure_near_its_limit_is_left_open() -> None:
    state, words = verdicts(resting(0.005 * TOLERANCE, n=3_000))["random_walk"]
    assert state == "open"
    assert "near the limit of the 0.3 °/√h of the MTi-630 data sheet. Record longer" in words


def test_an_accelerometer_is_judged_in_the_units_of_its_data_sheet() -> None:
    sheet = DataSheetNoise("MTi-630", 60e-6 * 9.80665, 15e-6 * 9.80665)
    results = verdicts(resting(180e-6 * 9.80665, unit="m/s²"), sheet)
    assert re.match(r"Random walk 0\.1\d* m/s/√h: (2\.9|3|3\.1) times the 0\.0353 m/s/√h", results["random_walk"][1])
    assert "the 15 µg of the MTi-630 data sheet" in results["bias_instability"][1]


def test_a_drift_leaves_the_bias_open() -> None:
    signal = resting(0.005)
    warming = replace(signal, values=signal.values + (signal.time - signal.time[0]) * 1e-3)
    state, words = verdicts(warming)["bias_instability"]
    assert state == "open"
    assert "a drift hides it" in words
    assert verdicts(warming)["random_walk"][0] == "met"


def test_the_curve_of_a_data_sheet_joins_its_two_figures() -> None:
    analysis = analysis_named("allan")
    figures, _ = figures_of(analysis, replace(resting(0.005), data_sheet=SHEET), analysis.settings({}))
    tau, curve = np.array(figures["tau"]), np.array(figures["data_sheet"])
    assert curve[0] == pytest.approx(0.005 / math.sqrt(tau[0]), rel=1e-2)
    assert curve == pytest.approx(np.hypot(0.005 / np.sqrt(tau), 8 / 3600))
    without, _ = figures_of(analysis, resting(0.005), analysis.settings({}))
    assert "data_sheet" not in without
    assert "verdicts" not in without


def channel(title: str, unit: str, kind: str = "vector") -> ChannelInfo:
    columns = [
        ColumnInfo(name=name, label=name, axis=name, unit=unit, dtype="f4", decimals=3) for name in ("x", "y", "z")
    ]
    fields: dict[str, Any] = {"id": 1, "device": "1", "name": title, "title": title, "kind": kind}
    return ChannelInfo(**fields, message="MTData2", frame="body", unit=unit, columns=columns)


def test_a_sheet_belongs_to_accelerometers_and_gyroscopes_in_their_unit() -> None:
    sensors = SensorProperties(turn=1e-4, acceleration=6e-4, turn_bias=4e-5, acceleration_bias=1.5e-4)

    def product(device: str) -> tuple[str, SensorProperties]:
        assert device == "1"
        return "MTi-630", sensors

    turn = data_sheet_of(channel("Rate of turn", "°/s"), 0, product)
    assert turn is not None
    assert turn.random_walk == pytest.approx(math.degrees(1e-4) / math.sqrt(2))
    assert turn.bias_instability == pytest.approx(math.degrees(4e-5))
    force = data_sheet_of(channel("Acceleration", "g"), 2, product)
    assert force is not None
    assert force.bias_instability == pytest.approx(1.5e-4 / 9.80665)
    for other in (channel("Free acceleration", "m/s²"), channel("Acceleration", "°/s"), channel("Velocity", "m/s")):
        assert data_sheet_of(other, 0, product) is None
    assert data_sheet_of(channel("Rate of turn", "°/s"), 0, lambda device: ("", SensorProperties())) is None


def of_signals(*signals: Signal) -> list[FiguresOfSignal]:
    analysis = analysis_named("allan")
    return [FiguresOfSignal(one.name, one.unit, figures_of(analysis, one, analysis.settings({}))[0]) for one in signals]


def test_kalibr_reads_the_noisiest_axis_in_si_units() -> None:
    gyroscopes = [
        replace(resting(0.005 * k, 1e-3 * k, seed=k), name=f"RateOfTurn.{axis}")
        for k, axis in ((1, "x"), (2, "y"), (3, "z"))
    ]
    text = analysis_named("allan").text("kalibr", of_signals(*gyroscopes))
    results = yaml.safe_load(text)
    assert results["gyroscope_noise_density"] == pytest.approx(math.radians(0.015), rel=0.05)
    assert results["gyroscope_random_walk"] == pytest.approx(math.radians(3e-3), rel=0.35)
    assert results["update_rate"] == pytest.approx(RATE)
    assert "accelerometer_noise_density" not in results
    assert "# No accelerometer was requested." in text


def test_vins_reads_standard_deviations_of_samples() -> None:
    force = replace(resting(6e-4, unit="m/s²"), name="Acceleration.x")
    text = analysis_named("allan").text("vins", of_signals(force, resting(0.005)))
    result = yaml.safe_load(text)
    assert result["acc_n"] == pytest.approx(6e-4 * math.sqrt(RATE), rel=0.05)
    assert result["gyr_n"] == pytest.approx(math.radians(0.005) * math.sqrt(RATE), rel=0.05)
    assert 0 < result["acc_w"] < result["acc_n"]
    assert "at most: the curve does not show it" in text


def test_covariances_are_the_variance_of_samples_on_each_axis() -> None:
    axes = [replace(resting(1e-3 * k, unit="m/s²", seed=k), name=f"Acceleration.{k}") for k in (1, 2, 3)]
    result = yaml.safe_load(analysis_named("allan").text("robot_localization", of_signals(*axes)))
    matrix = np.array(result["linear_acceleration_covariance"]).reshape(3, 3)
    assert np.diag(matrix) == pytest.approx([1e-6 * RATE, 4e-6 * RATE, 9e-6 * RATE], rel=0.1)
    assert np.count_nonzero(matrix) == 3


def test_what_has_no_such_noise_is_refused() -> None:
    other = replace(resting(1.0, unit="°C"), name="Temperature")
    with pytest.raises(DomainError, match="Temperature is neither an acceleration nor a rate of turn"):
        analysis_named("allan").text("kalibr", of_signals(other))
    with pytest.raises(DomainError, match="Format xml not found") as raised:
        analysis_named("allan").text("xml", [])
    assert "kalibr, vins, robot_localization" in raised.value.hint
