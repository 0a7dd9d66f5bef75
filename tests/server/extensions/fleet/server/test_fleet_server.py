"""Robots and a fleet server over a real Zenoh router: joining, restarts, access."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import zenoh

from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.access import (
    FleetAccessError,
    RouterSettings,
    access_rules,
    as_document,
    read_robots,
)
from imuscope.server.extensions.fleet.model.bus import BusCredentials, open_bus
from imuscope.server.extensions.fleet.model.reports import RobotReport, RobotStatus, encode
from tests.server.extensions.fleet.fleet_robot import FleetRobot
from tests.support.each_row import each_row
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess, imuscope
from tests.support.timeouts import PATIENCE_S, get
from tests.support.waiting import block_until

PASSWORDS = {"a": "password-of-a", "b": "password-of-b"}


@pytest.fixture
def bus() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


def serve_fleet(bus: str, data: Path, *arguments: str) -> ServerProcess:
    return ServerProcess(data=data, arguments=("--listen", bus, *arguments), command="fleet")


def robots_of(server: ServerProcess) -> dict[str, dict[str, Any]]:
    return {one["name"]: one for one in get(f"{server.url}/api/fleet/robots").json()["robots"]}


def state_of(server: ServerProcess, name: str) -> str:
    return str(robots_of(server).get(name, {}).get("state", "absent"))


def lost_of(server: ServerProcess, name: str) -> int:
    """The number that the robot last reported."""
    devices = robots_of(server).get(name, {}).get("devices") or [{"lost": -1}]
    return int(devices[0]["lost"])


def markers(data: Path) -> dict[str, list[int]]:
    """Numbers of the stored events of each robot, in order."""
    file = sqlite3.connect(data / "fleet" / "fleet.sqlite")
    rows = file.execute("SELECT robot, text FROM events WHERE kind = 'marker' ORDER BY id").fetchall()
    file.close()
    results: dict[str, list[int]] = {}
    for robot, text in rows:
        results.setdefault(robot, []).append(int(text))
    return results


def has_markers(data: Path, name: str, last: int) -> bool:
    return markers(data).get(name, [0])[-1] == last


def test_a_robot_joins_with_its_devices_and_is_lost_when_it_ends(bus: str, tmp_path: Path) -> None:
    config = tmp_path / "robot.toml"
    config.write_text(
        f'[fleet]\nrouter = "{bus}"\nname = "otter-7"\ngroup = "otters"\naddress = "http://otter-7:8080/"\n'
    )
    arguments = ("--config", str(config))
    with serve_fleet(bus, tmp_path / "fleet") as server:
        assert get(f"{server.url}/api/build").json()["fleet"] is True
        assert get(f"{server.url}/api/devices").json() == []
        with ServerProcess("sim:xbus?product=MTi-630&rate=10", data=tmp_path / "robot", arguments=arguments):

            def device() -> dict[str, Any]:
                return next(iter(robots_of(server).get("otter-7", {}).get("devices", [])), {})

            block_until(lambda: device().get("rate", 0) > 5 and device()["serial_number"], "the device is shown")
            robot = robots_of(server)["otter-7"]
            assert (robot["state"], robot["group"], robot["address"]) == ("live", "otters", "http://otter-7:8080/")
            assert robot["disk_free_bytes"] > 0
            assert device()["product"].startswith("MTi-630")
            assert device()["loss"] == 0
            block_until(lambda: robots_of(server)["otter-7"]["latency_ms"] is not None, "the latency is measured")
        block_until(lambda: state_of(server, "otter-7") == "lost", "the robot is lost")
        assert robots_of(server)["otter-7"]["version"] == robot["version"]


def test_a_robot_waits_for_its_fleet_and_keeps_what_happens(bus: str, tmp_path: Path) -> None:
    with FleetRobot("a", bus) as robot:
        for number in range(1, 21):
            robot.report(number)
        with serve_fleet(bus, tmp_path) as server:
            block_until(lambda: lost_of(server, "a") == 20, "the reports of before are there")
            block_until(lambda: has_markers(tmp_path, "a", 20), "they are stored")
    assert markers(tmp_path) == {"a": list(range(1, 21))}


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_a_fleet_server_that_is_restarted_has_everything_once(bus: str, tmp_path: Path, how: signal.Signals) -> None:
    with FleetRobot("a", bus) as first, FleetRobot("b", bus) as second:
        with serve_fleet(bus, tmp_path) as server:
            block_until(lambda: set(robots_of(server)) == {"a", "b"}, "both have joined")
            for number in range(1, 11):
                first.report(number)
                second.report(number)
            block_until(lambda: lost_of(server, "a") == lost_of(server, "b") == 10, "both have reported")
            since = robots_of(server)["a"]["since"]
            block_until(lambda: has_markers(tmp_path, "b", 10), "the reports are stored")
            os.kill(server.process.pid, how)
            server.process.wait()
        for number in range(11, 31):
            first.report(number)
            second.report(number)
        with serve_fleet(bus, tmp_path) as server:
            block_until(lambda: lost_of(server, "a") == lost_of(server, "b") == 30, "what happened meanwhile is there")
            assert (state_of(server, "a"), state_of(server, "b")) == ("live", "live")
            assert robots_of(server)["a"]["since"] == since
            block_until(lambda: has_markers(tmp_path, "a", 30) and has_markers(tmp_path, "b", 30), "it is stored")
    assert markers(tmp_path) == {"a": list(range(1, 31)), "b": list(range(1, 31))}


def test_a_router_between_may_be_restarted(bus: str, tmp_path: Path) -> None:
    router = RouterSettings(bus)
    arguments = ("--router", bus)
    between = open_bus(router.settings())
    server = None
    try:
        with FleetRobot("a", bus) as robot:
            server = ServerProcess(data=tmp_path, arguments=arguments, command="fleet")
            block_until(lambda: state_of(server, "a") == "live", "it has joined")
            robot.report(1)
            block_until(lambda: lost_of(server, "a") == 1, "it has reported")
            between.close()
            block_until(lambda: state_of(server, "a") == "lost", "the line is lost")
            robot.report(2)
            between = open_bus(router.settings())
            block_until(lambda: lost_of(server, "a") == 2, "what happened meanwhile is there")
            assert state_of(server, "a") == "live"
            block_until(lambda: has_markers(tmp_path, "a", 2), "it is stored")
    finally:
        between.close()
        if server is not None:
            server.stop()
    assert markers(tmp_path) == {"a": [1, 2]}


def test_events_are_listed_and_a_lost_robot_is_removed(bus: str, tmp_path: Path) -> None:
    with serve_fleet(bus, tmp_path) as server:
        url = f"{server.url}/api/fleet"
        with FleetRobot("a", bus) as robot, FleetRobot("b", bus) as other:
            for number in range(1, 6):
                robot.report(number)
            other.report(9)

            def texts(**query: object) -> list[str]:
                return [one["text"] for one in get(f"{url}/events", params=query).json()]

            block_until(lambda: texts(robot="a") == ["5", "4", "3", "2", "1"], "the events are stored")
            block_until(lambda: texts(robot="b") == ["9"], "those of the other, too")
            newest = get(f"{url}/events", params={"robot": "a", "limit": 2}).json()
            assert [one["text"] for one in newest] == ["5", "4"]
            assert texts(robot="a", before=newest[-1]["id"]) == ["3", "2", "1"]
            refused = httpx.delete(f"{url}/robots/a", timeout=PATIENCE_S)
            assert (refused.status_code, refused.json()["kind"]) == (409, "not-now")
        block_until(lambda: state_of(server, "a") == "lost", "the robot is lost")
        revision = get(f"{url}/robots").json()["revision"]
        assert httpx.delete(f"{url}/robots/a", timeout=PATIENCE_S).status_code == 204
        assert get(f"{url}/robots", params={"after": revision}).json()["gone"] == ["a"]
        assert httpx.delete(f"{url}/robots/a", timeout=PATIENCE_S).status_code == 404
        assert texts(robot="a", limit=1) == ["5"]


def test_a_fleet_server_waits_for_its_router(bus: str, tmp_path: Path) -> None:
    with ServerProcess(data=tmp_path, arguments=("--router", bus), command="fleet") as server:
        assert robots_of(server) == {}
        between = open_bus(RouterSettings(bus).settings())
        try:
            with FleetRobot("a", bus) as robot:
                robot.report(1)
                block_until(lambda: lost_of(server, "a") == 1, "the robot is shown")
        finally:
            between.close()
    with ServerProcess(data=tmp_path, arguments=("--router", bus), command="fleet") as server:
        assert server.stop() == 0, "it ends while it waits"


@pytest.fixture
def guarded(bus: str, tmp_path: Path) -> Iterator[tuple[ServerProcess, Path]]:
    """A fleet server whose robots have passwords, and the file of these."""
    robots = tmp_path / "robots.txt"
    robots.write_text("".join(f"{name}:{password}\n" for name, password in PASSWORDS.items()))
    with serve_fleet(bus, tmp_path / "data", "--robots", str(robots)) as server:
        yield server, robots


def member(name: str, bus: str) -> FleetRobot:
    robot = FleetRobot(name, bus, BusCredentials(user=name, password=PASSWORDS[name]))
    block_until(robot.opened.is_set, f"{name} is connected")
    return robot


def test_a_robot_can_neither_pose_as_another_nor_read_it(bus: str, guarded: tuple[ServerProcess, Path]) -> None:
    server, _ = guarded
    with member("a", bus) as a, member("b", bus) as b:
        block_until(lambda: set(robots_of(server)) == {"a", "b"}, "both have joined")
        b.report(1)
        block_until(lambda: lost_of(server, "b") == 1, "b has reported")
        assert a.session is not None
        read: list[str] = []
        held = [
            a.session.declare_subscriber(
                key, lambda sample: read.append(str(sample.key_expr)), allowed_origin=zenoh.Locality.REMOTE
            )
            for key in ("**", keys.report_key("b"))
        ]
        answers = list(a.session.get(keys.journal_key("b"), timeout=PATIENCE_S))
        assert [one for one in answers if one.ok is not None] == []
        forged = encode(RobotReport(b.journal.boot, 2, 0.0, status=RobotStatus(version="forged")))
        for key in (keys.report_key("b"), keys.ALL_REPORTS, f"{keys.ROOT}/**"):
            a.session.put(key, forged)
        token = a.session.liveliness().declare_token(keys.token_key("b", "f" * 16))
        a.report(7)
        block_until(lambda: lost_of(server, "a") == 7, "what a says of itself arrives, after what it said of b")
        b.report(2)
        block_until(lambda: lost_of(server, "b") == 2, "b itself is received")
        assert robots_of(server)["b"]["version"] == "1.0"
        assert [one for one in a.session.get(keys.CLOCK, timeout=PATIENCE_S) if one.ok is not None] != []
        assert read == []
        del token, held
        metrics = get(f"{server.url}/metrics").text
        assert 'imuscope_fleet_reports_total{result="unannounced"} 0' in metrics
        assert 'imuscope_fleet_reports_total{result="invalid"} 0' in metrics


def test_removing_a_line_revokes_a_robot(bus: str, guarded: tuple[ServerProcess, Path]) -> None:
    server, robots = guarded
    with member("a", bus) as a, member("b", bus) as b:
        block_until(lambda: state_of(server, "a") == state_of(server, "b") == "live", "both have joined")
        robots.write_text(f"b:{PASSWORDS['b']}\n")
        block_until(lambda: state_of(server, "a") == "lost", "a is out")
        block_until(lambda: state_of(server, "b") == "live", "b is back")
        a.report(1)
        b.report(1)
        block_until(lambda: lost_of(server, "b") == 1, "b reports")
        assert (state_of(server, "a"), lost_of(server, "a")) == ("lost", -1)


def test_a_wrong_password_does_not_connect(bus: str, guarded: tuple[ServerProcess, Path]) -> None:
    server, _ = guarded
    with FleetRobot("a", bus, BusCredentials(user="a", password="password-of-b")) as wrong, member("b", bus):
        block_until(lambda: state_of(server, "b") == "live", "b has joined")
        assert not wrong.opened.is_set()
        assert state_of(server, "a") == "absent"


def test_the_printed_configuration_is_that_of_a_router(tmp_path: Path) -> None:
    robots = tmp_path / "robots.txt"
    robots.write_text("a:password-of-a\n")
    printed = imuscope("fleet", "--router-config", "--listen", "tcp/127.0.0.1:7447", "--robots", str(robots))
    assert printed.returncode == 0, printed.stderr
    document = json.loads(printed.stdout)
    config = zenoh.Config.from_json5(printed.stdout)
    assert json.loads(config.get_json("access_control"))["enabled"] is True
    assert document == as_document(RouterSettings("tcp/127.0.0.1:7447", read_robots(robots)).settings())


def test_rules_name_each_robot_once(tmp_path: Path) -> None:
    robots = tmp_path / "robots.txt"
    robots.write_text("a\n\nb\n")
    rules = access_rules(read_robots(robots))
    assert rules["default_permission"] == "deny"
    assert [one["cert_common_names"] for one in rules["subjects"]] == [["a"], ["b"]]
    assert max(Counter(rule["id"] for rule in rules["rules"]).values()) == 1


@each_row(
    ("text", "words"),
    [
        ("a/b:password-of-a", "Line 1"),
        ("*:password-of-a", "is not a name"),
        ("a:password-of-a\na:password-of-b", "twice"),
        ("a:short", "too short"),
        ("a:password-of-a\nb", "every robot a password, or none"),
    ],
)
def test_a_file_of_robots_with_a_mistake_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "robots.txt"
    path.write_text(text)
    with pytest.raises(FleetAccessError, match=words):
        read_robots(path)


@each_row(
    ("arguments", "words"),
    [
        (("--listen", "tcp/0.0.0.0:7447"), "could pose as a robot"),
        (("--listen", "tls/0.0.0.0:7447"), "--robots"),
        (("--listen", "tcp/127.0.0.1:7447", "--router", "tcp/127.0.0.1:7448"), "exclude each other"),
        (("--listen", "127.0.0.1:7447"), "is not an address"),
        (("--robots", "/nowhere/robots.txt"), "cannot be read"),
    ],
)
def test_what_is_not_safe_or_not_valid_is_refused_in_one_line(
    tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    refused = imuscope("fleet", *arguments, "--port", "0", "--data", str(tmp_path))
    assert refused.returncode == 1
    assert words in refused.stderr
    assert refused.stderr.count("\n") == 1


def test_an_open_bus_needs_words_that_name_the_risk() -> None:
    RouterSettings("tcp/0.0.0.0:7447").check(is_open=True)
    RouterSettings("tcp/127.0.0.1:7447").check(is_open=False)
    RouterSettings("tcp/[::1]:7447").check(is_open=False)


def test_an_address_in_use_is_one_line(bus: str, tmp_path: Path) -> None:
    session = open_bus(RouterSettings(bus).settings())
    try:
        refused = imuscope("fleet", "--listen", bus, "--port", "0", "--data", str(tmp_path))
    finally:
        session.close()
    assert refused.returncode == 1
    assert "cannot be opened" in refused.stderr.splitlines()[-1]
