"""Intervals in which a condition is true: against a slow oracle, in pages, from both ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server import wire
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.expression_syntax import ExpressionError
from imuscope.server.extensions.analysis.expressions.signal_request import ExpressionSignal, requested_signals
from imuscope.server.extensions.analysis.noise.registry import analysis_named
from imuscope.server.extensions.analysis.signals.signals import Signal, SignalColumn

START = 1_760_000_000.0
CHANNELS = [
    wire.ChannelInfo(n, device, "IMU", "Acceleration", "Acceleration", "vector", "m/s²", "body", columns)
    for n, device in enumerate(("1", "2"))
    for columns in [[wire.ColumnInfo(axis, "f8", "m/s²") for axis in "xyz"]]
]


def figures_for(values: Any, **options: Any) -> dict[str, Any]:
    analysis = analysis_named("intervals")
    numbers = np.asarray(values, np.float64)
    signal = Signal("Speed", "m/s", 0.0, START + np.arange(len(numbers)), numbers)
    return dict(analysis.run(signal, analysis.settings(options)))


def slow(values: list[bool]) -> list[tuple[float, float]]:
    """Begins and ends, sample by sample."""
    out: list[list[float]] = []
    for n, one in enumerate(values):
        if one and (n == 0 or not values[n - 1]):
            out.append([START + n, START + n])
        elif one:
            out[-1][1] = START + n
    return [(begin, end) for begin, end in out]


@given(st.lists(st.booleans(), min_size=1, max_size=60), st.integers(0, 9), st.integers(1, 9))
def test_intervals_are_those_of_a_walk_along_the_samples(values: list[bool], offset: int, limit: int) -> None:
    expected = slow(values)
    page = figures_for(values, offset=offset, limit=limit)
    assert page["total"] == len(expected)
    assert page["samples"] == sum(values)
    assert list(zip(page["begin"], page["end"], strict=True)) == expected[offset : offset + limit]
    backwards = figures_for(values, offset=offset, limit=limit, order="descending")
    assert list(zip(backwards["begin"], backwards["end"], strict=True)) == expected[::-1][offset : offset + limit]


def test_the_next_and_the_previous_one_of_a_time() -> None:
    values = [0, 1, 1, 0, 1, 0, 0, 1]
    assert figures_for(values, after=START + 1, limit=1)["begin"] == [START + 4]
    assert figures_for(values, before=START + 4, order="descending", limit=1)["begin"] == [START + 1]
    assert figures_for(values, after=START + 7)["begin"] == []


def test_a_signal_is_no_condition() -> None:
    with pytest.raises(DomainError) as raised:
        figures_for([0.0, 0.5])
    assert (raised.value.kind, raised.value.hint) == (
        "bad-expression",
        "Compare it with a value, for example Speed > 3 m/s.",
    )


def condition(text: str, device: str = "") -> list[Signal]:
    [one] = requested_signals(CHANNELS, [text], zero_phase=True, device=device)
    assert isinstance(one, ExpressionSignal)
    time = START + np.arange(4.0)

    def read(column: SignalColumn) -> tuple[Any, Any]:
        return time, np.array([0.0, 40.0, 40.0, 0.0]) if column.device == "2" else np.zeros(4)

    return one.signals(read)


def test_a_condition_over_signals_of_the_preferred_device() -> None:
    analysis = analysis_named("intervals")
    for device, begins in (("1", []), ("2", [START + 1])):
        [signal] = condition("norm(Acceleration) > 3 g", device)
        assert analysis.run(signal, analysis.settings({}))["begin"] == begins
    [signal] = condition('norm("2/Acceleration") > 3 g', "1")
    assert signal.values.tolist() == [0.0, 1.0, 1.0, 0.0]
    with pytest.raises(ExpressionError, match="Several devices have Acceleration") as raised:
        condition("norm(Acceleration) > 3 g")
    assert (raised.value.begin, raised.value.end) == (5, 17)
