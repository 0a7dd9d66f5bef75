"""Robots of a fleet server: revisions, what counts as a change, and the route."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.extensions.fleet.model.reports import RobotDevice, RobotStatus
from imuscope.server.extensions.fleet.model.robots import Robots, TooManyRobotsError
from imuscope.server.extensions.fleet.model.summaries import FleetRobots, RobotSummary, summary_of
from imuscope.server.settings.config import Config
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer

NOW = 1_700_000_000.0


def device(**changed: Any) -> RobotDevice:
    figures = {
        "id": "1",
        "name": "MTi-630",
        "product": "MTi-630 AHRS",
        "serial_number": "03700001",
        "firmware": "1.12.0",
        "protocol": "xbus",
        "status": "live",
        "rate": 100.0,
        "expected_rate": 100.0,
        "loss": 0.0,
        "lost": 0,
        "fix": "",
        "temperature": 31.5,
        "clock_ppm": 4.0,
        "clock_uncertainty_ms": 0.2,
    }
    return RobotDevice(**{**figures, **changed})


def robot(name: str = "otter-7", **changed: Any) -> RobotSummary:
    status = RobotStatus(group="otters", latency_ms=21.0, version="1.0", disk_free_bytes=10**11, devices=(device(),))
    return summary_of(name, status, NOW).model_copy(update=changed)


@pytest.fixture
def robots() -> Robots:
    return Robots(now=lambda: NOW)


def answer(robots: Robots, after: int | None = None) -> FleetRobots:
    return FleetRobots.model_validate_json(robots.since(after))


def test_an_empty_fleet_is_a_valid_answer(robots: Robots) -> None:
    assert json.loads(robots.since(None)) == {
        "revision": robots.revision,
        "time": NOW,
        "complete": True,
        "gone": [],
        "robots": [],
    }


def test_after_a_revision_only_what_changed_is_listed(robots: Robots) -> None:
    robots.update(robot("a"))
    robots.update(robot("b"))
    first = answer(robots)
    assert first.complete
    assert [one.name for one in first.robots] == ["a", "b"]
    assert answer(robots, first.revision).robots == []
    robots.update(robot("a", recording=True))
    robots.remove("b")
    second = answer(robots, first.revision)
    assert not second.complete
    assert second.gone == ["b"]
    assert [(one.name, one.recording) for one in second.robots] == [("a", True)]


def test_a_robot_that_comes_back_is_not_gone(robots: Robots) -> None:
    robots.update(robot("a"))
    before = robots.revision
    robots.remove("a")
    robots.update(robot("a"))
    results = answer(robots, before)
    assert results.gone == []
    assert [one.name for one in results.robots] == ["a"]


def test_a_revision_of_another_run_is_answered_with_all(robots: Robots) -> None:
    robots.update(robot("a"))
    for other in (0, robots.revision + 1):
        results = answer(robots, other)
        assert results.complete
        assert [one.name for one in results.robots] == ["a"]


def test_removals_that_are_forgotten_are_answered_with_all(robots: Robots, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imuscope.server.extensions.fleet.model.robots.MAX_GONE", 1)
    robots.update(robot("a"))
    robots.update(robot("b"))
    before = robots.revision
    robots.remove("a")
    assert answer(robots, before).gone == ["a"]
    robots.remove("b")
    assert answer(robots, before).complete


def test_a_quiet_robot_changes_nothing(robots: Robots) -> None:
    robots.update(robot())
    revision = robots.revision
    for rate, temperature, latency in ((99.4, 31.7, 23.0), (100.6, 31.2, 18.0), (99.97, 31.5, 21.0)):
        assert not robots.update(
            robot(latency_ms=latency, devices=[device(rate=rate, temperature=temperature, clock_ppm=4.2)])
        )
    assert robots.revision == revision


@each_row(
    "changed",
    [{"rate": 98.0}, {"rate": 0.0}, {"loss": 0.00001}, {"lost": 1}, {"temperature": 32.5}, {"temperature": None}],
)
def test_what_a_person_would_see_is_a_change(robots: Robots, changed: dict[str, Any]) -> None:
    robots.update(robot())
    assert robots.update(robot(devices=[device(**changed)]))
    (result,) = answer(robots).robots
    name, value = next(iter(changed.items()))
    assert getattr(result.devices[0], name) == value


@given(st.lists(st.floats(0, 4000), min_size=2, max_size=20))
def test_a_shown_rate_is_within_a_step_of_the_true_one(rates: list[float]) -> None:
    robots = Robots(now=lambda: NOW)
    for rate in rates:
        robots.update(robot(devices=[device(rate=rate)]))
        shown = answer(robots).robots[0].devices[0].rate
        assert abs(shown - rate) <= max(0.1, 0.015 * max(rate, shown))


@given(st.lists(st.floats(1e-5, 1), min_size=2, max_size=20))
def test_a_shown_share_is_right_to_a_unit_of_its_last_digit(shares: list[float]) -> None:
    """Regression: three digits were shown of a share that kept them until it had changed by a tenth."""
    robots = Robots(now=lambda: NOW)
    for share in shares:
        robots.update(robot(devices=[device(loss=share)]))
        shown = answer(robots).robots[0].devices[0].loss
        unit = 10 ** (math.floor(math.log10(max(share, shown))) - 1)
        assert abs(shown - share) <= max(1.01 * unit, 0.0001)
        assert shown < 2e-4 or float(f"{shown:.2g}") == shown


def test_more_robots_than_the_limit_are_refused() -> None:
    robots = Robots(now=lambda: NOW, limit=1)
    robots.update(robot("a"))
    with pytest.raises(TooManyRobotsError):
        robots.update(robot("b"))
    assert robots.update(robot("a", recording=True))


@pytest.fixture
def server(tmp_path: Path) -> Iterator[InProcessServer]:
    with InProcessServer(
        Config(data=tmp_path, sources=("fake",)), FakeLink, brought=[Robots()], has_devices=False
    ) as running:
        yield running


def test_the_route_lists_robots_and_changes(server: InProcessServer) -> None:
    assert server.client.get("/api/build").json()["fleet"] is True
    server.call(server.services.parts.get(Robots).update, robot("a"))
    first = server.client.get("/api/fleet/robots").json()
    assert [one["name"] for one in first["robots"]] == ["a"]
    assert server.client.get("/api/fleet/robots", params={"after": first["revision"]}).json()["robots"] == []
    wrong = server.client.get("/api/fleet/robots", params={"after": "new"})
    assert (wrong.status_code, wrong.json()["kind"]) == (422, "bad-request")


def test_a_server_of_one_robot_states_that_it_has_no_fleet(tmp_path: Path) -> None:
    with InProcessServer(Config(data=tmp_path, sources=("fake",)), FakeLink) as running:
        assert running.client.get("/api/build").json()["fleet"] is False
        refused = running.client.get("/api/fleet/robots")
    assert refused.status_code == 404
    assert refused.json()["kind"] == "not-found"
    assert "imuscope fleet" in refused.json()["hint"]
