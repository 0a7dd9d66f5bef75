"""A fleet of servers with simulated sensors: the settings of the first one are the profile, others differ.

The servers are the real ones on real sockets and a real bus, in this process; the clock of each robot is turned by the
test, so that nothing waits for a rollback that is due in minutes, and nothing happens before the test says so.
"""

from __future__ import annotations

from contextlib import ExitStack
from http import HTTPStatus
from pathlib import Path
from typing import Any

import httpx
import pytest

from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.extensions.fleet.model.fleet_settings import FleetServerSettings, FleetSettings
from imuscope.server.extensions.fleet.model.settings import FleetTables
from imuscope.server.extensions.fleet.robot import publisher
from imuscope.server.extensions.fleet.rollouts.rollout_steps import RolloutTiming
from imuscope.server.extensions.fleet.server import fleet_server
from imuscope.server.extensions.fleet.server.fleet_command import create_fleet_server
from imuscope.server.links.source_url import open_link
from imuscope.server.settings.config import Config
from tests.server.extensions.fleet.tcp_proxy import TcpProxy
from tests.server.extensions.fleet.turned_loop import TurnedLoop
from tests.support.free_ports import free_port
from tests.support.in_process_server import InProcessServer
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, http_client
from tests.support.waiting import block_until

SOURCE = "sim:xbus?product=MTi-630&rate=10"
PROFILE_HZ, OTHER_HZ = 20, 10
QUATERNION = 0x2010
LONG_S = 300.0
"""A time of watching that somebody at the robot ends."""
BRIEF = RolloutTiming(poll_s=0.05, lost_s=0.1, watch_more_s=PATIENCE_S)


class Robot(InProcessServer):
    """The server of a robot in this process, whose clock a test turns."""

    def __init__(self, name: str, port: int, data: Path) -> None:
        settings = FleetSettings(router=f"tcp/127.0.0.1:{port}", name=name, group="otters", pages="control")
        config = Config(port=0, data=data, sources=(SOURCE,)).having(FleetTables(fleet=settings))
        super().__init__(config, open_link, all_protocols(), loop=TurnedLoop)

    def turn(self, seconds: float) -> None:
        """Let everything be due that would be within this time."""
        assert isinstance(self.loop, TurnedLoop)
        self.client.close()  # else the server would, which no idle connection outlasts
        self.client = http_client(base_url=self.url)
        self.loop.turn(seconds)


class RolloutFleet:
    """A fleet server and robots, all in this process.

    Args:
        names: of the robots; the first one has the profile.
        behind: robots each with a line that can be cut.
        is_process: the fleet server is a process, to be killed; it has the product's timings.
    """

    def __init__(
        self,
        folder: Path,
        names: str = "abc",
        *,
        behind: str = "",
        is_process: bool = False,
    ) -> None:
        self._folder, self._names, self._is_process = folder, names, is_process
        self._port = free_port()
        self.number = 1  # of the newest rollout
        self.lines = {name: TcpProxy(self._port) for name in behind}
        self.robots: dict[str, Robot] = {}
        self._open = ExitStack()
        self._process: ServerProcess | None = None

    def __enter__(self) -> RolloutFleet:
        try:
            self._quicken(self._open.enter_context(pytest.MonkeyPatch.context()))
            self._open.callback(self._cut)
            self.begin()
            for name in self._names:
                port = self.lines[name].port if name in self.lines else self._port
                self.robots[name] = self._open.enter_context(Robot(name, port, self._folder / name))
            for name in self._names:
                self._prepare(name)
            self._share()
        except BaseException:
            self._open.close()
            raise
        return self

    def _quicken(self, patch: pytest.MonkeyPatch) -> None:
        """Reports and looks follow each other quickly, so that little is waited for."""
        patch.setattr(publisher, "PERIOD_S", 0.1)
        patch.setattr(fleet_server, "TURN_S", 0.02)
        patch.setattr(fleet_server, "WRITE_S", 0.1)

    def begin(self) -> None:
        """Start the fleet server, also once more."""
        data, listen = self._folder / "fleet", f"tcp/127.0.0.1:{self._port}"
        if self._is_process:
            self._process = ServerProcess(data=data, arguments=("--listen", listen), command="fleet")
            self._open.callback(self._process.stop)
            self._server = self._open.enter_context(http_client(base_url=self._process.url))
            return
        config = Config(port=0, data=data).having(FleetTables(fleet_server=FleetServerSettings(listen=listen)))
        server = create_fleet_server(config, BRIEF)
        server.open()
        self.rollouts = server.rollouts
        self._server = self._open.enter_context(
            InProcessServer(config, open_link, all_protocols(), brought=[server], has_devices=False)
        ).client

    def kill(self) -> None:
        """Kill the fleet server's process."""
        assert self._process is not None
        self._process.process.kill()
        self._process.stop()

    def lose(self, name: str) -> None:
        """Cut the line of a robot, and wait until it is lost."""
        self.lines[name].cut()
        block_until(lambda: self.summary(name)["state"] == "lost", f"{name} is lost")

    def _cut(self) -> None:
        for line in self.lines.values():
            line.cut()

    def _prepare(self, name: str) -> None:
        """Read the settings; the first one's outputs get the rate of the profile, the others' another."""
        block_until(lambda: self.device(name)["status"] == "live", f"the device of {name} is live")
        self.post(name, "read", {})
        block_until(lambda: self.values(name), f"the settings of {name} are read")
        self._write(name)

    def _write(self, name: str) -> None:
        rate = PROFILE_HZ if name == self._names[0] else OTHER_HZ
        self.post(name, "apply", {"changes": outputs(rate), "confirmed": True})
        block_until(lambda: self.rate(name) == rate, "the settings are written")

    def reset(self) -> None:
        """Give the others again the settings that differ from the profile, after a test that changed them."""
        for name in self._names[1:]:
            if self.rate(name) != OTHER_HZ:
                self._write(name)
        self._until_drifted()

    def _share(self) -> None:
        """Make the first one's settings the profile, and wait until the others differ from it."""
        first = self._names[0]
        rates = dict.fromkeys(self._names, OTHER_HZ) | {first: PROFILE_HZ}
        block_until(lambda: self.reported() == rates, self.reported)
        block_until(
            lambda: self.send(f"robots/{first}/profile", device="1", by="Ada").status_code == 200, "there is a profile"
        )
        self._until_drifted()

    def _until_drifted(self) -> None:
        block_until(
            lambda: (
                [self.summary(name)["settings"] for name in self._names]
                == ["as-profile", *["drifted"] * (len(self._names) - 1)]
            ),
            lambda: [self.summary(name)["settings"] for name in self._names],
        )

    # ── robots ───────────────────────────────────────────────────────────────────────────────────────────────────────

    def device(self, name: str) -> dict[str, Any]:
        """The device of a robot, as it says itself."""
        return dict(self.robots[name].client.get("/api/devices").json()[0])

    def post(self, name: str, what: str, body: dict[str, Any]) -> httpx.Response:
        """Tell a robot something at its own address."""
        return self.robots[name].client.post(f"/api/devices/1/{what}", json=body)

    def confirm(self, name: str) -> None:
        """Confirm the settings of a robot at its own address, which ends the watching."""
        assert self.post(name, "confirm", {}).status_code == 200

    def values(self, name: str) -> dict[str, Any]:
        """Settings of a robot, as it says itself."""
        return dict(self.robots[name].client.get("/api/devices/1/values").json()["values"])

    def rate(self, name: str) -> int:
        """Configured rate of a robot's quaternion, Hz."""
        results = self.values(name)["OutputConfiguration"]["outputs"]
        return next(int(one["output_frequency"]) for one in results if one["data_identifier"] == QUATERNION)

    def rollback(self, name: str) -> str:
        """State of a robot's rollback, as it says itself."""
        result = self.robots[name].client.get("/api/devices/1/jobs").json()["pending_rollback"]
        return str(result["state"]) if result else ""

    # ── the fleet server ─────────────────────────────────────────────────────────────────────────────────────────────

    def summary(self, name: str) -> dict[str, Any]:
        """A robot, as the fleet server shows it."""
        robots = self._server.get("/api/fleet/robots").json()["robots"]
        return next(one for one in robots if one["name"] == name)

    def reported(self) -> dict[str, float | None]:
        """Robot → rate that its settings ask for, as it reports."""
        robots = self._server.get("/api/fleet/robots").json()["robots"]
        return {one["name"]: device["expected_rate"] for one in robots for device in one["devices"]}

    def plan(self, robot: str = "a", **query: str) -> dict[str, Any]:
        """The plan."""
        answer = self._server.get(f"/api/fleet/robots/{robot}/rollout", params={"device": "1", **query})
        assert answer.status_code == 200, answer.text
        return dict(answer.json())

    def send(self, path: str, **body: Any) -> httpx.Response:
        """Tell the fleet server something."""
        return self._server.post(f"/api/fleet/{path}", json=body)

    def start(self, plan: str, **options: Any) -> httpx.Response:
        """Start a rollout."""
        answer = self.send("robots/a/rollout", device="1", plan=plan, **{"by": "Ada", "watch_s": LONG_S, **options})
        if answer.status_code == 202:
            self.number = answer.json()["id"]
        return answer

    def roll_out(self, **options: Any) -> None:
        """Start a rollout of the plan, once it stands still: reports of the robots change it."""
        block_until(lambda: self.start(self.plan()["id"], **options).status_code == HTTPStatus.ACCEPTED, self.plan)

    def rollout(self) -> dict[str, Any]:
        """The newest rollout."""
        return dict(self._server.get(f"/api/fleet/rollouts/{self.number}").json())

    def states(self) -> dict[str, str]:
        """Robot → state of its device in the rollout."""
        return {one["robot"]: one["state"] for one in self.rollout()["devices"]}

    def until_state(self, name: str, *states: str) -> None:
        """Wait until a robot's device is in one of these states."""
        block_until(lambda: self.states()[name] in states, self.rollout)

    def until_over(self) -> dict[str, Any]:
        """The rollout when it has ended."""
        block_until(lambda: self.rollout()["state"] != "running", self.rollout)
        return self.rollout()

    def events(self, robot: str) -> list[str]:
        """Texts of the events of a robot at the fleet server, the oldest first."""
        answer = self._server.get("/api/fleet/events", params={"limit": 500}).json()
        return [one["text"] for one in reversed(answer) if one["robot"] == robot]

    def until_event(self, robot: str, beginning: str) -> None:
        """Wait until an event of a robot that begins so is written, which the fleet server does now and then."""
        block_until(
            lambda: any(text.startswith(beginning) for text in self.events(robot)),
            lambda: (beginning, self.events(robot)),
        )

    def __exit__(self, *_: object) -> None:
        self._open.close()


def outputs(rate: int) -> dict[str, Any]:
    """A quaternion and a rate of turn at a rate."""
    requests = [{"data_identifier": one, "output_frequency": rate} for one in (QUATERNION, 0x8020)]
    return {"OutputConfiguration": {"outputs": requests}}
