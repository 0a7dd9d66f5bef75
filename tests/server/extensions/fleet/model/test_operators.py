"""Operators of a fleet: everything is seen, robots and rollouts of their groups are commanded, and nothing else."""

from __future__ import annotations

import itertools
from pathlib import Path

import httpx
import pytest

from imuscope.server.access.auth import Access, Guard
from imuscope.server.extensions.fleet.model.access import FleetAccessError
from imuscope.server.extensions.fleet.model.operators import Operators, read_operators
from imuscope.server.settings.config import Config
from tests.server.extensions.fleet.robot_with_pages import CONTROL, VIEW, base, commands, fleet_of, token
from tests.support.asgi_client import Answer, Reached, send_request
from tests.support.each_row import each_row
from tests.support.timeouts import PATIENCE_S, get
from tests.support.waiting import block_until

ADA, BEN = "token-of-ada-token-of-ada", "token-of-ben-token-of-ben"
LINES = f"ada:{ADA}:otters, foxes\nben:{BEN}:foxes\n"
ROBOTS = {"otter": "otters", "fox": "foxes", "stray": ""}
ROLLOUTS = {"1": "otters", "2": "foxes"}
COMMANDS = (
    ("POST", "/robots/{}/api/devices/1/read"),
    ("DELETE", "/robots/{}/api/devices/1"),
    ("POST", "/api/fleet/robots/{}/profile"),
    ("DELETE", "/api/fleet/robots/{}/profile"),
    ("POST", "/api/fleet/robots/{}/rollout"),
    ("POST", "/api/fleet/robots/{}/acknowledge"),
    ("DELETE", "/api/fleet/robots/{}"),
)


def guarded(folder: Path, reached: Reached) -> Guard:
    file = folder / "operators.txt"
    if not file.exists():
        file.write_text(LINES)
    access = Access(Config(host="0.0.0.0", data=folder, view_token=VIEW, control_token=CONTROL))
    access.operators = Operators(file, ROBOTS.get, ROLLOUTS.get)
    return Guard(reached, access)


def answer_to(guard: Guard, method: str, path: str, secret: str) -> Answer:
    headers = {"authorization": f"Bearer {secret}"}
    if method not in ("GET", "WS"):
        headers |= {"content-type": "application/json", "content-length": "2"}
    return send_request(guard, method, path, headers)


def test_an_operator_commands_the_robots_of_own_groups_only(tmp_path: Path) -> None:
    reached = Reached()
    guard = guarded(tmp_path, reached)
    groups = {ADA: {"otters", "foxes"}, BEN: {"foxes"}}
    robots = (*ROBOTS, "unknown")
    for (method, path), robot, secret in itertools.product(COMMANDS, robots, (ADA, BEN, CONTROL, VIEW)):
        answer = answer_to(guard, method, path.format(robot), secret)
        may = secret == CONTROL or ROBOTS.get(robot) in groups.get(secret, set())
        assert answer.status == (200 if may else 403), (method, path, robot, secret)
    for rollout, secret in itertools.product((*ROLLOUTS, "3"), (ADA, BEN)):
        may = ROLLOUTS.get(rollout) in groups[secret]
        answer = answer_to(guard, "POST", f"/api/fleet/rollouts/{rollout}/stop", secret)
        assert answer.status == (200 if may else 403), (rollout, secret)


@each_row(
    ("method", "path"),
    [
        ("DELETE", "/api/devices/1"),
        ("POST", "/api/recordings/start"),
        ("PUT", "/api/workspaces/otter"),
        ("POST", "/x/robots/otter/api/devices/1/read"),
        ("POST", "/api/fleet/rollouts/1x/stop"),
        ("DELETE", "/api/devices/robots/otter/api"),
        ("POST", "//robots/otter/api/devices/1/read"),
    ],
)
def test_an_operator_commands_nothing_else(tmp_path: Path, method: str, path: str) -> None:
    reached = Reached()
    answer = answer_to(guarded(tmp_path, reached), method, path, ADA)
    assert answer.status == 403 or reached.role in ("", "open")


def test_an_operator_sees_everything(tmp_path: Path) -> None:
    reached = Reached()
    guard = guarded(tmp_path, reached)
    for method, path, role in (
        ("GET", "/api/fleet/robots", "view"),
        ("GET", "/robots/stray/api/devices", "view"),
        ("WS", "/robots/stray/ws", "view"),
        ("GET", "/robots/otter/api/build", "control"),
        ("WS", "/robots/otter/ws", "control"),
    ):
        answer_to(guard, method, path, ADA)
        assert reached.role == role, path


def test_a_removed_line_revokes_at_once_and_a_damaged_file_revokes_all(tmp_path: Path) -> None:
    reached = Reached()
    guard = guarded(tmp_path, reached)
    file = tmp_path / "operators.txt"
    path = "/robots/fox/api/devices/1/read"
    assert answer_to(guard, "POST", path, BEN).status == 200
    file.write_text(LINES.splitlines()[0])
    assert answer_to(guard, "POST", path, BEN).status == 401
    assert answer_to(guard, "POST", path, ADA).status == 200
    file.write_text("ada")
    assert answer_to(guard, "POST", path, ADA).status == 401
    file.write_text(LINES + "\n")
    assert answer_to(guard, "POST", path, BEN).status == 200
    file.unlink()
    assert answer_to(guard, "POST", path, BEN).status == 401


@each_row(
    ("text", "message"),
    [
        ("ada", "Line 1 of .*: give NAME:TOKEN:GROUP,GROUP"),
        (f"\n:{ADA}:otters", "Line 2 of .*the name is missing"),
        ("ada:short:otters", "the token of ada is too short; give it 20 characters or more"),
        (f"ada:{ADA}:", "a group of ada has no name"),
        (f"ada:{ADA}:otters,,foxes", "a group of ada has no name"),
        (LINES + f"eve:{BEN}:otters", "the name or the token of eve is listed twice"),
        (LINES + f"ada:{ADA}x:otters", "the name or the token of ada is listed twice"),
    ],
)
def test_a_line_that_is_not_valid_is_named(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "operators.txt").write_text(text)
    with pytest.raises(FleetAccessError, match=message):
        read_operators(tmp_path / "operators.txt")
    with pytest.raises(FleetAccessError, match="cannot be read"):
        read_operators(tmp_path / "none.txt")


def test_a_command_is_logged_with_the_name_of_the_operator_on_both_ends(tmp_path: Path) -> None:
    with fleet_of(tmp_path, "control", operators=LINES) as (server, _, _):
        there = base(server)
        block_until(lambda: get(f"{there}/api/devices").json()[0]["serial_number"], "the device is shown")
        counts = {secret: get(f"{there}/api/build", headers=token(secret)).json()["role"] for secret in (ADA, BEN)}
        assert counts == {ADA: "control", BEN: "view"}
        read = f"{there}/api/devices/1/read"
        refused = httpx.post(read, json={}, headers=token(BEN), timeout=PATIENCE_S)
        assert (refused.status_code, refused.json()["message"]) == (403, "The token of ben does not command this.")
        assert httpx.post(read, json={}, headers=token(ADA), timeout=PATIENCE_S).status_code == 202
        path = "POST /api/devices/1/read"
        expected = {
            f"Command of ada at 127.0.0.1: {path}: answered with 202.",
            f"Command through the fleet server of ada at 127.0.0.1: {path}.",
        }
        block_until(lambda: expected <= set(commands(server)), lambda: commands(server))
