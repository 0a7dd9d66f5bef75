"""The contract of a robot: what is refused at the start, what is a breach, and when it is mended."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from imuscope.server.extensions.ros2.contract import LASTS_S, START_S, Contract, read_contract
from imuscope.server.settings.config import ConfigError, load
from tests.support.each_row import each_row

TEXT = """
["/imu/imu/data"]
type = "sensor_msgs/msg/Imu"
frame = "imu_link"
rate = [95, 105]
covariances = ["orientation"]
"""
AS_AGREED = {
    **{"name": "/imu/imu/data", "type": "sensor_msgs/msg/Imu", "frame": "imu_link", "enabled": True},
    **{"rate": 100.0, "subscribers": 1, "covariances": ["orientation"]},
}


def contract(folder: Path, began: float = 0.0) -> Contract:
    file = folder / "ros2_contract.toml"
    file.write_text(TEXT)
    return Contract(read_contract(str(file)), began)


@each_row(
    ("changes", "words"),
    [
        ({"enabled": False}, "/imu/imu/data is switched off."),
        ({"type": "sensor_msgs/msg/Temperature"}, "is of type sensor_msgs/msg/Temperature, not sensor_msgs/msg/Imu"),
        ({"frame": "imu"}, "has the frame imu, not imu_link"),
        ({"covariances": []}, "has no known covariance of orientation"),
        ({"rate": 50.0}, "has 50.0 messages/s, not 95 to 105"),
        (None, "/imu/imu/data is not announced."),
    ],
)
def test_a_breach_is_reported_once_and_so_is_its_end(
    changes: dict[str, Any] | None, words: str, tmp_path: Path
) -> None:
    stored, now = contract(tmp_path), START_S + 1
    rows = [] if changes is None else [AS_AGREED | changes]
    assert list(stored.check([AS_AGREED], now)) == []
    assert list(stored.check(rows, now)) == []  # for a moment
    ((text, is_breach),) = stored.check(rows, now + LASTS_S)
    assert words in text
    assert is_breach
    assert list(stored.broken) == ["/imu/imu/data"]
    assert list(stored.check(rows, now + LASTS_S + 1)) == []
    ((text, is_breach),) = stored.check([AS_AGREED], now + LASTS_S + 2)
    assert (text, is_breach, stored.broken) == ("/imu/imu/data is as agreed again.", False, {})


def test_a_robot_that_starts_has_time_and_a_topic_without_subscribers_no_rate(tmp_path: Path) -> None:
    stored = contract(tmp_path, began=100.0)
    assert list(stored.check([], 100.0)) == []
    assert list(stored.check([], 100.0 + START_S - 0.1)) == []
    assert len(list(stored.check([], 100.0 + START_S))) == 1
    silent = contract(tmp_path)
    assert list(silent.check([AS_AGREED | {"rate": 0.0, "subscribers": 0}], 100.0)) == []
    assert list(silent.check([AS_AGREED | {"rate": 0.0, "subscribers": 0}], 200.0)) == []


@each_row(
    ("text", "words"),
    [
        ("[", "is not TOML"),
        ("rate = 3", "'rate': this is not a topic"),
        ('["/imu"]\nrates = [1, 2]', "'rates' is not one of type, frame, rate, covariances"),
        ('["/imu"]\nrate = 100', "rate 100 is not a least and a most"),
        ('["/imu"]\nrate = [2, 1]', "is not a least and a most"),
        ('["/imu"]\ncovariances = ["turn"]', "are not of orientation"),
        ('["/imu"]\nframe = 3', "type and frame are texts"),
    ],
)
def test_a_wrong_contract_is_refused_at_the_start(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "ros2_contract.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=words):
        load(data=tmp_path, ros2_contract=str(file))
    with pytest.raises(ConfigError, match="cannot be read: no such file"):
        load(data=tmp_path, ros2_contract=str(tmp_path / "other.toml"))
