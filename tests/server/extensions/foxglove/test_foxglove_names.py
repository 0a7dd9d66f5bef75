"""Foxglove topics of two devices of one product, and of a position with a separate height."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from foxglove.messages import FrameTransform, LocationFix

from imuscope.recordings.file_names import device_names
from imuscope.server.extensions.foxglove import worker as foxglove_worker
from imuscope.server.wire.codec import SampleFrame
from tests.recordings.store_fixtures import channel, column


class FakeServer:
    """Takes what the bridge advertises and sends."""

    def __init__(self, *_: Any) -> None:
        self.topics: list[str] = []
        self.sent: list[tuple[str, bytes]] = []

    def advertise(self, topic: str, *_: Any) -> int:
        self.topics.append(topic)
        return len(self.topics)

    def is_wanted(self, number: int) -> bool:
        return number > 0

    def send(self, number: int, time_ns: int, body: bytes) -> None:
        self.sent.append((self.topics[number - 1], body))

    def withdraw(self, ids: list[int]) -> None:
        raise AssertionError("nothing is to be withdrawn")


class RecordingClient:
    def __init__(self, devices: list[dict[str, Any]], channels: list[dict[str, Any]]) -> None:
        self.devices, self.announced, self.channels = devices, devices, {one["id"]: one for one in channels}
        self.requested_ids: list[int] = []

    def subscribe(self, expected: list[int]) -> None:
        self.requested_ids = expected


def quaternion(number: int, device: str) -> dict[str, Any]:
    columns = [{**column(f"q{i}", "f4"), "label": "", "choices": {}} for i in range(4)]
    return channel(number, device, "MTData2", "Quaternion", "quaternion", columns, frame="ENU from body")


def bridge(
    monkeypatch: pytest.MonkeyPatch, report: RecordingClient
) -> tuple[foxglove_worker.FoxgloveBridge, FakeServer]:
    server = FakeServer()
    monkeypatch.setattr(foxglove_worker, "FoxgloveServer", lambda *_: server)
    made = foxglove_worker.FoxgloveBridge(report)  # type: ignore[arg-type]
    made.configure()
    return made, server


def samples(number: int, *columns: list[float]) -> SampleFrame:
    times = np.arange(len(columns[0])) + 1.7e9
    return SampleFrame(number, 0, len(times), 0, False, 1.7e9, [times, times, *map(np.array, columns)])


def test_two_devices_of_one_product_have_topics_and_frames_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    devices = [{"id": "1", "name": "MTi-630"}, {"id": "2", "name": "MTi-630"}]
    made, server = bridge(monkeypatch, RecordingClient(devices, [quaternion(1, "1"), quaternion(2, "2")]))
    assert "/MTi-630/Quaternion" in server.topics
    assert "/MTi-630-2/Quaternion" in server.topics
    made.on_message([samples(1, [1.0], [0.0], [0.0], [0.0]), samples(2, [1.0], [0.0], [0.0], [0.0])])
    messages = [body for topic, body in server.sent if topic.endswith("attitude")]
    assert sorted(b"MTi-630-2" in body for body in messages) == [False, True]
    assert FrameTransform.get_schema().name == "foxglove.FrameTransform"


def test_a_place_has_the_height_that_comes_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    more = {"choices": {}}
    place = channel(
        2, "1", "MTData2", "LatLon", "vector", [{**column(name, "f8", "°"), **more} for name in ("lat", "lon")]
    )
    height = channel(3, "1", "MTData2", "AltitudeEllipsoid", "scalar", [{**column("value", "f8", "m"), **more}])
    height["unit"] = "m"
    report = RecordingClient([{"id": "1", "name": "MTi-680G"}], [quaternion(1, "1"), place, height])
    made, server = bridge(monkeypatch, report)
    assert 3 in report.requested_ids
    made.on_message([samples(2, [52.0, 52.1], [5.0, 5.1]), samples(3, [100.0, 101.0])])
    fixes = [body for topic, body in server.sent if topic.endswith("position")]
    assert len(fixes) == 2
    assert np.float64(101.0).tobytes() in fixes[1]
    assert LocationFix.get_schema().name == "foxglove.LocationFix"


def test_a_name_is_kept_by_the_first_of_it() -> None:
    devices = [{"id": "1", "name": "A"}, {"id": "1.7", "name": "A"}, {"id": "3", "name": ""}]
    assert device_names(devices) == {"1": "A", "1.7": "A-1.7", "3": "3"}
