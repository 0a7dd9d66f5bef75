"""Statistics of any range: equal to those of the whole at once, and circular where a column wraps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from imuscope.protocols.arrays import Floats
from imuscope.recordings.columns.statistics import norm_statistics, statistics, statistics_of, wrapped
from imuscope.recordings.columns.store import BLOCK_ROWS, ChannelLayout, ColumnStoreWriter
from tests.support.each_row import each_row


def turn(centre: float, half: float, n: int = 500) -> Floats:
    return np.asarray(wrapped(np.linspace(centre - half, centre + half, n), 360.0), np.float64)


def in_parts(values: Floats, size: int = 64) -> Iterator[Floats]:
    yield from (values[at : at + size] for at in range(0, len(values), size))


def test_a_yaw_that_turns_through_180_degrees_has_its_mean_there() -> None:
    """Regression: 5 s at 11.46 °/s through ±180° were reported as 26.66° ± 163.48°."""
    values = turn(175.0, 28.65)
    report = statistics_of(lambda: in_parts(values), 360.0)
    assert report.mean == pytest.approx(175.0, abs=1e-3)
    assert report.sigma == pytest.approx(57.3 / np.sqrt(12), rel=0.01)


@each_row("centre", [0.0, 90.0, 170.0, 180.0, -179.0])
def test_the_mean_of_more_than_half_a_turn_is_its_middle(centre: float) -> None:
    report = statistics_of(lambda: in_parts(turn(centre, 130.0)), 360.0)
    assert wrapped(report.mean - centre, 360.0) == pytest.approx(0.0, abs=1e-3)


def test_the_mean_of_a_crooked_distribution_is_that_of_its_values() -> None:
    """Directions pull differently than values: the middle of the circle is not the mean yet."""
    values = np.concatenate((np.full(900, -80.0), np.full(100, 60.0)))
    report = statistics_of(lambda: in_parts(values), 360.0)
    assert report.mean == pytest.approx(values.mean(), abs=1e-3)
    assert report.sigma == pytest.approx(values.std(ddof=1), rel=1e-6)


def test_an_axis_that_spins_has_no_mean() -> None:
    report = statistics_of(lambda: in_parts(turn(0.0, 718.0, 4000)), 360.0)
    assert np.isnan(report.mean)
    assert report.sigma > 90


def test_linear_statistics_agree_with_numpy(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    n = BLOCK_ROWS + 5000
    time, pressure = np.arange(n) / 400.0, 101_325 + rng.normal(size=n)
    pressure[7] = np.nan
    writer = ColumnStoreWriter(tmp_path / "store")
    writer.channel(1, ChannelLayout(("f8",), (False,)))
    writer.append(1, [time, time, pressure])
    store = writer.finish({})
    lo, hi = store.between(1, 0.0, 170.0)
    report = statistics(store, 1, 0, lo, hi)
    want = pressure[lo:hi][np.isfinite(pressure[lo:hi])]
    assert (report.n, report.min, report.max) == (len(want), want.min(), want.max())
    assert report.mean == pytest.approx(want.mean(), rel=1e-12)
    assert report.sigma == pytest.approx(want.std(ddof=1), rel=1e-9)
    assert statistics(store, 1, 0, 5, 5).n == 0


def test_the_length_of_vectors_is_that_of_each(tmp_path: Path) -> None:
    """Bounds of components do not bound the mean length."""
    x, y, z = np.random.default_rng(5).normal(size=(3, 1000))
    time = np.arange(1000.0)
    writer = ColumnStoreWriter(tmp_path / "store")
    writer.channel(1, ChannelLayout(("f8", "f8", "f8"), (False, False, False)))
    writer.append(1, [time, time, x, y, z])
    report = norm_statistics(writer.finish({}), 1, range(3), 0, 1000)
    want = np.sqrt(x * x + y * y + z * z)
    assert (report.mean, report.sigma) == (pytest.approx(want.mean()), pytest.approx(want.std(ddof=1)))
