"""Messages of ROS from samples: values, axes, units, stamps, covariances; read by rosbags."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.server.extensions.ros2.messages import FrameNames, builders_of
from imuscope.server.extensions.ros2.quantities import quantities_of
from tests.server.extensions.ros2.samples import (
    ACCELERATION,
    DEVICE,
    FRAMES,
    QUATERNION,
    T0,
    TURN,
    built,
    frame,
    info,
    vector,
    xyz,
)
from tests.support.each_row import each_row

FRD = SensorProperties(axes="FRD")
FIX = info(
    4,
    "GNSS solution",
    {"fixtype": "", "lat": "°", "lon": "°", "height": "mm", "hAcc": "mm", "vAcc": "m"},
    kind="record",
)
FIX["columns"][0]["choices"] = {"0": "no fix", "3": "3D"}


def stamp(message: Any) -> float:
    return float(message.header.stamp.sec - T0 + message.header.stamp.nanosec / 1e9)


def test_a_level_device_at_rest_reports_gravity_upwards_in_either_body_axes() -> None:
    for axes, z in (("FLU", 9.81), ("FRD", -9.81)):
        noise = SensorProperties(axes=axes)  # type: ignore[arg-type]
        samples = [frame(1, [0.0], [1.0], [90.0], [180.0]), frame(2, [0.0], [0.0], [0.5], [z])]
        (message,) = built("imu/data_raw", [TURN, ACCELERATION], samples, noise=noise)
        sign = 1 if axes == "FLU" else -1
        assert vector(message.linear_acceleration) == pytest.approx([0, sign * 0.5, 9.81])
        assert vector(message.angular_velocity) == pytest.approx([math.radians(1), sign * math.pi / 2, sign * math.pi])
        assert message.orientation_covariance[0] == -1
        assert message.header.frame_id == "imu0"
        assert stamp(message) == 0.0


def test_the_axes_of_the_device_are_kept_if_configured() -> None:
    samples = [frame(1, [0.0], [1.0], [2.0], [3.0]), frame(2, [0.0], [0.0], [0.5], [-9.81])]
    frames = FrameNames("imu0", "map", rep103=False)
    (message,) = built("imu/data_raw", [TURN, ACCELERATION], samples, noise=FRD, frames=frames)
    assert vector(message.linear_acceleration) == [0, 0.5, -9.81]


def test_the_stamp_is_the_mapped_time_and_not_the_arrival() -> None:
    channels = [TURN, ACCELERATION]
    (message,) = built(
        "imu/data_raw",
        channels,
        [frame(1, [1.25], [0], [0], [0], arrival=0.02), frame(2, [1.25], [0], [0], [9.8], arrival=0.02)],
    )
    assert stamp(message) == pytest.approx(1.25, abs=1e-6)


def test_an_attitude_of_another_message_waits_for_the_same_time() -> None:
    channels = [TURN, ACCELERATION, QUATERNION]
    q = ([1.0, 1.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
    first = [frame(3, [0.00, 0.01], *q), frame(1, [0.0], [10], [0], [0]), frame(2, [0.0], [1], [0], [0])]
    second = [frame(1, [0.01], [20], [0], [0]), frame(2, [0.01], [2], [0], [0])]
    results = built("imu/data", channels, first, second)
    assert [stamp(one) for one in results] == pytest.approx([0.0, 0.01], abs=1e-6)
    assert [one.linear_acceleration.x for one in results] == [1, 2]
    assert [one.angular_velocity.x for one in results] == pytest.approx([math.radians(10), math.radians(20)])
    assert [one.orientation.w for one in results] == [1, 1]


def test_rows_do_not_wait_for_a_channel_that_has_stopped() -> None:
    times = np.arange(100) / 100
    ones, zeros = np.ones(100), np.zeros(100)
    attitudes = frame(3, times.tolist(), ones, zeros, zeros, zeros)
    samples = [attitudes, frame(2, [0.0], [1], [0], [9.8])]
    noise = SensorProperties(acceleration=0.01)
    results = built("imu/data", [TURN, ACCELERATION, QUATERNION], samples, noise=noise)
    assert len(results) > 90
    assert results[0].linear_acceleration.z == 9.8
    assert results[0].linear_acceleration_covariance[0] > 0
    assert results[-1].linear_acceleration_covariance[0] == -1  # too old to be true
    assert results[0].angular_velocity_covariance[0] == -1  # never received


def test_invalid_attitudes_are_left_out() -> None:
    samples = [frame(3, [0.0, 0.01, 0.02], [1, 0, math.nan], [0, 0, 0], [0, 0, 0], [0, 0, 0])]
    assert len(built("imu/data", [ACCELERATION, QUATERNION], samples)) == 1


def test_noise_of_the_data_sheet_becomes_a_covariance() -> None:
    times = (np.arange(100) / 100).tolist()
    rows = [np.zeros(100)] * 3
    noise = SensorProperties(turn=0.001, acceleration=0.01, field=1e-8, tilt=0.01, heading=0.02)
    samples = [frame(1, times, *rows), frame(2, times, *rows), frame(3, times, np.ones(100), *rows)]
    for topic in ("imu/data", "imu/data_raw"):
        message = built(topic, [TURN, ACCELERATION, QUATERNION], samples, noise=noise)[-1]
        assert message.angular_velocity_covariance == pytest.approx(np.diag([0.001**2 * 50] * 3).ravel(), rel=1e-3)
        assert message.linear_acceleration_covariance == pytest.approx(np.diag([0.01**2 * 50] * 3).ravel(), rel=1e-3)
    message = built("imu/data", [TURN, QUATERNION], samples, noise=noise)[-1]
    assert message.orientation_covariance == pytest.approx(np.diag([1e-4, 1e-4, 4e-4]).ravel())


@each_row(("unit", "tesla"), [("µT", 5e-5), ("G", 5e-3), ("nT", 5e-8)])
def test_a_magnetic_field_with_a_unit_is_in_tesla(unit: str, tesla: float) -> None:
    (message,) = built("imu/mag", [info(5, "Magnetic field", xyz(unit))], [frame(5, [0.0], [50], [0], [0])])
    assert message.magnetic_field.x == pytest.approx(tesla)


@each_row("unit", ["a.u.", "", "LSB"])
def test_a_magnetic_field_without_a_unit_is_not_published(unit: str) -> None:
    quantities = quantities_of(DEVICE, [info(5, "Magnetic field", xyz(unit))])
    assert "imu/mag" not in builders_of(quantities, FRAMES, SensorProperties())
    assert "tesla" in quantities.no_field


def test_a_fix_has_the_accuracy_that_the_device_reports() -> None:
    samples = [frame(4, [0.0, 1.0], [3, 0], [48.1, 48.2], [11.5, 11.6], [520_000, 0], [1500, 0], [2.5, 0])]
    fix, none = built("gnss/fix", [FIX], samples)
    assert (fix.latitude, fix.longitude, fix.altitude, fix.status.status) == (48.1, 11.5, 520.0, 0)
    assert fix.position_covariance == pytest.approx(np.diag([2.25, 2.25, 6.25]).ravel())
    assert fix.position_covariance_type == 2
    assert none.status.status == -1


def test_a_fix_without_height_and_accuracy_states_it() -> None:
    channel = info(4, "Latitude, longitude", {"lat": "°", "lon": "°"})
    (fix,) = built("gnss/fix", [channel], [frame(4, [0.0, 1.0], [48.1, 0.0], [11.5, 0.0])])
    assert math.isnan(fix.altitude)
    assert (fix.position_covariance_type, fix.position_covariance[0]) == (0, 0)


def test_the_receiver_comes_before_the_filter() -> None:
    fused = info(6, "Position", {"lat": "°", "lon": "°", "alt": "m"}, message="INS")
    (fix,) = built("gnss/fix", [fused, FIX], [frame(4, [0.0], [3], [48.1], [11.5], [0], [1], [1])])
    assert fix.latitude == 48.1


def test_velocity_is_in_the_map_or_in_the_body() -> None:
    ned = info(7, "Velocity", xyz("m/s"), frame="NED")
    body = info(8, "Velocity", xyz("m/s"), frame="body", message="B")
    ecef = info(9, "Velocity", xyz("m/s"), frame="ECEF", message="E")
    (message,) = built("velocity", [ecef, body, ned], [frame(7, [0.0], [1], [2], [3])], noise=FRD)
    assert vector(message.twist.linear) == [2, 1, -3]
    assert message.header.frame_id == "map"
    assert math.isnan(message.twist.angular.z)
    (message,) = built("velocity", [ecef, body], [frame(8, [0.0], [1], [2], [3])], noise=FRD)
    assert vector(message.twist.linear) == [1, -2, -3]
    assert message.header.frame_id == "imu0"
    assert quantities_of(DEVICE, [ecef]).velocity is None


def test_pressure_and_temperature_may_be_columns_of_a_record() -> None:
    channel = info(10, "Barometer", {"time": "s", "bar": "kPa", "barTemp": "°C"}, kind="record")
    samples = [frame(10, [0.0], [5], [101.3], [24.5])]
    assert built("pressure", [channel], samples)[0].fluid_pressure == pytest.approx(101_300)
    assert built("temperature", [channel], samples)[0].temperature == 24.5


def test_time_of_the_device_in_utc() -> None:
    date = {"year": "", "month": "", "day": "", "hour": "h", "min": "min", "sec": "s", "valid": "", "nano": "ns"}
    channel = info(11, "GNSS solution", date, kind="record")
    rows = [(2026, 11, 23, 10, 20, 30, 3, -5), (2026, 11, 23, 10, 20, 30, 1, 0), (0, 0, 0, 0, 0, 0, 3, 0)]
    (message,) = built("time_reference", [channel], [frame(11, [0.0, 1.0, 2.0], *zip(*rows, strict=True))])
    assert message.time_ref.sec * 10**9 + message.time_ref.nanosec == 1_795_429_230 * 10**9 - 5
    assert message.source == "gnss"


def test_gps_weeks_are_utc_with_the_leap_seconds_of_the_device() -> None:
    channel = info(12, "GPS1", {"week": "week", "timeOfWeekMs": "ms", "leapS": ""}, kind="record", group="GPS1")
    columns = ([2446, 0], [123_456_500, 0], [18, 0])
    (message,) = built("time_reference", [channel], [frame(12, [0.0, 1.0], *columns)])
    assert message.time_ref.sec == 315_964_800 + 2446 * 604_800 + 123_456 - 18
    assert message.time_ref.nanosec == 500_000_000


def test_a_transform_leads_from_the_map_to_the_device() -> None:
    (message,) = built("/tf", [QUATERNION], [frame(3, [0.5], [0.6], [0], [0], [0.8])])
    (transform,) = message.transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("map", "imu0")
    rotation = transform.transform.rotation
    assert (rotation.w, rotation.z) == pytest.approx((0.6, 0.8))
    assert transform.header.stamp.nanosec == 500_000_000


def test_of_channels_with_one_name_the_newest_is_active() -> None:
    newer = {**TURN, "id": 20, "frame": ""}
    assert quantities_of(DEVICE, [TURN, newer]).turn.channel == 20  # type: ignore[union-attr]


def test_a_device_without_quantities_has_no_topics() -> None:
    assert builders_of(quantities_of(DEVICE, []), FRAMES, SensorProperties()) == {}
