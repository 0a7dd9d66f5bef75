"""Pairs of two signals: against numpy, across gaps and angles, thinned without losing an extreme, and over HTTP."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.extensions.analysis.signals.pairs import paired, shortened, thinned
from imuscope.server.extensions.analysis.signals.signals import Signal
from tests.support.each_row import each_row
from tests.support.in_process_server import InProcessServer, table_server
from tests.support.problems import assert_problem

START = 1_760_000_000.0


def signal(time: Any, values: Any, period: float = 0.0, name: str = "a") -> Signal:
    return Signal(name, "m", period, START + np.asarray(time, np.float64), np.asarray(values, np.float64))


def test_signals_with_the_same_times_are_paired_sample_by_sample() -> None:
    time = np.arange(10) * 0.1
    result = paired(signal(time, np.arange(10)), signal(time, -np.arange(10.0)), "interpolated")
    assert (result.x == -result.y).all()
    assert result.leader == ""
    assert result.starts.tolist() == [True] + 9 * [False]


@each_row("swapped", [False, True])
def test_the_slower_one_is_interpolated_as_numpy_does(swapped: bool) -> None:
    fast, slow = np.arange(0, 10, 0.013), np.arange(0.005, 9.9, 0.2)
    a, b = signal(fast, np.sin(fast), name="fast"), signal(slow, slow**2, name="slow")
    result = paired(b, a, "interpolated") if swapped else paired(a, b, "interpolated")
    within = (fast + START >= b.time[0]) & (fast + START <= b.time[-1])
    assert result.leader == "fast"
    assert result.time == pytest.approx(a.time[within])
    x, y = (result.y, result.x) if swapped else (result.x, result.y)
    assert x == pytest.approx(a.values[within])
    assert y == pytest.approx(np.interp(a.time[within], b.time, b.values))


def test_the_nearest_sample_may_be_before_or_after() -> None:
    result = paired(signal(np.arange(21) * 0.1, np.zeros(21)), signal([0, 1, 2], [5, 6, 7]), "nearest")
    assert result.y.tolist() == 5 * [5.0] + 10 * [6.0] + 6 * [7.0]


def test_nothing_is_paired_across_a_gap_and_the_line_breaks() -> None:
    fast = np.arange(0, 10, 0.1)
    slow = np.concatenate([np.arange(0, 3.5, 0.5), np.arange(7, 10.1, 0.5)])
    result = paired(signal(fast, fast), signal(slow, slow), "interpolated")
    hole = (result.time - START > 3.01) & (result.time - START < 6.99)
    assert not hole.any()
    assert np.flatnonzero(result.starts).tolist() == [0, 31]
    leading = np.delete(fast, np.arange(40, 60))
    broken = paired(signal(leading, leading), signal(leading, leading), "interpolated")
    assert np.flatnonzero(broken.starts).tolist() == [0, 40]


def test_an_angle_is_interpolated_the_short_way_round() -> None:
    result = paired(
        signal(np.arange(5) * 0.25, np.zeros(5)), signal([0, 1], [170.0, -170.0], period=360.0), "interpolated"
    )
    assert result.y == pytest.approx([170, 175, -180, -175, -170])
    assert result.starts.tolist() == [True, False, True, False, False]


@given(
    st.lists(st.floats(-1e6, 1e6, width=32), min_size=1, max_size=400),
    st.integers(12, 120),
    st.lists(st.integers(1, 399), max_size=4),
)
def test_thinned_pairs_keep_the_extremes_and_the_breaks(values: list[float], most: int, holes: list[int]) -> None:
    n = len(values)
    time = np.arange(n) * 0.01
    for hole in holes:
        time[hole:] += 5.0
    whole = paired(signal(time, values), signal(time, values[::-1]), "interpolated")
    few = thinned(whole, most)
    assert len(few.time) <= max(most, n if n <= most else 0)
    for axis in ("x", "y"):
        assert getattr(few, axis).min() == getattr(whole, axis).min()
        assert getattr(few, axis).max() == getattr(whole, axis).max()
    assert set(zip(few.time, few.x, few.y, strict=True)) <= set(zip(whole.time, whole.x, whole.y, strict=True))
    strokes = np.cumsum(whole.starts)[np.searchsorted(whole.time, few.time, side="right") - 1]
    assert (few.starts == (np.diff(strokes, prepend=0) > 0)).all()


def test_short_numbers_are_those_of_a_32_bit_float() -> None:
    values = np.array([9.80665123456, -0.000123456789, 0.0])
    assert shortened(values) == pytest.approx(values.tolist(), abs=1e-6)
    assert shortened(np.zeros(2)) == [0.0, 0.0]
    assert shortened(np.empty(0)) == []


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[InProcessServer]:
    """A recording "turn" of a point that goes round a circle, 40 s at 500 Hz."""
    times = np.arange(20_000) * 0.002
    rows = "".join(f"{START + t:.4f},{3 * math.cos(t):.7f},{3 * math.sin(t):.7f}\n" for t in times)
    with table_server(tmp_path_factory.mktemp("data"), turn="time,east (m),north (m)\n" + rows) as running:
        yield running


def send_request(running: InProcessServer, **body: Any) -> Any:
    return running.client.post("/api/analysis/pairs", json={"source": "turn", **body})


def test_pairs_of_a_recording(running: InProcessServer) -> None:
    east, north = (next(name for name in running.signals_of("turn") if word in name) for word in ("east", "north"))
    answer = send_request(running, x={"signal": east}, y={"signal": north}, t0=START + 1, t1=START + 30).json()
    assert answer["n"] == 14_501
    assert len(answer["x"]) == len(answer["time"]) <= 6000
    assert answer["x_unit"] == answer["y_unit"] == "m"
    assert answer["starts"] == [0]
    assert (answer["t0"], answer["time"][-1]) == (pytest.approx(START + 1), pytest.approx(29))
    assert np.hypot(answer["x"], answer["y"]) == pytest.approx(np.full(len(answer["x"]), 3.0), abs=1e-5)
    angle = np.unwrap(np.arctan2(answer["y"], answer["x"]))
    assert angle == pytest.approx(np.array(answer["time"]) + angle[0], abs=1e-5)
    assert [max(answer["x"]), min(answer["y"])] == pytest.approx([3, -3], abs=1e-5)
    both = send_request(running, x={"signal": f'"{east}" * 2'}, y={"signal": north}, points=60).json()
    assert len(both["x"]) <= 60
    assert max(both["x"]) == pytest.approx(6, abs=1e-4)


def test_a_wrong_pair_is_refused(running: InProcessServer) -> None:
    [east, *_] = running.signals_of("turn")
    assert_problem(send_request(running, x={"signal": east}, y={"signal": "Speed"}), 404, "not-found")
    assert_problem(send_request(running, x={"signal": east, "part": 1}, y={"signal": east}), 422, "bad-value")
    assert_problem(send_request(running, x={"signal": east}, y={"signal": east}, pairing="guess"), 422, "bad-request")
    empty = send_request(running, x={"signal": east}, y={"signal": east}, t0=5, t1=6).json()
    assert (empty["n"], empty["x"], empty["starts"]) == (0, [], [])
