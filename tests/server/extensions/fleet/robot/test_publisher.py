"""A robot's side of a fleet: its settings and its limit."""

from pathlib import Path

import pytest

from imuscope.server.cli import main
from imuscope.server.extensions.fleet.model.fleet_settings import FleetSettings
from imuscope.server.extensions.fleet.model.settings import FleetTables
from imuscope.server.extensions.fleet.robot.publisher import report_budget
from imuscope.server.extensions.fleet.robot.robot_settings import FleetSettingsError, credentials_of, robot_name
from imuscope.server.settings.config import Config
from tests.support.each_row import each_row


def test_a_limit_allows_its_bytes_and_some_seconds_at_once() -> None:
    budget = report_budget(100.0, 0.0)
    assert budget.available(0.0) == 1000.0
    budget.acquire(0.0, 1000)
    assert budget.available(0.0) == 0.0
    assert budget.available(5.0) == 500.0
    assert budget.available(500.0) == 1000.0


def test_without_a_limit_everything_passes() -> None:
    budget = report_budget(0.0, 0.0)
    budget.acquire(0.0, 10**9)
    assert budget.available(1.0) == float("inf")


def test_a_robot_is_called_as_its_host_unless_it_has_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.node", lambda: "otter-7.example.com")
    assert robot_name(FleetSettings()) == "otter-7"
    assert robot_name(FleetSettings(name="Otter 7")) == "Otter 7"
    with pytest.raises(FleetSettingsError, match="--fleet-name"):
        robot_name(FleetSettings(name="a/*"))


def test_a_name_on_the_command_line_leaves_the_settings_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Robots of one disk image have one file, and one host name."""
    monkeypatch.setenv("IMUSCOPE_DATA", str(tmp_path / "data"))
    file = tmp_path / "robot.toml"
    file.write_text('[fleet]\nrouter = "tcp/fleet:7447"\nname = "image"\ngroup = "otters"\n')
    configs: list[Config] = []
    monkeypatch.setattr("imuscope.server.commands.serve.run", lambda config, *_, **__: configs.append(config))
    assert main(["serve", "sim:xbus", "--config", str(file), "--fleet-name", "otter-7"]) in (0, None)
    assert main(["serve", "sim:xbus", "--fleet", "tcp/other:7447", "--fleet-name", "otter-8"]) in (0, None)
    assert configs[0].of(FleetTables).fleet == FleetSettings(router="tcp/fleet:7447", name="otter-7", group="otters")
    assert configs[1].of(FleetTables).fleet == FleetSettings(router="tcp/other:7447", name="otter-8")


def test_the_password_may_be_in_a_file(tmp_path: Path) -> None:
    path = tmp_path / "password"
    path.write_text("password-of-a\n")
    assert credentials_of(FleetSettings(user="a", password=f"@{path}")).password == "password-of-a"


@each_row(
    "settings",
    [
        FleetSettings(user="a"),
        FleetSettings(password="password-of-a"),
        FleetSettings(certificate="robot.pem"),
        FleetSettings(ca="/nowhere/ca.pem"),
    ],
)
def test_half_of_what_is_needed_is_refused(settings: FleetSettings) -> None:
    with pytest.raises(FleetSettingsError, match=r"fleet\."):
        credentials_of(settings)
