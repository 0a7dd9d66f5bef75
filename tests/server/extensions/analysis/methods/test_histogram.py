"""Histograms: against numpy, of angles, of a range, and of signals with one value."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.extensions.analysis.methods.histogram import MOST_BINS
from imuscope.server.extensions.analysis.noise.registry import analysis_named
from imuscope.server.extensions.analysis.noise.report import figures_of
from imuscope.server.extensions.analysis.signals.signals import Signal
from tests.support.each_row import each_row


def histogram(values: Any, period: float = 0.0, **options: float) -> tuple[dict[str, Any], dict[str, str]]:
    numbers = np.asarray(values, np.float64)
    of = Signal("Acceleration.x", "m/s²", period, 1_760_000_000.0 + np.arange(len(numbers)) * 0.01, numbers)
    analysis = analysis_named("histogram")
    return figures_of(analysis, of, analysis.settings(options))


@each_row("n", [2, 100, 54_321])
def test_the_bins_are_those_of_numpy_and_of_freedman_and_diaconis(n: int) -> None:
    values = np.random.default_rng(n).normal(3, 0.2, n)
    result, units = histogram(values)
    counts, edges = np.histogram(values, "fd")
    assert result["counts"] == counts.tolist()
    assert result["edges"] == pytest.approx(edges.tolist())
    assert result["density"] == pytest.approx(np.histogram(values, "fd", density=True)[0].tolist())
    assert (result["n"], result["below"], result["above"]) == (n, 0, 0)
    assert result["mean"] == pytest.approx(values.mean())
    assert result["sigma"] == pytest.approx(values.std(ddof=1))
    assert units == {
        **dict.fromkeys(("edges", "mean", "sigma", "min", "max", "width"), "m/s²"),
        "density": "s²/m",
    }


@given(
    st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=200), st.integers(1, 50), st.floats(-900, 0), st.floats(1, 900)
)
def test_every_sample_is_counted_once(values: list[float], bins: int, low: float, high: float) -> None:
    result, _ = histogram(values, bins=bins, low=low, high=high)
    assert len(result["counts"]) == bins
    assert result["below"] == sum(value < low for value in values)
    assert result["above"] == sum(value > high for value in values)
    assert sum(result["counts"]) + result["below"] + result["above"] == result["n"] == len(values)
    assert result["counts"] == np.histogram(values, bins, (low, high))[0].tolist()
    assert (result["at_min"], result["at_max"]) == (values.count(min(values)), values.count(max(values)))


def test_within_some_sigma_the_others_are_counted() -> None:
    values = np.random.default_rng(1).normal(2, 1, 10_000)
    values[:3] = -500, 400, 401
    result, _ = histogram(values, within=3)
    mean, sigma = values.mean(), values.std(ddof=1)
    assert result["edges"][0] == pytest.approx(mean - 3 * sigma)
    assert result["edges"][-1] == pytest.approx(mean + 3 * sigma)
    assert (result["below"], result["above"], result["n"]) == (1, 2, 10_000)
    assert sum(result["counts"]) == 9997


def test_one_value_has_one_bin() -> None:
    result, _ = histogram(np.full(40, 9.81))
    assert result["counts"] == [40]
    assert result["edges"] == pytest.approx([9.31, 10.31])
    assert result["sigma"] == pytest.approx(0, abs=1e-9)
    assert result["at_max"] == 40


def test_a_signal_that_mostly_stands_still_has_bins_by_its_spread() -> None:
    values = np.zeros(1000)
    values[:100] = np.linspace(-1, 1, 100)
    result, _ = histogram(values)
    assert 5 < len(result["counts"]) < 200
    assert sum(result["counts"]) == 1000


def test_a_far_outlier_makes_no_endless_list() -> None:
    values = np.random.default_rng(1).normal(0, 1, 10_000)
    values[77] = 1e9
    results, _ = histogram(values)
    assert len(results["counts"]) == MOST_BINS
    assert sum(results["counts"]) == 10_000
    assert "too many" in results["notes"][0]


def test_an_angle_is_shown_around_its_mean() -> None:
    angles = np.random.default_rng(2).normal(180, 5, 5000)
    result, _ = histogram((angles + 180) % 360 - 180, period=360.0)
    assert abs(abs(result["mean"]) - 180) < 0.5
    assert result["edges"][-1] - result["edges"][0] < 60
    assert result["sigma"] == pytest.approx(5, rel=0.05)
    assert math.isclose(sum(result["density"]) * result["width"], 1.0)
