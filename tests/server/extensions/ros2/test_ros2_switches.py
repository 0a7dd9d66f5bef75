"""Topics of ROS 2 that are switched off, over restarts; the ROS domain of the environment."""

from pathlib import Path

import pytest

from imuscope.recordings.system import atomic_write
from imuscope.server.errors import DomainError
from imuscope.server.extensions.ros2 import service as ros2_service
from imuscope.server.extensions.ros2.service import FILE, TopicSwitches
from imuscope.server.extensions.ros2.settings import Ros2Settings
from imuscope.server.settings.config import ConfigError, load
from tests.support.each_row import each_row


def test_switches_are_remembered(tmp_path: Path) -> None:
    switches = TopicSwitches(tmp_path)
    assert switches.off == frozenset()
    for topic in ("/imu/data", "/tf /imu"):
        switches.set(topic, enabled=False)
    switches.set("/imu/data", enabled=True)
    assert TopicSwitches(tmp_path).off == {"/tf /imu"}


@each_row("text", [b"", b"null", b"[" * 100_000, b'{"switched_off": 3}', b'["/imu/data"]', b"\xff"])
def test_an_unreadable_file_counts_as_absent(tmp_path: Path, text: bytes) -> None:
    (tmp_path / FILE).write_bytes(text)
    switches = TopicSwitches(tmp_path)
    assert switches.off == frozenset()
    switches.set("/imu/data", enabled=False)
    assert TopicSwitches(tmp_path).off == {"/imu/data"}


def test_a_switch_that_cannot_be_stored_changes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, text: str) -> None:
        raise OSError(28, "No space left on device")

    switches = TopicSwitches(tmp_path)
    monkeypatch.setattr(atomic_write, "write_atomic", full)
    with pytest.raises(DomainError, match="cannot be stored: No space left on device"):
        switches.set("/imu/data", enabled=False)
    assert switches.off == frozenset()


def test_their_number_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros2_service, "MAX_TOPICS", 2)
    switches = TopicSwitches(tmp_path)
    for topic in ("/a", "/b"):
        switches.set(topic, enabled=False)
    with pytest.raises(DomainError, match="2 topics are switched off"):
        switches.set("/c", enabled=False)
    switches.set("/a", enabled=True)
    switches.set("/c", enabled=False)


def test_the_domain_is_that_of_the_environment_unless_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    assert load(ros2=True, data=tmp_path).of(Ros2Settings).ros2_domain == 42
    assert load(ros2=True, data=tmp_path, ros2_domain=5).of(Ros2Settings).ros2_domain == 5
    for text in ("400", "-1", "robot"):
        monkeypatch.setenv("ROS_DOMAIN_ID", text)
        with pytest.raises(ConfigError, match=f"ROS_DOMAIN_ID '{text}' of the environment is not a number"):
            load(ros2=True, data=tmp_path)
        assert load(data=tmp_path).of(Ros2Settings).ros2_domain == 0  # of no interest without ROS
