"""Rows that arrive in bursts are shown one after another, and none waits without a limit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from imuscope.server.extensions.viser.playout_buffer import (
    DELAY_S,
    FAR_S,
    MAX_WAITING,
    MESSAGES_PER_S,
    OVERDUE_S,
    PlayoutBuffer,
)
from imuscope.server.wire.codec import SampleFrame

AHEAD = 1_000_000.0  # of the server's clock against the local one


def message(t0: float, dt: float, n: int, *, sent: float | None = None, device: float = 0.0) -> SampleFrame:
    """Rows with measurement times on the local clock; sent with the last of them."""
    measured = t0 + dt * np.arange(n)
    arrival = measured + AHEAD
    now = AHEAD + (float(measured[-1]) if sent is None else sent)
    return SampleFrame(1, 0, n, 0, False, now, [arrival, arrival + device, measured])


def shown(playout: PlayoutBuffer, *times: float) -> list[float]:
    return [row[0] for t in times if (row := playout.due(t)) is not None]


def test_motion_is_as_even_on_screen_as_it_was_in_the_device() -> None:
    playout, step = PlayoutBuffer(), 1 / MESSAGES_PER_S
    late = [0.0, 0.008, 0.003, 0.010, 0.001]  # messages that lie about for a while
    messages = [message(step * i, 0.0005, round(step / 0.0005)) for i in range(60)]
    received = [one.now - AHEAD + late[i % len(late)] for i, one in enumerate(messages)]
    results: list[float] = []
    for tick in range(90):
        now = 0.1 + tick / 60
        while received[0] <= now:
            playout.add(messages.pop(0), received.pop(0))
        results += shown(playout, now)
    apart = np.diff(results)
    assert len(results) > 80
    assert float(np.max(np.abs(apart - 1 / 60))) < 0.002


def test_a_row_is_shown_its_delay_after_it_was_measured() -> None:
    playout = PlayoutBuffer()
    playout.add(message(10.0, 0.001, 33), 10.032)
    assert shown(playout, 10.0 + DELAY_S + 0.0105) == [pytest.approx(10.010)]
    assert playout.waits
    assert shown(playout, 11.0) == [pytest.approx(10.032)]
    assert not playout.waits
    assert playout.due(12.0) is None


def test_device_time_counts_where_it_is_there_and_sane() -> None:
    burst = message(10.0, 0.001, 16)
    burst.columns[0][:] = burst.columns[0][-1]  # an adapter kept them and gave all at once
    playout = PlayoutBuffer()
    playout.add(burst, 10.015)
    assert shown(playout, 10.005 + DELAY_S + 0.0001) == [pytest.approx(10.005)]
    for device in (math.nan, 2 * FAR_S, -2 * FAR_S):
        playout = PlayoutBuffer()
        playout.add(message(10.0, 0.001, 16, device=device), 10.015)
        assert shown(playout, 10.005 + DELAY_S + 0.0001) == [pytest.approx(10.005)]


def test_rows_with_far_future_times_are_shown_and_memory_is_bounded() -> None:
    playout = PlayoutBuffer()
    playout.add(message(10.0, 0.001, 3), 10.002)
    playout.add(message(99.0, 0.001, 3, sent=10.0), 10.0)
    assert shown(playout, 10.0 + OVERDUE_S - 0.01) == [pytest.approx(10.002)]
    assert shown(playout, 10.1 + OVERDUE_S) == [pytest.approx(99.002)]
    for i in range(3 * MAX_WAITING):
        playout.add(message(float(i), 0.001, 3), float(i))
    assert len(shown(playout, *np.arange(0, 3 * MAX_WAITING, 0.001).tolist())) <= 3 * MAX_WAITING
