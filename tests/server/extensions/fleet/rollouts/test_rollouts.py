"""Rollouts: a profile applied to real servers with simulated sensors, in waves, with all that can go wrong."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model.device_settings import encode_settings
from imuscope.server.extensions.fleet.model.rollout_models import Rollout, wave_sizes
from imuscope.server.extensions.fleet.rollouts.group_profiles import GroupProfiles
from imuscope.server.extensions.fleet.rollouts.rollout_plan import plan_of
from imuscope.server.extensions.fleet.rollouts.rollouts import RolloutFiles
from imuscope.server.extensions.fleet.tunnel.robot_line import LineError, decoded
from tests.server.extensions.fleet.compared_robots import robot, settings_at
from tests.server.extensions.fleet.rollout_fleet import BRIEF, LONG_S, OTHER_HZ, PROFILE_HZ, RolloutFleet
from tests.support.each_row import each_row
from tests.support.waiting import block_until


@each_row(
    ("text", "count", "sizes"),
    [
        ("1, 5, 25 %", 40, [1, 5, 9, 7, 5, 4, 3, 2, 1, 1, 1, 1]),
        ("1, 5, 25 %", 3, [1, 2]),
        ("2", 5, [2, 2, 1]),
        ("100%", 7, [7]),
        ("1", 0, []),
    ],
)
def test_waves(text: str, count: int, sizes: list[int]) -> None:
    assert wave_sizes(text, count) == sizes


@each_row("text", ["", "0", "1,", "101 %", "0 %", "-1", "1.5", "x", ",".join("1" * 21), "999999"])
def test_waves_that_cannot_be_used(text: str) -> None:
    with pytest.raises(DomainError, match="waves: "):
        wave_sizes(text, 5)


@pytest.fixture(scope="module")
def four_robots(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RolloutFleet]:
    with RolloutFleet(tmp_path_factory.mktemp("fleet"), "abcd") as fleet:
        yield fleet


@pytest.fixture
def fleet(four_robots: RolloutFleet) -> RolloutFleet:
    """A fleet that several tests share, whose robots come back from what each did to them."""
    four_robots.reset()
    return four_robots


def test_a_profile_is_applied_in_waves_and_confirmed(fleet: RolloutFleet) -> None:
    plan = fleet.plan()
    assert [one["robot"] for one in plan["devices"]] == ["b", "c", "d"]
    assert (plan["waves"], plan["same"], plan["left_out"]) == ([1, 2], 1, [])
    assert [one["change"] for one in plan["devices"]] == [0, 0, 0]
    changes = [(one["now"], one["profile"]) for one in plan["changes"][0]["rows"]]
    assert (f"{OTHER_HZ} Hz", f"{PROFILE_HZ} Hz") in changes
    assert fleet.plan(waves="100 %")["waves"] == [3]
    assert fleet.start("another").json()["kind"] == "changed"
    assert fleet.start(plan["id"], by=" ").json()["kind"] == "bad-value"
    assert fleet.start(plan["id"], waves="none").json()["kind"] == "bad-value"
    fleet.roll_out(watch_s=1)
    assert fleet.start(plan["id"]).json()["kind"] == "busy"
    over = fleet.until_over()
    assert (over["state"], fleet.states()) == ("done", dict.fromkeys("bcd", "done")), over
    for name in "bcd":
        assert fleet.rate(name) == PROFILE_HZ
        assert fleet.rollback(name) == "confirmed"
    number = fleet.number
    report = f"Command through the fleet server of Ada, rollout {number}: POST /api/devices/1/apply."
    fleet.until_event("b", report)
    fleet.until_event("b", f"Rollout {number} of Ada, MTi-630: done.")
    fleet.until_event("", f"Rollout {number} to 3 devices of the group otters was started by Ada.")
    block_until(lambda: fleet.plan()["same"] == 4, "all are as the profile")
    assert fleet.start(fleet.plan()["id"]).json()["kind"] == "not-now"
    assert fleet.send(f"rollouts/{number}/stop", by="Ada").json()["kind"] == "not-now"
    assert fleet.send("rollouts/77/stop", by="Ada").status_code == 404


def test_a_device_that_stops_to_deliver_is_rolled_back_and_the_next_wave_does_not_begin(
    fleet: RolloutFleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fleet.rollouts, "_timing", replace(BRIEF, watch_more_s=0.1))  # nothing arrives, however long
    plan = fleet.plan()["id"]
    monkeypatch.setattr(XbusSimulator, "_due", no_samples(XbusSimulator._due))
    assert fleet.start(plan, watch_s=1).status_code == 202
    over = fleet.until_over()
    not_started = {"c": "not-started", "d": "not-started"}
    assert (over["state"], fleet.states()) == ("failed", {"b": "failed", **not_started}), over
    assert over["words"].startswith("b, MTi-630: It delivered ")
    assert over["words"].endswith(" 2 were not started.")
    assert f"instead of {PROFILE_HZ}. The device was rolled back" in over["words"]
    assert fleet.rollback("b") == "rolled-back"
    assert [fleet.rate(name) for name in "bcd"] == [OTHER_HZ] * 3
    assert not any(f"rollout {fleet.number}:" in text for name in "cd" for text in fleet.events(name))


def no_samples(due: Callable[[XbusSimulator, int, list[bytes]], None]) -> Callable[..., None]:
    """Samples that are due, except those of a device with the settings of the profile."""

    def silent(device: XbusSimulator, now: int, out: list[bytes]) -> None:
        if any(frequency == OTHER_HZ for _, frequency in device.output):
            due(device, now, out)

    return silent


def test_a_change_that_is_rolled_back_at_the_robot_stops_the_next_wave(fleet: RolloutFleet) -> None:
    fleet.roll_out()
    fleet.until_state("b", "watching")
    assert fleet.post("b", "roll-back", {}).status_code == 200
    over = fleet.until_over()
    assert fleet.states() == {"b": "failed", "c": "not-started", "d": "not-started"}, over
    assert over["devices"][0]["words"] == "The device was rolled back to the old settings, as requested."


OWN_HZ = 5  # that somebody sets at the robot


def test_settings_that_a_user_changed_in_the_meantime_are_not_overwritten(fleet: RolloutFleet) -> None:
    fleet.roll_out(waves="1")
    fleet.until_state("b", "watching")
    outputs = fleet.values("c")["OutputConfiguration"]
    for one in outputs["outputs"]:
        one["output_frequency"] = OWN_HZ if one["output_frequency"] == OTHER_HZ else one["output_frequency"]
    fleet.post("c", "apply", {"changes": {"OutputConfiguration": outputs}, "confirmed": True})
    block_until(lambda: fleet.rate("c") == OWN_HZ, "it is changed")
    fleet.confirm("b")
    over = fleet.until_over()
    assert fleet.states() == {"b": "done", "c": "failed", "d": "not-started"}, over
    assert "was changed by another client" in over["words"]
    assert [fleet.rate(name) for name in "bcd"] == [PROFILE_HZ, OWN_HZ, OTHER_HZ]


def test_a_robot_whose_line_is_cut_rolls_back_by_itself(tmp_path: Path) -> None:
    with RolloutFleet(tmp_path, behind="b") as fleet:
        fleet.roll_out()
        fleet.until_state("b", "watching")
        fleet.lines["b"].cut()
        over = fleet.until_over()
        assert (over["state"], fleet.states()) == ("failed", {"b": "unknown", "c": "not-started"}), over
        assert "The robot rolls back by itself unless the settings were confirmed" in over["words"]
        assert fleet.rollback("b") == "pending"
        fleet.robots["b"].turn(2 * LONG_S)
        block_until(lambda: fleet.rollback("b") == "rolled-back", lambda: fleet.rollback("b"))
        block_until(lambda: fleet.rate("b") == OTHER_HZ, "it has its old settings")
        assert fleet.rate("c") == OTHER_HZ


def test_a_stop_finishes_what_has_begun_and_begins_nothing_else(fleet: RolloutFleet) -> None:
    fleet.roll_out()
    fleet.until_state("b", "watching")
    assert fleet.send(f"rollouts/{fleet.number}/stop", by="  ").json()["kind"] == "bad-value"
    assert fleet.send(f"rollouts/{fleet.number}/stop", by="Ben").json()["stopped_by"] == "Ben"
    fleet.confirm("b")
    over = fleet.until_over()
    assert (over["state"], over["words"]) == ("stopped", "Stopped by Ben: 2 not started."), over
    assert fleet.states() == {"b": "done", "c": "not-started", "d": "not-started"}
    assert [fleet.rate(name) for name in "bcd"] == [PROFILE_HZ, OTHER_HZ, OTHER_HZ]
    fleet.until_event("", f"Rollout {fleet.number} was stopped by Ben.")


def test_a_robot_that_is_lost_before_its_turn_is_left(tmp_path: Path) -> None:
    with RolloutFleet(tmp_path, "abcd", behind="cd") as fleet:
        fleet.lose("d")
        plan = fleet.plan()
        assert [(one["robot"], one["why"]) for one in plan["left_out"]] == [("d", "The robot is lost.")]
        fleet.roll_out()
        fleet.until_state("b", "watching")
        fleet.lose("c")
        fleet.confirm("b")
        over = fleet.until_over()
        assert (over["state"], over["words"]) == ("done", "1 of 2 left out."), over
        assert fleet.states() == {"b": "done", "c": "left"}
        assert over["devices"][1]["words"] == "The robot was lost before anything was sent."


def test_a_fleet_server_that_is_killed_states_what_it_interrupted_and_sends_nothing_again(tmp_path: Path) -> None:
    with RolloutFleet(tmp_path, is_process=True) as fleet:
        fleet.roll_out()
        fleet.until_state("b", "watching")
        fleet.kill()
        fleet.robots["b"].turn(2 * LONG_S)
        block_until(lambda: fleet.rollback("b") == "rolled-back", lambda: fleet.rollback("b"))
        fleet.begin()
        over = fleet.rollout()
        assert (over["state"], fleet.states()) == ("interrupted", {"b": "unknown", "c": "not-started"}), over
        stored = ("applying", "watching")  # the file may be a moment behind what was shown
        begins = tuple(f"The fleet server ended while this device was {one}. " for one in stored)
        assert over["devices"][0]["words"].startswith(begins)
        block_until(lambda: fleet.summary("c")["state"] == "live" and fleet.summary("b")["state"] == "live", "all back")
        block_until(lambda: fleet.summary("b")["settings"] == "drifted", "b is compared again")
        assert [fleet.rate(name) for name in "bc"] == [OTHER_HZ, OTHER_HZ]
        assert not any("apply" in text for text in fleet.events("c"))
        block_until(lambda: sum("/apply" in text for text in fleet.events("b")) == 1, lambda: fleet.events("b"))
        block_until(lambda: len(fleet.plan()["devices"]) == 2, lambda: fleet.plan())
        assert fleet.start(fleet.plan()["id"], by="Ben").json()["id"] == 2


def test_a_damaged_file_stays_and_its_number_is_not_given_again(tmp_path: Path) -> None:
    files = RolloutFiles(tmp_path)
    assert (files.all(), files.next_id()) == ([], 1)
    files.save(4, "{")
    assert (files.all(), files.next_id()) == ([], 5)
    (tmp_path / "rollouts").rename(tmp_path / "elsewhere")
    (tmp_path / "rollouts").write_text("in the way")
    with pytest.raises(DomainError, match="cannot be stored"):
        files.save(5, "{}")
    assert Rollout.model_fields["state"].default == "running"


texts = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=10,
)


@given(st.integers(200, 599), st.binary(max_size=60) | texts.map(lambda one: json.dumps(one).encode()))
@example(200, b"[" * 100_000)
@example(500, b'{"message": "\xff"}')
@example(409, b'{"kind": "bad-subprotocol", "message": "\\u001b[2J"}')
def test_what_a_robot_answers_does_no_harm(status: int, data: bytes) -> None:
    with contextlib.suppress(LineError, DomainError):
        result = decoded(status, data, dict[str, Any])
        assert isinstance(result, dict)


def test_a_plan_of_thousands_examines_each_kind_of_settings_once(tmp_path: Path) -> None:
    driver = PROTOCOLS["xbus"].configuration.driver
    assert driver is not None
    profiles = GroupProfiles(tmp_path)
    right, *wrong = [settings_at(rate) for rate in (100, 50, 200)]
    for one in (right, *wrong):
        profiles.learn(encode_settings(one))
    first = robot("a", right)
    profile = profiles.use(first, first.devices[0], "Ada", 5.0)
    others = [
        robot(f"r{n}", wrong[n % 2]).model_copy(update={"pages": "view" if n < 6 else "control"}) for n in range(3000)
    ]
    requests: list[object] = []

    class Counted:
        def __getattr__(self, name: str) -> Any:
            requests.append(name)
            return getattr(driver, name)

    plan = plan_of(profiles, [first, *others], profile, Counted())  # type: ignore[arg-type]
    assert (len(plan.devices), len(plan.left_out), len(plan.changes), plan.same) == (2994, 6, 2, 1)
    assert 'set pages = "control"' in plan.left_out[0].why
    assert requests.count("settings") == 2
    again = plan_of(profiles, [first, *others], profile, driver)
    assert again.id == plan.id
    assert plan_of(profiles, [first, *others[:-1]], profile, driver).id != plan.id
