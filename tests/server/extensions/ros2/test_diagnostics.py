"""Diagnostics of a device, read by rosbags."""

from __future__ import annotations

from typing import Any

from imuscope.server.extensions.ros2.diagnostics import ARRAY, DiagnosticCounts, diagnostics
from tests.server.extensions.ros2.samples import deserialize
from tests.support.each_row import each_row

DEVICE = {
    "id": "1",
    "name": "MTi-630",
    "status": "live",
    "source": "/dev/ttyUSB0",
    "product": "MTi-630",
    "serial_number": "42",
    "message": "",
}
HEALTH: dict[str, Any] = {
    "rate": 100.04,
    "bytes_per_s": 9000.4,
    "lost": 3,
    "gaps": 1,
    "rejects": 0,
    "jitter_ms": 0.5,
    "drift_ppm": None,
    "uncertainty_ms": 0.25,
    "messages": [{"name": "MTData2", "rate": 100.0}],
    "rejects_by": {},
}


def status_of(device: dict[str, Any], health: dict[str, Any] | None, last: DiagnosticCounts) -> Any:
    data, _ = diagnostics("mti_630", device, health, last, 5_000_000_006)
    message = deserialize(data, ARRAY)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (5, 6)
    (status,) = message.status
    return status


def test_a_live_device_is_ok_and_reports_how_well_its_clock_is_known() -> None:
    status = status_of(DEVICE, HEALTH, DiagnosticCounts(lost=3))
    values = {one.key: one.value for one in status.values}
    assert (status.level, status.name, status.hardware_id) == (0, "imuscope: mti_630", "42")
    assert status.message == "Live, 100.0 Hz"
    assert values["stamp_uncertainty_ms"] == "0.25"
    assert values["rate_hz.MTData2"] == "100.0"
    assert "clock_drift_ppm" not in values
    assert "simulated" not in values
    of_simulator = status_of(DEVICE | {"simulated": True}, HEALTH, DiagnosticCounts(lost=3))
    assert {one.key: one.value for one in of_simulator.values}["simulated"] == "True"


@each_row(
    ("changes", "words"),
    [
        ({"lost": 5}, "2 samples lost."),
        ({"rejects": 4}, "4 frames rejected."),
        ({"uncertainty_ms": 80.0}, "± 80 ms"),
        ({"behind": {"decoding": 12.0}}, "Decoding is 12 s behind the data received."),
    ],
)
def test_new_problems_are_warnings(changes: dict[str, Any], words: str) -> None:
    status = status_of(DEVICE, {**HEALTH, **changes}, DiagnosticCounts(lost=3))
    assert status.level == 1
    assert words in status.message


@each_row(("state", "level"), [("lost", 2), ("denied", 2), ("connecting", 1), ("ended", 3)])
def test_a_device_without_data_is_not_ok(state: str, level: int) -> None:
    status = status_of({**DEVICE, "status": state, "message": "/dev/ttyUSB0 is gone."}, None, DiagnosticCounts())
    assert (status.level, status.message) == (level, "/dev/ttyUSB0 is gone.")
