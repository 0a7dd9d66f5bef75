"""Alarms of a fleet server: raised, acknowledged by name, kept over a restart, posted once."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import httpx
import pytest

from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model.fleet_settings import FleetServerSettings
from imuscope.server.extensions.fleet.model.reports import RobotDevice, RobotStatus
from imuscope.server.extensions.fleet.model.summaries import RobotSummary, summary_of
from imuscope.server.extensions.fleet.server.fleet_alarms import FILE, FleetAlarms
from imuscope.server.extensions.fleet.server.fleet_command import create_fleet_server
from imuscope.server.settings.config import Config
from tests.server.extensions.alarms.webhook_receiver import Receiver, receiver
from tests.server.extensions.fleet.fleet_robot import FleetRobot
from tests.support.each_row import each_row
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, get
from tests.support.waiting import block_until, until

NOW = 1_700_000_000.0
__all__ = ["receiver"]  # a fixture
LIMITS = FleetServerSettings(alarm_lost_s=60, alarm_loss_percent=1, alarm_disk_gb=2)


def robot(loss: float = 0.0, free: int = 10**11, *, is_live: bool = True, drifted: int = 0) -> RobotSummary:
    device = RobotDevice("1", "MTi", "live", loss=loss)
    status = RobotStatus(group="otters", disk_free_bytes=free, devices=(device,))
    result = summary_of("a", status, NOW, is_live=is_live)
    return result.model_copy(update={"drifted": drifted, "settings": "drifted" if drifted else "as-profile"})


class Judged:
    """A fleet server's alarms with one robot."""

    def __init__(self, folder: Path, limits: FleetServerSettings = LIMITS) -> None:
        self.alarms = FleetAlarms(folder, limits)
        self.events: list[tuple[str, str]] = []

    def judge(self, shown: RobotSummary, now: float = NOW) -> list[tuple[str, str]]:
        """Condition and state of the alarms after a turn."""
        self.alarms.turn({"a": shown}, now, lambda name, level, text: self.events.append((level, text)))
        return [(one.condition, one.state) for one in self.alarms.with_alarms(shown).alarms]


def test_a_robot_that_is_lost_raises_an_alarm_after_a_time_and_once(tmp_path: Path) -> None:
    judged = Judged(tmp_path)
    away = robot(is_live=False)
    assert judged.judge(away, NOW + 60) == []
    for later in (61, 62, 600):
        assert judged.judge(away, NOW + later) == [("lost", "raised")]
    assert judged.events == [("error", "a has been lost for 61 s.")]
    assert judged.judge(robot(), NOW + 700) == []
    assert judged.events[1:] == [("info", "Lost for longer than 60 s: no longer.")]


@each_row(
    ("condition", "bad", "between", "good"),
    [
        ("loss", robot(loss=0.02), robot(loss=0.009), robot(loss=0.001)),
        ("disk", robot(free=10**9), robot(free=2_100_000_000), robot()),
        ("settings", robot(drifted=3), robot(drifted=1), robot()),
    ],
)
def test_a_condition_ends_below_its_limit_only(
    tmp_path: Path, condition: str, bad: RobotSummary, between: RobotSummary, good: RobotSummary
) -> None:
    judged = Judged(tmp_path)
    assert judged.judge(bad, NOW) == [(condition, "raised")]
    assert judged.judge(between, NOW + 1) == [(condition, "raised")]
    away = bad.model_copy(update={"state": "lost", "since": NOW + 1})
    assert judged.judge(away, NOW + 2) == [(condition, "raised")]  # of what is lost nothing is known
    assert judged.judge(good, NOW + 3) == []
    assert [level for level, _ in judged.events] == ["warning", "info"]


def test_a_limit_of_zero_switches_a_condition_off(tmp_path: Path) -> None:
    off = FleetServerSettings(alarm_lost_s=0, alarm_loss_percent=0, alarm_disk_gb=0, alarm_settings=False)
    shown = robot(loss=0.5, free=0, is_live=False, drifted=4)
    assert Judged(tmp_path, off).judge(shown, NOW + 1e6) == []


def test_an_acknowledgement_has_a_name_and_outlives_the_server(tmp_path: Path) -> None:
    judged = Judged(tmp_path)
    judged.judge(robot(loss=0.5))
    with pytest.raises(DomainError, match="name of the person"):
        judged.alarms.acknowledge("a", "loss", "  ", NOW)
    with pytest.raises(DomainError, match="no alarm"):
        judged.alarms.acknowledge("a", "disk", "Ada", NOW)
    judged.alarms.acknowledge("a", "loss", " Ada  L. ", NOW)
    judged.alarms.save(judged.alarms.saved_text())
    again = Judged(tmp_path)
    assert again.judge(robot(loss=0.5)) == [("loss", "acknowledged")]
    assert again.alarms.with_alarms(robot()).alarms[0].acknowledged_by == "Ada L."
    assert again.events == []
    assert again.judge(robot()) == []
    assert again.judge(robot(loss=0.5)) == [("loss", "raised")]  # another time


@each_row("has_profile", [True, False])
def test_settings_that_are_read_again_keep_their_alarm_and_a_removed_profile_ends_it(
    tmp_path: Path, has_profile: bool
) -> None:
    judged = Judged(tmp_path)
    judged.alarms = FleetAlarms(tmp_path, LIMITS, lambda robot: has_profile)
    judged.judge(robot(drifted=1))
    assert judged.events == [("warning", "a has 1 setting not as in the profile of its group.")]
    unknown = robot().model_copy(update={"settings": "unknown"})
    assert judged.judge(unknown) == ([("settings", "raised")] if has_profile else [])


def test_what_could_not_be_stored_is_stored_later(tmp_path: Path) -> None:
    judged = Judged(tmp_path / "folder")
    judged.judge(robot(loss=0.5))
    (tmp_path / "folder").write_text("in the way")
    judged.alarms.save(judged.alarms.saved_text())
    assert judged.alarms.is_changed
    (tmp_path / "folder").unlink()
    asyncio.run(judged.alarms.close())
    assert Judged(tmp_path / "folder").judge(robot(loss=0.5)) == [("loss", "raised")]


def test_a_damaged_file_begins_again(tmp_path: Path) -> None:
    for text in (
        "",
        "[]",
        '{"alarms": [{"robot": 1}]}',
        '{"alarms": [{"robot": "a", "condition": "loss", "state": 3}]}',
    ):
        (tmp_path / FILE).write_text(text)
        assert Judged(tmp_path).judge(robot()) == []


def test_a_robot_that_was_removed_has_no_alarm(tmp_path: Path) -> None:
    judged = Judged(tmp_path)
    judged.judge(robot(loss=0.5))
    judged.alarms.turn({}, NOW + 1, lambda *_: None)
    assert judged.alarms.with_alarms(robot()).alarms == []


def test_a_lost_robot_is_reported_on_the_page_and_by_webhook(tmp_path: Path, receiver: Receiver) -> None:
    bodies = receiver.bodies
    config = tmp_path / "fleet.toml"
    config.write_text(f'[fleet_server]\nalarm_lost_s = 0.5\nalarm_webhook = "{receiver.url}"\n')
    bus = f"tcp/127.0.0.1:{free_port()}"
    arguments = ("--listen", bus, "--config", str(config))
    with ServerProcess(data=tmp_path / "fleet", arguments=arguments, command="fleet") as server:
        at = f"{server.url}/api/fleet/robots"

        def alarms() -> list[tuple[str, str, str]]:
            robots = get(at).json()["robots"]
            return [(one["condition"], one["state"], one["acknowledged_by"]) for row in robots for one in row["alarms"]]

        with FleetRobot("a", bus) as joined:
            joined.report(1)
            block_until(lambda: get(at).json()["robots"], "the robot has joined")
        block_until(lambda: alarms() == [("lost", "raised", "")], "it is missed")
        block_until(lambda: bodies, "the webhook is called")
        assert (bodies[0]["alarm"], bodies[0]["change"], bodies[0]["robot"]["name"]) == ("lost", "raised", "a")
        body = {"condition": "lost", "by": "Ada"}
        assert httpx.post(f"{at}/a/acknowledge", json=body, timeout=PATIENCE_S).status_code == 204
        assert alarms() == [("lost", "acknowledged", "Ada")]
        assert httpx.post(f"{at}/a/acknowledge", json={**body, "by": ""}, timeout=PATIENCE_S).status_code == 422
        with FleetRobot("a", bus) as joined:
            joined.report(2)
            block_until(lambda: alarms() == [], "it is back")
            block_until(lambda: len(bodies) == 2, "the webhook is called again")
        assert bodies[1]["change"] == "cleared"


async def test_the_last_state_is_stored_at_the_end_though_an_earlier_one_is_being_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An alarm that had just been acknowledged was not after the restart."""
    server = create_fleet_server(Config(data=tmp_path))
    texts, begun, may_write, written = iter("12"), threading.Event(), threading.Event(), list[str]()

    def saved_text() -> str:
        server.alarms.is_changed = False
        return next(texts)

    def slow(text: str) -> None:
        if text == "1":
            begun.set()
            may_write.wait(PATIENCE_S)
        written.append(text)

    monkeypatch.setattr(server.alarms, "saved_text", saved_text)
    monkeypatch.setattr(server.alarms, "save", slow)
    server.alarms.is_changed = True
    server._writing = asyncio.create_task(server._write())
    await until(begun.is_set, "it is being written")
    server.alarms.is_changed = True
    closing = asyncio.create_task(server.close())
    await asyncio.sleep(0.1)  # the last state would overtake the earlier here
    may_write.set()
    await closing
    assert written == ["1", "2"]
