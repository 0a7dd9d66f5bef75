"""Names that others use: the same from the first announcement on, over restarts, whatever is learnt of a device."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.server import wire
from imuscope.server.devices.device.device_names import DeviceNames
from imuscope.server.extensions.ros2 import service as ros2_service
from imuscope.server.extensions.ros2.service import Ros2
from imuscope.server.extensions.ros2.settings import Ros2Settings
from imuscope.server.settings.config import ConfigError, load
from imuscope.server.streaming.telemetry import Telemetry
from tests.support.each_row import each_row


def names_of(folder: Path, *sources: str, original: dict[str, str] | None = None) -> list[str]:
    """The topics of sources that a server opens in this order; their ids are their places in it."""
    names = DeviceNames(folder)
    names.give_topics(original or {})
    return [names.topic_of(str(number), source) for number, source in enumerate(sources, 1)]


def test_a_source_has_its_topic_in_later_runs_whatever_its_place_and_its_options(tmp_path: Path) -> None:
    assert names_of(tmp_path, "/dev/a", "/dev/b") == ["imu", "imu_2"]
    assert names_of(tmp_path, "/dev/b?baud=921600") == ["imu_2"]
    assert names_of(tmp_path, "/dev/c", "/dev/b", "/dev/a") == ["imu_3", "imu_2", "imu"]
    assert names_of(tmp_path, "sim:xbus", "sim:xbus?rate=1") == ["imu_4", "imu_5"]


def test_the_topic_that_a_simulator_had_is_free_for_a_device(tmp_path: Path) -> None:
    assert names_of(tmp_path, "sim:xbus", "sim:isb") == ["imu", "imu_2"]
    assert names_of(tmp_path, "/dev/a") == ["imu"]
    names = DeviceNames(tmp_path)
    assert [names.topic_of(device_id, source) for device_id, source in (("1", "/dev/a"), ("2", "sim:xbus"))] == [
        "imu",
        "imu_3",
    ]
    assert names.moved == {}  # the device has taken it long ago
    assert names_of(tmp_path, "sim:isb") == ["imu_2"]


def test_a_given_topic_outdoes_all_and_a_change_is_known(tmp_path: Path) -> None:
    assert names_of(tmp_path, "/dev/a", "/dev/b") == ["imu", "imu_2"]
    names = DeviceNames(tmp_path)
    names.give_topics({"/dev/b": "imu"})
    assert [names.topic_of("1", "/dev/a"), names.topic_of("2", "/dev/b?baud=9600")] == ["imu_3", "imu"]
    assert names.moved == {"1": "imu", "2": "imu_2"}


@each_row("content", ['{"topics": {"/dev/a": ["../x", 3, "imu_9"]}}', '{"topics": [], "products": {"1": ["a"]}}'])
def test_unreadable_topics_count_as_absent(content: str, tmp_path: Path) -> None:
    (tmp_path / "devices.json").write_text(content)
    assert names_of(tmp_path, "/dev/a")[0] in ("imu", "imu_9")
    assert DeviceNames(tmp_path).former("1") == ("", "", "")


class Publisher:
    """ROS 2 of a server, without its process: what it was sent, and the events."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, **settings: Any) -> None:
        self.telemetry = Telemetry.create(lambda: 0.0)
        self.names = DeviceNames(folder)
        config = load(ros2=True, data=folder, ros2_domain=0, **settings)
        properties = {"MTi-630": SensorProperties(tilt=0.1)}
        self.ros = Ros2(
            self.telemetry, config, lambda _, product: properties.get(product, SensorProperties()), self.names
        )
        self.sent: list[dict[str, Any]] = []
        monkeypatch.setattr(type(self.ros.process), "pid", 1)
        monkeypatch.setattr(self.ros.process, "send", lambda **words: self.sent.append(words))
        self.info = wire.DeviceInfo("1", "Xbus", "/dev/a", "serial", "live", "xbus", topic="imu")
        self.telemetry.bus.set_device(self.info)
        self.ros._serve()

    def show(self, **changes: Any) -> None:
        """A device as it is known now."""
        self.info = replace(self.info, **changes)
        if self.info.product:
            self.names.identified("1", self.info.protocol, self.info.product, self.info.name)
        self.telemetry.bus.set_device(self.info)
        self.ros._on_device(self.info)

    @property
    def announced(self) -> list[tuple[str, float]]:
        return [(one["frame"], one["noise"]["tilt"]) for one in self.sent if one["op"] == "device"]

    @property
    def events(self) -> list[str]:
        return [event.text for event in self.telemetry.log]


async def test_a_product_learnt_later_renames_nothing_and_is_an_event(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The node of a device whose driver was there first was removed and announced under another name, in silence."""
    monkeypatch.setattr(ros2_service, "NAME_S", 0.0)
    frames = {"MTi-630": "imu_link"}
    first = Publisher(tmp_path, monkeypatch, ros2_frames=frames)
    first.show(name="MTi-630", product="MTi-630")
    assert first.announced == [("imu", 0.0), ("imu", 0.1)]
    assert [text.split(":")[1].strip() for text in first.events] == [
        "the frame of imu stays imu until the next start",
        "the covariances of imu are those of MTi-630 from now on.",
    ]
    second = Publisher(tmp_path, monkeypatch, ros2_frames=frames)  # what the source was is remembered
    second.show(name="MTi-630", product="MTi-630")
    assert second.announced == [("imu_link", 0.1)]
    assert second.events == []


async def test_a_device_has_a_moment_to_be_identified(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros2_service, "NAME_S", 0.02)
    publisher = Publisher(tmp_path, monkeypatch)
    assert publisher.announced == []
    await asyncio.sleep(0.05)
    assert publisher.announced == [("imu", 0.0)]


async def test_frames_and_covariances_are_set_by_source_or_by_topic(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros2_service, "NAME_S", 0.0)
    by_source = Publisher(tmp_path, monkeypatch, ros2_frames={"/dev/a": "a"}, ros2_covariances={"imu": "tilt=0.3"})
    assert by_source.announced == [("a", 0.0)]
    assert by_source.sent[0]["noise"]["sample"] == {"tilt": 0.3}
    assert Publisher(tmp_path, monkeypatch, ros2_frames={"imu": "b"}).announced == [("b", 0.0)]


@each_row(
    ("settings", "words"),
    [
        ({"ros2_names": {"/dev/a": "3x"}}, "name '3x' of /dev/a"),
        ({"ros2_names": {"/dev/a": "a__b"}}, "name 'a__b' of /dev/a"),
        ({"ros2_names": {"/dev/a": "x", "/dev/b": "x"}}, "is that of another source"),
        ({"ros2_covariances": {"imu": "turn=-1"}}, "ros2_covariances of imu: 'turn=-1'"),
        ({"ros2_covariances": {"imu": "turns=1"}}, "neither datasheet"),
        ({"ros2_covariances": {"imu": "/no/such/file"}}, "/no/such/file cannot be read"),
    ],
)
def test_wrong_settings_are_refused(settings: dict[str, Any], words: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=words):
        load(data=tmp_path, **settings).of(Ros2Settings)
