"""A fleet server with passwords and tokens, and a robot of it that shows its pages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess
from tests.support.timeouts import get
from tests.support.waiting import block_until

PASSWORDS = {"otter 7": "password-of-otter", "b": "password-of-b"}
VIEW, CONTROL = "view-view-view-view", "control-control-control"
SOURCE = "sim:xbus?product=MTi-630&rate=10"  # slow: most tests only need it to be there


def base(server: ServerProcess, robot: str = "otter%207") -> str:
    return f"{server.url.rstrip('/')}/robots/{robot}"


def token(text: str) -> dict[str, str]:
    return {"authorization": f"Bearer {text}"}


@contextmanager
def fleet_of(
    folder: Path, pages: str, *sources: str, operators: str = ""
) -> Iterator[tuple[ServerProcess, ServerProcess, str]]:
    """A fleet server with passwords and tokens, a robot that is live there, and the address of the bus.

    Args:
        operators: lines of their file; the group of the robot is "otters".
    """
    bus = f"tcp/127.0.0.1:{free_port()}"
    robots = folder / "robots.txt"
    robots.write_text("".join(f"{name}:{password}\n" for name, password in PASSWORDS.items()))
    settings = folder / "fleet.toml"
    settings.write_text(f'view_token = "{VIEW}"\ncontrol_token = "{CONTROL}"\n')
    robot = folder / "robot.toml"
    user = f'user = "otter 7"\npassword = "{PASSWORDS["otter 7"]}"\n'
    robot.write_text(f'[fleet]\nrouter = "{bus}"\nname = "otter 7"\ngroup = "otters"\npages = "{pages}"\n{user}')
    persons = folder / "operators.txt"
    persons.write_text(operators)
    files = ("--robots", str(robots), "--operators", str(persons), "--config", str(settings))
    requests = ("--listen", bus, *files)
    with (
        ServerProcess(data=folder / "fleet", arguments=requests, command="fleet") as server,
        ServerProcess(*(sources or (SOURCE,)), data=folder / "robot", arguments=("--config", str(robot))) as own,
    ):
        block_until(lambda: summary(server).get("pages") == pages, "the robot has reported")
        yield server, own, bus


def summary(server: ServerProcess) -> dict[str, Any]:
    robots = get(f"{server.url}/api/fleet/robots").json()["robots"]
    return next((one for one in robots if one["name"] == "otter 7" and one["state"] == "live"), {})


def commands(server: ServerProcess) -> list[str]:
    """The stored events about commands, the oldest first."""
    events = get(f"{server.url}/api/fleet/events", params={"robot": "otter 7"}).json()
    return [one["text"] for one in reversed(events) if one["kind"] == "command"]
