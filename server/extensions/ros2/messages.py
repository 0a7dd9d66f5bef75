"""Messages of ROS 2 from the samples of a device. Pure.

    imu/data        sensor_msgs/msg/Imu              one for each attitude, with acceleration and rate of turn
    imu/data_raw    sensor_msgs/msg/Imu              one for each rate of turn; orientation_covariance[0] is −1
    imu/mag         sensor_msgs/msg/MagneticField    tesla
    gnss/fix        sensor_msgs/msg/NavSatFix        height above the ellipsoid
    velocity        geometry_msgs/msg/TwistStamped   in the frame of the map, else of the device
    twist, odometry                                  velocity and position with their accuracies: odometry.py
    time_reference  sensor_msgs/msg/TimeReference    UTC of the device at the time of the stamp
    pressure        sensor_msgs/msg/FluidPressure    Pa
    temperature     sensor_msgs/msg/Temperature      °C
    /tf             tf2_msgs/msg/TFMessage           attitude, from the frame of the map to that of the device

Axes are ENU and FLU (REP 103, 105, 145), or those of the device (axes.py).

A quantity of an Imu that is absent has a covariance that begins with −1, and so has one whose covariance is not known
(covariances.py). The definition of the message would have zeros for the latter; but filters take zeros for certain, and
leave out what has −1. In other messages 0 is not known, as their definitions say. Where roll and pitch are known, a
heading that is not has the variance of an angle that may be anything, π²/3.

Source: common_interfaces (Jazzy), REP 103, REP 105, REP 145.
"""

from dataclasses import asdict

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.protocols.rotations import quaternions
from imuscope.recordings.exporters.enu import is_place
from imuscope.server.extensions.ros2.axes import body_vectors, world_vectors
from imuscope.server.extensions.ros2.cdr_rows import stamp_columns
from imuscope.server.extensions.ros2.covariances import NOT_KNOWN_HEADING, SensorNoise
from imuscope.server.extensions.ros2.joined_rows import RowBlock, RowJoin, Times
from imuscope.server.extensions.ros2.message_builder import (
    ABSENT,
    Columns,
    FrameNames,
    Mask,
    MessageBuilder,
    alone,
    attitudes,
    diagonal,
    in_body_axes,
    xyz,
)
from imuscope.server.extensions.ros2.odometry import odometry, twist
from imuscope.server.extensions.ros2.quantities import WORLD_FRAMES, DeviceQuantities, GnssPlaces, Place, UtcPlaces

IMU, FIELD, FIX = "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField", "sensor_msgs/msg/NavSatFix"
TWIST, TIME = "geometry_msgs/msg/TwistStamped", "sensor_msgs/msg/TimeReference"
PRESSURE, TEMPERATURE = "sensor_msgs/msg/FluidPressure", "sensor_msgs/msg/Temperature"
TRANSFORM, DIAGNOSTICS = "tf2_msgs/msg/TFMessage", "diagnostic_msgs/msg/DiagnosticArray"

STATUS_FIX, STATUS_NO_FIX = 0, -1
DIAGONAL_KNOWN = 2
GPS_EPOCH_S, WEEK_S = 315_964_800, 604_800


def builders_of(
    quantities: DeviceQuantities, frames: FrameNames, properties: SensorProperties
) -> dict[str, MessageBuilder]:
    """The builders of a device, by topic: relative to the device, or with its first slash."""
    noise = (
        properties if isinstance(properties, SensorNoise) else SensorNoise(**asdict(properties), marks_unknown=False)
    )
    builders: dict[str, MessageBuilder | None] = {
        "imu/data": _imu(quantities, frames, noise, oriented=True),
        "imu/data_raw": _imu(quantities, frames, noise, oriented=False),
        "imu/mag": _field(quantities.field, frames, noise),
        "gnss/fix": _fix(quantities.fix, frames),
        "velocity": _velocity(quantities.velocity, frames, noise),
        "twist": twist(quantities, frames, noise),
        "odometry": odometry(quantities, frames, noise),
        "time_reference": _time(quantities.utc, frames),
        "pressure": _scalar(PRESSURE, "fluid_pressure", quantities.pressure, frames),
        "temperature": _scalar(TEMPERATURE, "temperature", quantities.temperature, frames),
        "/tf": _transform(quantities, frames, noise),
    }
    return {topic: builder for topic, builder in builders.items() if builder is not None}


def _imu(of: DeviceQuantities, frames: FrameNames, noise: SensorNoise, *, oriented: bool) -> MessageBuilder | None:
    places = {name: place for name, place in (("turn", of.turn), ("acceleration", of.acceleration)) if place}
    if not places or (oriented and of.attitude_place is None):
        return None
    driver_name = "attitude" if oriented else next(iter(places))
    driver = of.attitude_place if oriented else places.pop(driver_name)
    assert driver is not None
    channels = {driver.channel, *(place.channel for place in places.values())}

    def columns(block: RowBlock, rate: float) -> Columns:
        fields: Columns = {"orientation_covariance": ABSENT}
        if oriented:
            q = attitudes(of, frames, noise, block.values)
            fields = {f"orientation.{axis}": q[:, at] for at, axis in enumerate("wxyz")}
            fields["orientation_covariance"] = _attitude_covariance(noise)
        for name, path in (("turn", "angular_velocity"), ("acceleration", "linear_acceleration")):
            vectors = block.values if name == driver_name else block.others.get(name)
            fields |= _sensor(path, vectors, noise.deviation(name, rate), frames, noise, len(block.times))
        return fields

    def keep(block: RowBlock) -> Mask:
        values = quaternions(of.attitude.kind, list(block.values.T)) if oriented and of.attitude else block.values
        return np.asarray(np.isfinite(values).all(axis=1))

    return MessageBuilder(
        IMU, RowJoin(driver, places), channels, columns, {"header.frame_id": frames.device}, keep=keep
    )


def _attitude_covariance(noise: SensorNoise) -> Floats:
    tilt, heading = noise.deviation("tilt"), noise.deviation("heading") or NOT_KNOWN_HEADING
    return diagonal(tilt, tilt, heading) if tilt else ABSENT if noise.marks_unknown else np.zeros(9)


def _sensor(path: str, vectors: Floats | None, sigma: float, frames: FrameNames, noise: SensorNoise, n: int) -> Columns:
    """A vector of an Imu with its covariance."""
    covariance = np.tile(diagonal(sigma, sigma, sigma), (n, 1))
    if vectors is None:
        vectors = np.full((n, 3), np.nan)
    there = np.asarray(np.isfinite(vectors).all(axis=1))
    covariance[slice(None) if noise.marks_unknown and not sigma else ~there] = ABSENT
    turned = in_body_axes(np.where(there[:, None], vectors, 0.0), frames, noise)
    return {**xyz(path, turned), f"{path}_covariance": covariance}


def _field(place: Place | None, frames: FrameNames, noise: SensorNoise) -> MessageBuilder | None:
    if place is None:
        return None

    def columns(block: RowBlock, rate: float) -> Columns:
        sigma = noise.deviation("field", rate)
        vectors = in_body_axes(block.values, frames, noise)
        return {**xyz("magnetic_field", vectors), "magnetic_field_covariance": diagonal(sigma, sigma, sigma)}

    return alone(FIELD, place, columns, {"header.frame_id": frames.device})


def _velocity(place: Place | None, frames: FrameNames, noise: SensorNoise) -> MessageBuilder | None:
    if place is None:
        return None
    is_world = place.frame in WORLD_FRAMES

    def columns(block: RowBlock, rate: float) -> Columns:
        vectors = block.values
        if frames.rep103:
            vectors = world_vectors(vectors, place.frame) if is_world else body_vectors(vectors, noise.axes)
        # A velocity has no rate of turn with it: not a number, rather than a zero that would be believed.
        return {**xyz("twist.linear", vectors), **xyz("twist.angular", np.full(vectors.shape, np.nan))}

    return alone(TWIST, place, columns, {"header.frame_id": frames.map if is_world else frames.device})


def _scalar(type_name: str, path: str, place: Place | None, frames: FrameNames) -> MessageBuilder | None:
    if place is None:
        return None
    return alone(type_name, place, lambda block, rate: {path: block.values[:, 0]}, {"header.frame_id": frames.device})


def _fix(of: GnssPlaces | None, frames: FrameNames) -> MessageBuilder | None:
    if of is None:
        return None
    others = {
        name: place
        for name, place in (
            ("height", of.height),
            ("horizontal", of.horizontal),
            ("vertical", of.vertical),
            ("fix", of.fix),
        )
        if place
    }
    invalid = np.array(of.invalid, np.float64)

    def columns(block: RowBlock, rate: float) -> Columns:
        n = len(block.times)
        nothing = np.full((n, 1), np.nan)
        height, horizontal, vertical, fix = (
            block.others.get(name, nothing)[:, 0] for name in ("height", "horizontal", "vertical", "fix")
        )
        known = np.asarray(np.isfinite(horizontal) & np.isfinite(vertical))
        covariance = np.zeros((n, 9))
        for at, sigma in ((0, horizontal), (4, horizontal), (8, vertical)):
            covariance[known, at] = sigma[known] ** 2
        return {
            "latitude": block.values[:, 0],
            "longitude": block.values[:, 1],
            "altitude": height,
            "status.status": np.where(np.isin(fix, invalid), STATUS_NO_FIX, STATUS_FIX),
            "position_covariance": covariance,
            "position_covariance_type": np.where(known, DIAGONAL_KNOWN, 0),
        }

    def keep(block: RowBlock) -> Mask:
        return is_place(block.values[:, 0], block.values[:, 1])

    channels = {of.place.channel, *(place.channel for place in others.values())}
    return MessageBuilder(
        FIX, RowJoin(of.place, others), channels, columns, {"header.frame_id": frames.device}, keep=keep
    )


def _time(of: UtcPlaces | None, frames: FrameNames) -> MessageBuilder | None:
    if of is None:
        return None
    extra = tuple(column for column in (of.nano, of.valid) if column >= 0)
    place = Place(of.parts.channel, (*of.parts.columns, *extra), of.parts.message)

    def columns(block: RowBlock, rate: float) -> Columns:
        return dict(stamp_columns(utc_of(of, block.values), "time_ref"))

    def keep(block: RowBlock) -> Mask:
        has_utc: Mask = utc_of(of, block.values) > 0
        return has_utc

    texts = {"header.frame_id": frames.device, "source": "gnss" if of.is_receiver else "device"}
    return MessageBuilder(TIME, RowJoin(place, {}), {place.channel}, columns, texts, keep=keep)


def clock_builder(place: Place, frames: FrameNames, source: str) -> MessageBuilder:
    """The builder of a clock reading of the device, in ns by the scale of its place."""

    def columns(block: RowBlock, rate: float) -> Columns:
        return dict(stamp_columns(np.round(block.values[:, 0]).astype(np.int64), "time_ref"))

    return alone(TIME, place, columns, {"header.frame_id": frames.device, "source": source})


def utc_of(of: UtcPlaces, values: Floats) -> Times:
    """UTC of rows in ns since 1970; 0 where the device does not know it.

    Args:
        values: (n, k) columns of the parts, then ns and flags if there are any.
    """
    if of.kind == "gps":
        week, ms, leap = values.T
        seconds = GPS_EPOCH_S + week * WEEK_S - leap
        utc = seconds.astype(np.int64) * 1_000_000_000 + (ms * 1e6).astype(np.int64)
        return np.where((week > 0) & (leap > 0), utc, 0)
    year, month, day, hour, minute, second, *extra = np.nan_to_num(values).astype(np.int64).T
    nano = extra.pop(0) if of.nano >= 0 else np.zeros_like(year)
    valid = extra[0] & 3 == 3 if extra else np.ones(len(year), np.bool_)
    valid &= (year >= 1980) & (year < 2200) & (month >= 1) & (month <= 12) & (day >= 1)
    dates = (np.where(valid, year, 1970) - 1970).astype("M8[Y]").astype("M8[M]") + (np.where(valid, month, 1) - 1)
    days = dates.astype("M8[D]").astype(np.int64) + day - 1
    seconds = ((days * 24 + hour) * 60 + minute) * 60 + second
    return np.where(valid, seconds * 1_000_000_000 + nano, 0)


def _transform(of: DeviceQuantities, frames: FrameNames, noise: SensorNoise) -> MessageBuilder | None:
    place = of.attitude_place
    if place is None:
        return None

    def columns(block: RowBlock, rate: float) -> Columns:
        q = attitudes(of, frames, noise, block.values)
        return {f"transforms.0.transform.rotation.{axis}": q[:, at] for at, axis in enumerate("wxyz")}

    def keep(block: RowBlock) -> Mask:
        assert of.attitude is not None
        return np.asarray(np.isfinite(quaternions(of.attitude.kind, list(block.values.T))).all(axis=1))

    return MessageBuilder(
        TRANSFORM,
        RowJoin(place, {}),
        {place.channel},
        columns,
        {"transforms.0.header.frame_id": frames.map, "transforms.0.child_frame_id": frames.device},
        lengths={"transforms": 1},
        stamp="transforms.0.header.stamp",
        keep=keep,
    )
