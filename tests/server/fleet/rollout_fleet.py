"""A fleet of real servers with simulated sensors: the settings of the first one are the profile, others differ."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Any

import httpx

from tests.free_ports import free_port
from tests.server_process import ServerProcess
from tests.timeouts import PATIENCE_S, get
from tests.waiting import block_until

SOURCE = "sim:xbus?product=MTi-630"
PROFILE_HZ, OTHER_HZ = 50, 100
QUATERNION = 0x2010


class CutLine:
    """A TCP relay that can be cut, and lets nobody through then."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._open: list[socket.socket] = []
        self._is_cut = False
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Cut the line for good."""
        self._is_cut = True
        for one in (self._listener, *self._open):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while not self._is_cut:
                here, _ = self._listener.accept()
                there = socket.create_connection(("127.0.0.1", self._port), PATIENCE_S)
                self._open += [here, there]
                for pair in ((here, there), (there, here)):
                    threading.Thread(target=self._pass_on, args=pair, daemon=True).start()

    def _pass_on(self, one: socket.socket, other: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := one.recv(65536):
                other.sendall(data)
        with contextlib.suppress(OSError):
            other.shutdown(socket.SHUT_RDWR)


class RolloutFleet:
    """A fleet server and robots.

    Args:
        names: of the robots; the first one has the profile.
        behind: a robot whose line can be cut.
        sources: of robots that have another sensor.
    """

    def __init__(
        self, folder: Path, names: str = "abc", *, behind: str = "", sources: Mapping[str, str] | None = None
    ) -> None:
        self._folder, self._names, self._behind = folder, names, behind
        self._sources = sources or {}
        self._port = free_port()
        self.line = CutLine(self._port) if behind else None
        self.robots: dict[str, ServerProcess] = {}
        self.server: ServerProcess
        self._pool = ThreadPoolExecutor(8)  # a process may end with the thread that started it

    def __enter__(self) -> RolloutFleet:
        self.server = self.begin()
        try:
            self.robots = dict(zip(self._names, self._pool.map(self._robot, self._names), strict=True))
            list(self._pool.map(self._prepare, self._names))
            self._share()
        except BaseException:
            self.close()
            raise
        return self

    def begin(self) -> ServerProcess:
        """Start the fleet server, also once more."""
        arguments = ("--listen", f"tcp/127.0.0.1:{self._port}")
        self.server = ServerProcess(data=self._folder / "fleet", arguments=arguments, command="fleet")
        return self.server

    def _robot(self, name: str) -> ServerProcess:
        port = self.line.port if self.line is not None and name == self._behind else self._port
        config = self._folder / f"{name}.toml"
        config.write_text(
            f'[fleet]\nrouter = "tcp/127.0.0.1:{port}"\nname = "{name}"\ngroup = "otters"\npages = "control"\n'
        )
        return ServerProcess(
            self._sources.get(name, SOURCE), data=self._folder / name, arguments=("--config", str(config))
        )

    def _prepare(self, name: str) -> None:
        """Read the settings; the first one's outputs get the rate of the profile."""
        block_until(lambda: self.device(name)["status"] == "live", f"the device of {name} is live")
        self.post(name, "read", {})
        block_until(lambda: self.values(name), f"the settings of {name} are read")
        if name == self._names[0]:
            self.post(name, "apply", {"changes": outputs(PROFILE_HZ), "confirmed": True})
            block_until(lambda: self.rate(name) == PROFILE_HZ, "the profile is written")

    def _share(self) -> None:
        """Make the first one's settings the profile, and wait until the others differ from it."""
        first = self._names[0]
        rates = dict.fromkeys(self._names, OTHER_HZ) | {first: PROFILE_HZ}
        block_until(lambda: self.reported() == rates, self.reported)
        block_until(
            lambda: self.send(f"robots/{first}/profile", device="1", by="Ada").status_code == 200, "there is a profile"
        )
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
        return dict(get(f"{self.robots[name].url}/api/devices").json()[0])

    def post(self, name: str, what: str, body: dict[str, Any]) -> httpx.Response:
        """Tell a robot something at its own address."""
        return httpx.post(f"{self.robots[name].url}/api/devices/1/{what}", json=body, timeout=PATIENCE_S)

    def confirm(self, name: str) -> None:
        """Confirm the settings of a robot at its own address, which ends the watching."""
        assert self.post(name, "confirm", {}).status_code == 200

    def values(self, name: str) -> dict[str, Any]:
        """Settings of a robot, as it says itself."""
        return dict(get(f"{self.robots[name].url}/api/devices/1/values").json()["values"])

    def rate(self, name: str) -> int:
        """Configured rate of a robot's quaternion, Hz."""
        found = self.values(name)["OutputConfiguration"]["outputs"]
        return next(int(one["output_frequency"]) for one in found if one["data_identifier"] == QUATERNION)

    def rollback(self, name: str) -> str:
        """State of a robot's rollback, as it says itself."""
        found = get(f"{self.robots[name].url}/api/devices/1/jobs").json()["pending_rollback"]
        return str(found["state"]) if found else ""

    # ── the fleet server ─────────────────────────────────────────────────────────────────────────────────────────────

    def summary(self, name: str) -> dict[str, Any]:
        """A robot, as the fleet server shows it."""
        robots = get(f"{self.server.url}/api/fleet/robots").json()["robots"]
        return next(one for one in robots if one["name"] == name)

    def reported(self) -> dict[str, float | None]:
        """Robot → rate that its settings ask for, as it reports."""
        robots = get(f"{self.server.url}/api/fleet/robots").json()["robots"]
        return {one["name"]: device["expected_rate"] for one in robots for device in one["devices"]}

    def plan(self, robot: str = "a", **query: str) -> dict[str, Any]:
        """The plan."""
        answer = get(f"{self.server.url}/api/fleet/robots/{robot}/rollout", params={"device": "1", **query})
        assert answer.status_code == 200, answer.text
        return dict(answer.json())

    def send(self, path: str, **body: Any) -> httpx.Response:
        """Tell the fleet server something."""
        return httpx.post(f"{self.server.url}/api/fleet/{path}", json=body, timeout=PATIENCE_S)

    def start(self, plan: str, **options: Any) -> httpx.Response:
        """Start a rollout."""
        return self.send("robots/a/rollout", device="1", plan=plan, **{"by": "Ada", "watch_s": 2, **options})

    def rollout(self) -> dict[str, Any]:
        """The first rollout."""
        return dict(get(f"{self.server.url}/api/fleet/rollouts/1").json())

    def states(self) -> dict[str, str]:
        """Robot → state of its device in the rollout."""
        return {one["robot"]: one["state"] for one in self.rollout()["devices"]}

    def until_state(self, name: str, *states: str) -> None:
        """Wait until a robot's device is in one of these states."""
        block_until(lambda: self.states()[name] in states, self.rollout, seconds=3 * PATIENCE_S)

    def until_over(self) -> dict[str, Any]:
        """The rollout when it has ended."""
        block_until(lambda: self.rollout()["state"] != "running", self.rollout, seconds=3 * PATIENCE_S)
        return self.rollout()

    def events(self, robot: str) -> list[str]:
        """Texts of the events of a robot at the fleet server, the oldest first."""
        found = get(f"{self.server.url}/api/fleet/events", params={"limit": 500}).json()
        return [one["text"] for one in reversed(found) if one["robot"] == robot]

    def close(self) -> None:
        """End all."""
        if self.line is not None:
            self.line.cut()
        list(self._pool.map(ServerProcess.stop, [self.server, *self.robots.values()]))
        self._pool.shutdown()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def outputs(rate: int) -> dict[str, Any]:
    """A quaternion and a rate of turn at a rate."""
    asked = [{"data_identifier": one, "output_frequency": rate} for one in (QUATERNION, 0x8020)]
    return {"OutputConfiguration": {"outputs": asked}}
