"""Rates: correct for any bursts and spacing, and zero soon after the last arrival."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.concurrency.rate_meter import FRESH_S, RateMeter


@given(st.sampled_from([50, 100, 400, 2000]), st.sampled_from([1, 4, 16, 64]), st.floats(0, 0.05))
def test_a_rate_is_true_for_any_burst(rate: int, burst_ms: int, requested_after: float) -> None:
    """Samples of an even stream that come in bursts: the reading is off by no more than one sample in the window."""
    meter = RateMeter()
    sent = 0
    arrivals = [k * burst_ms / 1e3 for k in range(1, 3000 // burst_ms)]
    for arrival in arrivals:
        due = int(arrival * rate + 1e-9)
        if due > sent:
            meter.add(due - sent, arrival)
            sent = due
    assert meter.rate(arrivals[-1] + requested_after) == pytest.approx(rate, rel=0.02)


def test_a_message_sent_once_a_second_has_a_rate_of_one() -> None:
    meter = RateMeter()
    for second in range(5):
        meter.add(1, float(second))
    assert [meter.rate(4.0 + later) for later in (0.0, 0.5, 0.99)] == [pytest.approx(1.0)] * 3


def test_a_rate_is_zero_soon_after_the_last_arrival() -> None:
    meter = RateMeter()
    assert meter.rate(0.0) == 0
    for k in range(1000):
        meter.add(1, k / 100)
    assert meter.rate(9.99 + FRESH_S) == pytest.approx(100, rel=0.01)
    assert meter.rate(10.0 + FRESH_S) == 0
    assert meter.total == 1000
