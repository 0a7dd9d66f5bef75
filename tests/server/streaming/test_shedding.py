"""Shedding of load while decoding is behind, and the reason for that."""

from __future__ import annotations

from pathlib import Path

import pytest

from imuscope.server.concurrency.heartbeat import UNWATCHED_S
from imuscope.server.devices.link.sessions import OVER_S, ProcessorUse
from imuscope.server.streaming.clients import FLUSH_S
from imuscope.server.streaming.send_queue import SendQueue
from imuscope.server.streaming.shedding import CALM_S, KEEPS_UP_S, PAGE_INTERVAL_S, PICTURE_FACTOR, PICTURES_S, Shedding
from imuscope.server.streaming.telemetry import Telemetry

TICK_S = 0.1


def after(behind: list[float]) -> list[int]:
    """Steps of a server that is behind by these times, tick by tick."""
    shedding, steps = Shedding(), []
    for k, one in enumerate(behind):
        shedding.update(one, k * TICK_S)
        steps.append(shedding.step)
    return steps


def test_pictures_are_left_out_before_rates_of_pages() -> None:
    assert after([0.0, 0.25, 0.35, 0.45, 0.55, 9.0]) == [0, 0, 1, 1, 2, 2]


def test_turns_without_viewers_are_no_delay() -> None:
    assert UNWATCHED_S < KEEPS_UP_S < PICTURES_S
    assert set(after([UNWATCHED_S] * 9)) == {0}


def test_each_step_is_taken_back_once_decoding_has_kept_up() -> None:
    calm = round(CALM_S / TICK_S)
    steps = after([2.0] + [0.05] * (2 * calm + 4))
    assert steps[0] == steps[calm - 1] == 2
    assert steps[calm + 2] == 1
    assert steps[-1] == 0
    assert set(after([2.0, *([0.05] * (calm - 2) + [1.0]) * 4])) == {2}, "it has not kept up for long enough"


def test_pages_and_pictures_wait_longer_while_decoding_is_behind() -> None:
    telemetry = Telemetry.create(lambda: 0.0)
    telemetry.clients.attach(SendQueue())
    assert telemetry.clients.sample_interval == FLUSH_S
    assert telemetry.shedding.draws_pictures
    telemetry.shedding.update(1.0, 0.0)
    assert telemetry.clients.sample_interval == PAGE_INTERVAL_S
    assert telemetry.clients.shedding.picture_factor == PICTURE_FACTOR
    assert not telemetry.shedding.draws_pictures


@pytest.mark.parametrize(
    ("ran", "waited", "reason"),
    [(0.1, 0.0, ""), (0.5, 0.1, ""), (0.3, 0.6, "others"), (0.7, 0.29, "others"), (0.9, 0.05, "decoding")],
)
def test_a_reason_is_reported_only_if_it_is_counted(tmp_path: Path, ran: float, waited: float, reason: str) -> None:
    counters = tmp_path / "schedstat"
    use = ProcessorUse(counters)
    use.update(0.0)
    assert use.reason == "", "nothing is counted here"
    counters.write_text("1000 500 7")
    use.update(1.0)
    assert use.reason == ""
    counters.write_text(f"{1000 + round(ran * OVER_S * 1e9)} {500 + round(waited * OVER_S * 1e9)} 9")
    use.update(1.0 + OVER_S)
    assert use.reason == reason
