"""Unwrapping does not depend on how the stream was cut. It must not; and it takes the same time whatever happens."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.clocks.counters import TickUnwrapper
from tests.support.counting import counted_calls

DAY, FULL = 864_000_000, 2**32

steps = st.sampled_from([25, 25, 25, 50, -25_000, -25_000, -60_000, -200_000, 3_000_000, DAY - 1000, FULL - 1000])


@given(st.integers(0, FULL - 1), st.lists(steps, max_size=40), st.lists(st.integers(1, 9), max_size=20))
def test_any_chunks(first: int, moves: list[int], cuts: list[int]) -> None:
    raw = (first + np.cumsum([0, *moves])) % FULL
    whole, apart = TickUnwrapper(FULL, auto=(DAY,), tick_ns=100_000), TickUnwrapper(FULL, auto=(DAY,), tick_ns=100_000)
    expected = whole.ticks(raw).tolist()
    got: list[int] = []
    results: list[tuple[int, str, int]] = []
    for size in [*cuts, len(raw)]:
        base = len(got)
        got += apart.ticks(raw[base : base + size]).tolist()
        results += [(base + row, kind, by) for row, kind, by in apart.steps]
    assert got == expected
    assert results == whole.steps
    assert apart.wrap == whole.wrap


@given(
    st.integers(0, FULL - 1),
    st.lists(st.tuples(steps, st.sampled_from([0, 1, 25, 25, 25, 50, 60_000])), max_size=40),
    st.booleans(),
    st.sampled_from([(), (DAY,)]),
)
def test_row_by_row(first: int, moves: list[tuple[int, int]], timed: bool, auto: tuple[int, ...]) -> None:
    """`tick` gives for each row what `ticks` gives for all, regardless of earlier calls."""
    raw = (first + np.cumsum([0, *(move for move, _ in moves)])) % FULL
    arrival = 100_000 * np.cumsum([7, *(passed for _, passed in moves)]) if timed else None
    whole, apart = (TickUnwrapper(FULL, auto=auto, tick_ns=100_000) for _ in range(2))
    expected = whole.ticks(raw, arrival).tolist()
    results: list[tuple[int, str, int]] = []
    for row, (value, ticks) in enumerate(zip(raw.tolist(), expected, strict=True)):
        when = None if arrival is None else arrival[row : row + 1]
        if row % 5 == 4:
            assert apart.ticks(raw[row : row + 1], when).tolist() == [ticks]
        else:
            assert apart.tick(value, None if when is None else int(when[0])) == ticks
        results += [(row, kind, by) for _, kind, by in apart.steps]
    assert results == whole.steps
    assert apart.wrap == whole.wrap


def test_many_steps_take_no_longer() -> None:
    """A small capture played over and over sets the clock back every hundred rows."""
    raw = np.tile(np.arange(0, 10_000, 100), 5000)
    clock = TickUnwrapper(FULL, tick_ns=100_000)
    clock.ticks(raw[:10])
    with counted_calls() as calls:
        clock.ticks(raw)
    assert len(clock.steps) >= 4999
    assert calls.count < 100  # 16 for any number of steps
