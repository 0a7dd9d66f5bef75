"""Figures of devices, as a robot reports them to its fleet."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from imuscope.server import wire
from imuscope.server.extensions.fleet.model.device_figures import DeviceFigures
from imuscope.server.streaming.telemetry import Telemetry


class Figures:
    """A device whose counters the test sets."""

    def __init__(self, protocol: str) -> None:
        self.time = 1_700_000_000.0
        telemetry = Telemetry.create(lambda: self.time)
        self.bus = telemetry.bus
        self.bus.set_device(wire.DeviceInfo("1", "IMU", "sim:imu", "serial", "live", protocol))
        self.figures = DeviceFigures(telemetry.bus, telemetry.store)

    def publish(self, counts: Mapping[str, int], lost: int = 0, rate: float = 0.0) -> tuple[float, float | None]:
        """Rate and loss after these counts."""
        messages = [wire.MessageHealth(name, 0.0, count) for name, count in counts.items()]
        fields = (rate, messages, 0, lost, 0, 0, 0.0, None, None, None, None, None)
        self.bus.health.publish({"1": wire.DeviceHealth("1", self.time, *fields, numbered=sum(counts.values()))})
        (device,) = self.figures.devices()
        return device.rate, device.loss


def test_the_rate_is_that_of_ten_seconds_by_the_time_of_the_counts() -> None:
    device = Figures("idtp")
    assert device.publish({"a": 0}, rate=99.0)[0] == 99.0  # too early to tell
    for second in range(1, 31):
        device.time += 1.0
        rate, _ = device.publish({"a": 100 * second})
    assert rate == 100.0
    device.time += 0.7
    (late,) = device.figures.devices()  # the counts are older than the question
    assert late.rate == 100.0


def test_a_message_that_takes_over_gives_the_rate() -> None:
    device = Figures("idtp")
    device.publish({"a": 1_000_000})
    for second in range(1, 31):
        device.time += 1.0
        rate, _ = device.publish({"a": 1_000_000, "b": 50 * second})
    assert rate == 50.0


def test_loss_is_that_of_the_last_minute() -> None:
    device = Figures("idtp")
    assert device.publish({"a": 0}) == (0.0, 0.0)
    device.time += 10.0
    assert device.publish({"a": 900}, lost=100)[1] == pytest.approx(0.1)
    for second in range(1, 121):
        device.time += 1.0
        _, loss = device.publish({"a": 900 + 100 * second}, lost=100)
    assert loss == 0.0


def test_a_protocol_without_counters_has_no_loss_until_some_is_lost() -> None:
    device = Figures("isb")
    assert device.publish({"a": 100})[1] is None
    device.time += 1.0
    assert device.publish({"a": 190}, lost=10)[1] == pytest.approx(0.1)


def test_a_session_that_begins_again_is_counted_again() -> None:
    device = Figures("idtp")
    device.publish({"a": 5000}, lost=50)
    device.time += 1.0
    rate, loss = device.publish({"a": 10}, rate=10.0)
    assert (rate, loss) == (10.0, 0.0)


def test_a_device_that_is_not_live_has_no_rate() -> None:
    device = Figures("idtp")
    device.publish({"a": 100}, rate=100.0)
    info = device.bus.devices.latest["1"]
    device.bus.set_device(wire.DeviceInfo("1", info.name, info.source, info.link, "lost", info.protocol))
    assert device.publish({"a": 100}, rate=100.0)[0] == 0.0
