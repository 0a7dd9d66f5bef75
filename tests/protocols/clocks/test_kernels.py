"""The hot loops of the clock mapping: as numpy computes them, compiled and in plain Python."""

from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.clocks.kernels import decreases, delays_of, host_times
from imuscope.protocols.framing.stream_buffer import StreamBuffer
from imuscope.protocols.native.kernels import plain

ORIGIN, HOST_ORIGIN = 5_000_000_000_000, 1_700_000_000_000_000_000
NS = st.integers(-(10**13), 10**13)


def both(kernel: Any) -> list[Callable[..., Any]]:
    """A kernel as it runs, and its plain Python."""
    return [kernel, plain(kernel)]


@given(
    st.lists(st.tuples(NS, st.integers(0, 10**10)), min_size=1, max_size=40), st.floats(-1e-3, 1e-3), st.floats(0, 1e9)
)
def test_delays_are_those_of_the_arrays(rows: list[tuple[int, int]], slope: float, intercept: float) -> None:
    device = ORIGIN + np.array([at for at, _ in rows])
    sent = HOST_ORIGIN + np.array([at + late for at, late in rows])
    expected_x = (device - ORIGIN).astype(np.float64)
    expected = (sent - HOST_ORIGIN).astype(np.float64) - expected_x - slope * expected_x - intercept
    for loop in both(delays_of):
        x, delay = np.empty(len(rows)), np.empty(len(rows))
        result = loop(device, sent, ORIGIN, HOST_ORIGIN, slope, intercept, x, delay)
        assert x.tolist() == expected_x.tolist()
        assert delay.tolist() == expected.tolist()
        assert tuple(result) == (expected.argmin(), expected_x.argmin(), expected_x.argmax())


@given(
    st.lists(st.tuples(st.integers(1, 10**12), st.integers(0, 10**12)), min_size=1, max_size=8),
    st.lists(NS, min_size=1, max_size=30),
    st.floats(0.9, 1.1),
)
def test_host_times_follow_the_knots(steps: list[tuple[int, int]], times: list[int], slope: float) -> None:
    knot_x = np.cumsum([step for step, _ in steps]).astype(np.float64)
    knot_h = np.cumsum([step for _, step in steps]).astype(np.float64)
    device = ORIGIN + np.array([*times, *knot_x.astype(np.int64).tolist()])
    x = (device - ORIGIN).astype(np.float64)
    h = np.interp(x, knot_x, knot_h) + (x - np.clip(x, knot_x[0], knot_x[-1])) * slope
    expected = HOST_ORIGIN + h.astype(np.int64)
    room = np.full(3, np.nan)  # memory after the last knot
    for loop in both(host_times):
        host = np.empty(len(device), np.int64)
        knots = np.concatenate((knot_x, room)), np.concatenate((knot_h, room)), len(knot_x)
        loop(device, ORIGIN, HOST_ORIGIN, *knots, slope, host)
        assert np.abs(host - expected).max() <= 1024


@given(st.lists(st.integers(-5, 5), max_size=10))
def test_a_decrease_is_found_wherever_it_is(values: list[int]) -> None:
    array = np.array(values, np.int64)
    for loop in both(decreases):
        assert loop(array) == bool((array[1:] < array[:-1]).any())


@given(st.lists(st.integers(1, 50), min_size=1, max_size=30), st.data())
def test_arrivals_are_those_of_each_byte(sizes: list[int], data: st.DataObject) -> None:
    buffer = StreamBuffer()
    for number, size in enumerate(sizes):
        buffer.append(bytes(size), 1000 + number)
    released = data.draw(st.integers(0, sum(sizes) - 1))
    buffer.release(released)
    last = np.array(sorted(data.draw(st.sets(st.integers(released, sum(sizes) - 1), max_size=40))), np.int64)
    assert buffer.arrivals(last).tolist() == [buffer.arrival(int(at)) for at in last]
