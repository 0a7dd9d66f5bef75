"""Pages of robots through their fleet server: real robots, a real bus with access rules."""

from __future__ import annotations

import asyncio
import json
import sqlite3
from collections import deque
from pathlib import Path
from typing import Any

import httpx
import pytest
import zenoh
from websockets.exceptions import ConnectionClosed

from imuscope.server import wire
from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.bus import BusCredentials
from imuscope.server.extensions.fleet.model.fleet_settings import FleetSettings
from imuscope.server.extensions.fleet.robot.robot_settings import FleetSettingsError, allowed_pages
from imuscope.server.extensions.fleet.tunnel.http_tunnel_protocol import OpenStream, encode
from imuscope.server.wire import codec as wire_codec
from tests.server.extensions.fleet.fleet_robot import FleetRobot
from tests.server.extensions.fleet.robot_with_pages import (
    CONTROL,
    PASSWORDS,
    VIEW,
    base,
    commands,
    fleet_of,
    summary,
    token,
)
from tests.support.control_harness import at_rate, bench
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, connect, get, http_client
from tests.support.waiting import block_until

FAST = 0x80  # the code of 921 600 Bd


def test_a_robot_shows_its_devices_and_carries_out_commands_which_both_ends_log(tmp_path: Path) -> None:
    with fleet_of(tmp_path, "control") as (server, own, _):
        there = base(server)
        block_until(lambda: get(f"{there}/api/devices").json()[0]["serial_number"], "the device is shown")
        assert get(f"{there}/api/capabilities").json() == get(f"{own.url}/api/capabilities").json()
        assert get(f"{there}/api/build").json()["run"] == get(f"{own.url}/api/build").json()["run"]
        answer = httpx.post(f"{there}/api/devices/1/read", json={}, headers=token(CONTROL), timeout=PATIENCE_S)
        assert answer.status_code == 202, answer.text
        block_until(lambda: get(f"{there}/api/devices/1/values").json()["values"], "the settings are read")
        path = "POST /api/devices/1/read"
        expected = {
            f"Command of operator at 127.0.0.1: {path}: answered with 202.",
            f"Command through the fleet server of operator at 127.0.0.1: {path}.",
        }
        block_until(lambda: expected <= set(commands(server)), lambda: commands(server))


def test_a_viewer_cannot_command_and_a_robot_that_is_only_viewed_is_not_commanded(tmp_path: Path) -> None:
    with fleet_of(tmp_path, "view") as (server, _, bus):
        there = f"{base(server)}/api/devices/1"
        refused = httpx.post(f"{there}/read", json={}, headers=token(VIEW), timeout=PATIENCE_S)
        assert (refused.status_code, refused.json()["kind"]) == (403, "view-only")
        assert commands(server) == []
        refused = httpx.post(f"{there}/read", json={}, headers=token(CONTROL), timeout=PATIENCE_S)
        assert (refused.status_code, refused.json()["kind"]) == (403, "view-only")
        assert 'pages = "control"' in refused.json()["hint"]
        block_until(lambda: any(text.startswith("Refused a command") for text in commands(server)), "it is logged")
        viewed = {
            name: get(f"{base(server)}/api/build", headers=token(name)).json()["role"] for name in (VIEW, CONTROL)
        }
        assert viewed == {VIEW: "view", CONTROL: "view"}
        elsewhere = httpx.post(
            f"{there}/read",
            json={},
            headers={**token(CONTROL), "origin": "http://elsewhere.example"},
            timeout=PATIENCE_S,
        )
        assert elsewhere.json()["kind"] == "bad-origin"
        assert get(f"{there}/read", headers={"host": "elsewhere.example"}).json()["kind"] == "bad-host"
        another_robot_is_denied(server, bus)


def another_robot_is_denied(server: ServerProcess, bus: str) -> None:
    """A robot with its own password asks for the pages of another one, and listens to what that one answers."""
    with FleetRobot("b", bus, BusCredentials(user="b", password=PASSWORDS["b"])) as b:
        block_until(b.opened.is_set, "b is connected")
        assert b.session is not None
        received: list[str] = []
        mine = "f" * 16
        held = [
            b.session.declare_subscriber(
                key, lambda sample: received.append(str(sample.key_expr)), allowed_origin=zenoh.Locality.REMOTE
            )
            for key in (keys.answers(mine), keys.answers("*"), f"{keys.ROOT}/**")
        ]
        boot = run_of_the_robot(server)
        for key in (keys.request_key("otter 7", mine), keys.request_key("*", mine), f"{keys.ROOT}/**"):
            b.session.put(key, encode(OpenStream(1, boot, "GET", "/api/devices", role="control")))
        b.report(3)
        block_until(
            lambda: any(
                one["name"] == "b" and one["devices"] for one in get(f"{server.url}/api/fleet/robots").json()["robots"]
            ),
            "what b says of itself arrives",
        )
        assert get(f"{base(server)}/api/build").status_code == 200
        assert received == []
        del held


def run_of_the_robot(server: ServerProcess) -> str:
    """The run of the robot's server, which another robot could only guess."""

    def boot() -> str:
        file = sqlite3.connect(server.data / "fleet" / "fleet.sqlite")
        rows = file.execute("SELECT boot FROM robots WHERE name = 'otter 7'").fetchall()
        file.close()
        return str(rows[0][0]) if rows else ""

    return str(block_until(boot, "the robot is stored"))


def test_a_robot_may_keep_its_pages_to_itself(tmp_path: Path) -> None:
    with fleet_of(tmp_path, "off") as (server, _, _):
        refused = get(f"{base(server)}/api/devices")
        assert (refused.status_code, refused.json()["kind"]) == (409, "not-now")
        assert "does not show its pages" in refused.json()["message"]
        unknown = get(f"{base(server, 'nobody')}/api/devices")
        assert (unknown.status_code, unknown.json()["kind"]) == (404, "not-found")


def test_live_samples_pass_through_the_line(tmp_path: Path) -> None:
    with fleet_of(tmp_path, "view") as (server, _, _):
        url = base(server).replace("http", "ws", 1) + "/ws"
        with connect(url, subprotocols=[wire.SUBPROTOCOL], max_size=None) as socket:
            assert socket.subprotocol == wire.SUBPROTOCOL
            texts = {next(iter(json.loads(socket.recv()))) for _ in range(3)}
            assert "version" in texts
            socket.send(wire_codec.encode_text(wire.Subscribe(10.0)))
            while not isinstance(message := socket.recv(), bytes):
                pass
            assert len(message) > 100


def test_a_robot_whose_line_is_lost_is_reported_as_lost(tmp_path: Path) -> None:
    with fleet_of(tmp_path, "view") as (server, own, _):
        url = base(server).replace("http", "ws", 1) + "/ws"
        with connect(url, subprotocols=[wire.SUBPROTOCOL], max_size=None) as socket:
            socket.recv()
            own.process.kill()
            block_until(lambda: not summary(server), "the robot is lost")
            with pytest.raises(ConnectionClosed):
                deque(iter(socket.recv, None), maxlen=0)  # what was under way
            assert socket.close_code == 1011
            assert socket.close_reason == "The line of robot otter 7 is lost."
        gone = get(f"{base(server)}/api/devices")
        assert (gone.status_code, gone.json()["kind"]) == (502, "gone")
        assert gone.json()["hint"]


async def test_a_change_goes_back_by_itself_when_the_line_is_cut_before_it_is_confirmed(tmp_path: Path) -> None:
    def cut(there: Any) -> None:
        source = f"serial://{there.slave}?baud=115200"
        with fleet_of(tmp_path, "control", source) as (server, own, _), http_client(headers=token(CONTROL)) as http:
            device = f"{base(server)}/api/devices/1"
            block_until(lambda: http.get(f"{base(server)}/api/devices").json()[0]["status"] == "live", "it is live")
            http.post(f"{device}/read", json={})
            values = block_until(lambda: http.get(f"{device}/values").json()["values"], "the settings are read")
            body = {"changes": {"PortConfig": at_rate(values["PortConfig"], FAST)}, "confirmed": True}
            assert http.post(f"{device}/apply", json=body).status_code == 202

            def state(url: str) -> str:
                rollback = http.get(f"{url}/jobs").json()["pending_rollback"]
                return rollback["state"] if rollback else ""

            block_until(lambda: state(device) == "pending", "it asks for a confirmation, through the fleet server")
            server.process.kill()
            server.process.wait()
            mine = f"{own.url.rstrip('/')}/api/devices/1"
            block_until(lambda: state(mine) == "rolled-back", "the robot goes back by itself")
            block_until(lambda: get(f"{own.url}/api/devices").json()[0]["status"] == "live", "it streams again")
            assert there.device is not None
            assert there.device.baud == 115_200

    async with bench() as there:
        there.hold_open()
        await asyncio.to_thread(cut, there)


def test_commands_need_a_line_that_no_one_else_can_write_to() -> None:
    for router in ("tcp/127.0.0.1:7447", "tls/fleet.example:7447"):
        assert allowed_pages(FleetSettings(router=router, pages="control")) == "control"
    assert allowed_pages(FleetSettings(router="tcp/fleet.example:7447")) == "view"
    with pytest.raises(FleetSettingsError, match="without TLS"):
        allowed_pages(FleetSettings(router="tcp/fleet.example:7447", pages="control"))


def test_what_a_robot_answers_is_no_page_of_the_fleet_server(tmp_path: Path) -> None:
    with fleet_of(tmp_path, "view") as (server, _, _):
        answer = get(f"{base(server)}/api/devices", params={"token": "not-for-robots"})
        assert "sandbox" in answer.headers["content-security-policy"]
        assert answer.headers["x-content-type-options"] == "nosniff"
        moved = get(f"{base(server)}", follow_redirects=False)
        assert (moved.status_code, moved.headers["location"]) == (307, "otter%207/")
        page = get(f"{base(server)}/", headers={"accept": "text/html"})
        own = get(f"{server.url}/", headers={"accept": "text/html"}).text
        assert page.text == own.replace("<html", '<html data-robot="otter 7"', 1)
        for path in ("viser/", "rerun/", "foxglove", "metrics", "openapi.json"):
            assert get(f"{base(server)}/{path}").status_code == 404, path
