"""Velocity and odometry with covariances, as rosbags reads them; covariances by hand and from a measurement."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.extensions.ros2.covariances import SensorNoise, noise_of
from imuscope.server.extensions.ros2.message_builder import FrameNames
from imuscope.server.extensions.ros2.messages import builders_of
from imuscope.server.extensions.ros2.quantities import quantities_of
from tests.server.extensions.ros2.samples import (
    ACCELERATION,
    DEVICE,
    FRAMES,
    QUATERNION,
    TURN,
    built,
    frame,
    info,
    vector,
    xyz,
)
from tests.support.each_row import each_row

PVT = info(
    4,
    "GNSS solution",
    {
        **{"lat": "°", "lon": "°", "height": "m", "hAcc": "m", "vAcc": "m"},
        **{"velN": "m/s", "velE": "m/s", "velD": "m/s", "sAcc": "m/s"},
    },
    kind="record",
)
LEVEL_EAST = ([1.0], [0.0], [0.0], [0.0])  # x of the body points east
STEP = 1e-4  # of latitude, °: 11.1 m


def pvt(lat: float, sacc: float = 0.5, time: float = 0.0) -> Any:
    return frame(4, [time], [lat], [0.0], [100.0], [2.0], [3.0], [1.0], [5.0], [0.25], [sacc])


def test_a_velocity_with_its_accuracy_is_a_twist_in_the_map() -> None:
    twist, none = built("twist", [PVT], [pvt(48.0), pvt(48.0, 0.7, 0.25), pvt(48.0, 0.0, 0.5)])[0:2]
    assert vector(twist.twist.twist.linear) == [5.0, 1.0, -0.25]
    assert twist.header.frame_id == "map"
    covariance = np.reshape(twist.twist.covariance, (6, 6))
    assert np.diag(covariance).tolist() == [0.25, 0.25, 0.25, -1.0, 0.0, 0.0]  # no rate of turn
    assert np.reshape(none.twist.covariance, (6, 6))[0, 0] == pytest.approx(0.49)


def test_odometry_begins_at_the_first_position_and_moves_in_the_frame_of_the_device() -> None:
    samples = [frame(3, [0.0], *LEVEL_EAST), frame(1, [0.0], [10.0], [0.0], [0.0]), pvt(48.0)]
    later = [frame(3, [0.25], [math.sqrt(0.5)], [0.0], [0.0], [math.sqrt(0.5)]), pvt(48.0 + STEP, time=0.25)]
    noise = SensorProperties(tilt=0.01, heading=0.02)
    first, second = built("odometry", [TURN, QUATERNION, PVT], samples, later, noise=noise)
    assert (first.header.frame_id, first.child_frame_id) == ("map", "imu0")
    assert vector(first.pose.pose.position) == pytest.approx([0, 0, 0], abs=1e-9)
    assert vector(second.pose.pose.position) == pytest.approx([0, 11.12, 0], abs=0.01)
    assert vector(first.twist.twist.linear) == pytest.approx([5.0, 1.0, -0.25])
    assert vector(second.twist.twist.linear) == pytest.approx([1.0, -5.0, -0.25])  # it has turned to the north
    assert first.twist.twist.angular.x == pytest.approx(math.radians(10))
    pose = np.diag(np.reshape(first.pose.covariance, (6, 6)))
    assert pose == pytest.approx([4.0, 4.0, 9.0, 1e-4, 1e-4, 4e-4])
    assert np.reshape(first.twist.covariance, (6, 6))[3, 3] == -1.0  # the rate is there, its noise is not known
    unknown = built("odometry", [QUATERNION, PVT], [frame(3, [0.0], *LEVEL_EAST), pvt(48.0)])[0]
    assert np.reshape(unknown.pose.covariance, (6, 6))[5, 5] == pytest.approx(math.pi**2 / 3)


def test_velocity_against_the_axes_of_the_earth_is_turned_to_the_map() -> None:
    speed = info(7, "Velocity", xyz("m/s"), frame="ECEF", message="V")
    accuracy = info(8, "sAcc", {"sAcc": "m/s"}, kind="scalar", message="V", name="sAcc")
    place = info(9, "Latitude, longitude", {"lat": "°", "lon": "°"})
    samples = [frame(9, [0.0], [0.0], [90.0]), frame(8, [0.0], [0.1]), frame(7, [0.0], [1.0], [2.0], [3.0])]
    (twist,) = built("twist", [place, accuracy, speed], samples)
    assert vector(twist.twist.twist.linear) == pytest.approx([-1.0, 3.0, 2.0])


def test_nothing_is_offered_without_accuracies_or_in_the_axes_of_the_device() -> None:
    velocity = info(7, "Velocity", xyz("m/s"), frame="ENU")
    assert not {"twist", "odometry"} & builders_of(quantities_of(DEVICE, [velocity]), FRAMES, SensorProperties()).keys()
    quantities = quantities_of(DEVICE, [PVT, QUATERNION])
    axes = FrameNames("imu0", "map", rep103=False)
    assert not {"twist", "odometry"} & builders_of(quantities, axes, SensorProperties()).keys()
    assert {"twist", "odometry"} <= builders_of(quantities, FRAMES, SensorProperties()).keys()
    source = noise_of("velocity=0.1", SensorProperties())
    (twist,) = built("twist", [velocity], [frame(7, [0.0], [1], [2], [3])], noise=source)
    assert twist.twist.covariance[0] == pytest.approx(0.01)


def test_an_unknown_covariance_begins_with_minus_one() -> None:
    """It was 0, which filters take for certain."""
    samples = [frame(3, [0.0], *LEVEL_EAST), frame(1, [0.0], [1], [2], [3]), frame(2, [0.0], [0], [0], [9.8])]
    (message,) = built("imu/data", [TURN, ACCELERATION, QUATERNION], samples, noise=SensorNoise())
    assert message.orientation_covariance[0] == -1
    assert message.angular_velocity_covariance[0] == -1
    assert message.linear_acceleration_covariance[0] == -1
    assert vector(message.linear_acceleration) == [0, 0, 9.8]
    (filed,) = built("imu/data", [TURN, ACCELERATION, QUATERNION], samples)
    assert not filed.orientation_covariance.any(), "a reader of the bag would leave the orientation out"
    assert not filed.angular_velocity_covariance.any()
    noise = SensorNoise(tilt=0.1)
    (vru,) = built("imu/data", [TURN, ACCELERATION, QUATERNION], samples, noise=noise)
    assert vru.orientation_covariance[[0, 4, 8]] == pytest.approx([0.01, 0.01, math.pi**2 / 3])


def test_covariances_are_set_by_hand_or_taken_from_a_measurement(tmp_path: Path) -> None:
    sheet = SensorProperties("FRD", turn=0.2, acceleration=0.4, tilt=0.1)
    assert noise_of("", sheet) == noise_of("datasheet", sheet)
    assert noise_of("unknown", sheet) == SensorNoise("FRD")
    by_hand = noise_of("turn=0.002, heading=0.05", sheet)
    assert [by_hand.deviation(name, 50.0) for name in ("turn", "acceleration", "tilt", "heading")] == pytest.approx(
        [0.002, 2.0, 0.1, 0.05]
    )
    file = tmp_path / "imu.yaml"
    file.write_text("# Kalibr\naccelerometer_noise_density: 2.0e-03  # m/s²/√Hz\ngyroscope_noise_density: 1e-4\n")
    measured = noise_of(str(file), sheet)  # of a sample: walk × √rate
    assert [measured.deviation(name, 100.0) for name in ("turn", "acceleration")] == pytest.approx([1e-3, 2e-2])
    file.write_text("gyroscope_noise_density: 1.2.3\n")
    with pytest.raises(ValueError, match="has no noise density"):
        noise_of(str(file), sheet)


@each_row(
    ("product", "tilt", "heading"),
    [("MTi-300", 0.2, 1.0), ("MTi-30", 0.5, 1.0), ("MTi-20", 0.5, 0.0), ("MTi-100", 0.0, 0.0), ("MTi-630-8A1G6", 0, 0)],
)
def test_a_data_sheet_has_the_accuracy_of_the_attitude(product: str, tilt: float, heading: float) -> None:
    sensors = PROTOCOLS["xbus"].device.sensors(product)
    assert [math.degrees(sensors.tilt), math.degrees(sensors.heading)] == pytest.approx([tilt, heading])
