"""Messages of ROS 2 from the samples of a device. Pure.

    imu/data        sensor_msgs/msg/Imu              one for each attitude, with acceleration and rate of turn
    imu/data_raw    sensor_msgs/msg/Imu              one for each rate of turn; orientation_covariance[0] is −1
    imu/mag         sensor_msgs/msg/MagneticField    tesla
    gnss/fix        sensor_msgs/msg/NavSatFix        height above the ellipsoid
    velocity        geometry_msgs/msg/TwistStamped   in the frame of the map, else of the device
    time_reference  sensor_msgs/msg/TimeReference    UTC of the device at the time of the stamp
    pressure        sensor_msgs/msg/FluidPressure    Pa
    temperature     sensor_msgs/msg/Temperature      °C
    /tf             tf2_msgs/msg/TFMessage           attitude, from the frame of the map to that of the device

Axes are ENU and FLU (REP 103, 105, 145), or those of the device (axes.py). A quantity that is absent has a
covariance that begins with −1; a covariance that is not known is 0, as the definitions of the messages say. The
covariance of a sensor's noise is density² × rate / 2.

Source: common_interfaces (Jazzy), REP 103, REP 105, REP 145.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.rotations import quaternions
from imuscope.protocols.sensor_properties import SensorProperties
from imuscope.recordings.enu import is_place
from imuscope.server.extensions.ros2.axes import Floats, body_vectors, enu_from_flu, world_vectors
from imuscope.server.extensions.ros2.cdr_rows import RowEncoder, stamp_columns
from imuscope.server.extensions.ros2.joined_rows import RowBlock, RowJoin, Times
from imuscope.server.extensions.ros2.quantities import WORLD_FRAMES, DeviceQuantities, GnssPlaces, Place, UtcPlaces
from imuscope.server.wire_codec import SampleFrame

Samples = Mapping[int, Sequence[SampleFrame]]
Columns = dict[str, object]
Mask = NDArray[np.bool_]

IMU, FIELD, FIX = "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField", "sensor_msgs/msg/NavSatFix"
TWIST, TIME = "geometry_msgs/msg/TwistStamped", "sensor_msgs/msg/TimeReference"
PRESSURE, TEMPERATURE = "sensor_msgs/msg/FluidPressure", "sensor_msgs/msg/Temperature"
TRANSFORM, DIAGNOSTICS = "tf2_msgs/msg/TFMessage", "diagnostic_msgs/msg/DiagnosticArray"

STATUS_FIX, STATUS_NO_FIX = 0, -1
DIAGONAL_KNOWN = 2
GPS_EPOCH_S, WEEK_S = 315_964_800, 604_800
ABSENT = np.array([-1.0, *(0.0,) * 8])


@dataclass(frozen=True, slots=True)
class FrameNames:
    """Names of frames, and whether vectors are turned to the axes of REP 103.

    Args:
        device: of the device: "imu0".
        map: of the world: "map".
    """

    device: str
    map: str = "map"
    rep103: bool = True


class MessageBuilder:
    """The messages of one topic.

    Args:
        type: of its messages.
        join: the channels that it needs.
        columns: values of the messages from complete rows; rows without a message are left out beforehand.
        encoder: with the texts of the messages.
        stamp: path of the time.

    Attributes:
        left_out: rows without a message so far.
    """

    def __init__(
        self,
        type: str,
        join: RowJoin,
        channels: set[int],
        columns: Callable[[RowBlock, float], Columns],
        texts: Mapping[str, str],
        *,
        lengths: Mapping[str, int] | None = None,
        stamp: str = "header.stamp",
        keep: Callable[[RowBlock], Mask] | None = None,
    ) -> None:
        self.type, self.channels = type, channels
        self.left_out = 0
        self._join, self._columns, self._stamp, self._keep = join, columns, stamp, keep
        self._texts, self._lengths = texts, lengths
        self._encoder: RowEncoder | None = None
        self._rate = RateEstimate()

    def build(self, samples: Samples) -> list[bytes]:
        """The messages that newly received samples make complete."""
        return self.build_with_arrivals(samples)[1]

    def build_with_arrivals(self, samples: Samples, *, waits: bool = True) -> tuple[Sequence[int], list[bytes]]:
        """The arrival of each message, ns since 1970, and the messages.

        Args:
            waits: whether other samples of the same time may still arrive.
        """
        block = self._join.take(samples, waits=waits)
        if block is None:
            return (), []
        rate = self._rate.update(block)
        if self._keep is not None:
            whole = np.flatnonzero(self._keep(block))
            self.left_out += len(block.times) - len(whole)
            block = _rows(block, whole)
        n = len(block.times)
        if n == 0:
            return (), []
        if self._encoder is None:
            self._encoder = RowEncoder(self.type, self._texts, self._lengths)
        columns = {**dict(stamp_columns(block.times, self._stamp)), **self._columns(block, rate)}
        return block.arrivals.tolist(), self._encoder.encode(n, columns)


@dataclass(slots=True)
class RateEstimate:
    """Rate of rows, from their times."""

    rate: float = 0.0
    _last: int = 0
    _intervals: list[int] = field(default_factory=list)

    def update(self, block: RowBlock) -> float:
        """Rows/s, the median of the last intervals; 0 at first."""
        steps = np.diff(block.times, prepend=self._last or block.times[0])
        self._last = int(block.times[-1])
        self._intervals += [int(step) for step in steps if 0 < step < 2_000_000_000]
        if len(self._intervals) >= 32 or (self._intervals and not self.rate):
            self.rate = 1e9 / float(np.median(self._intervals))
            self._intervals = []
        return self.rate


def builders_of(quantities: DeviceQuantities, frames: FrameNames, noise: SensorProperties) -> dict[str, MessageBuilder]:
    """The builders of a device, by topic: relative to the device, or with its first slash."""
    builders: dict[str, MessageBuilder | None] = {
        "imu/data": _imu(quantities, frames, noise, oriented=True),
        "imu/data_raw": _imu(quantities, frames, noise, oriented=False),
        "imu/mag": _field(quantities.field, frames, noise),
        "gnss/fix": _fix(quantities.fix, frames),
        "velocity": _velocity(quantities.velocity, frames, noise),
        "time_reference": _time(quantities.utc, frames),
        "pressure": _scalar(PRESSURE, "fluid_pressure", quantities.pressure, frames),
        "temperature": _scalar(TEMPERATURE, "temperature", quantities.temperature, frames),
        "/tf": _transform(quantities, frames, noise),
    }
    return {topic: builder for topic, builder in builders.items() if builder is not None}


def _imu(of: DeviceQuantities, frames: FrameNames, noise: SensorProperties, *, oriented: bool) -> MessageBuilder | None:
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
            q = _attitudes(of, frames, noise, block.values)
            fields = {f"orientation.{axis}": q[:, at] for at, axis in enumerate("wxyz")}
            fields["orientation_covariance"] = _diagonal(noise.tilt, noise.tilt, noise.heading)
        for name, path, density in (
            ("turn", "angular_velocity", noise.turn),
            ("acceleration", "linear_acceleration", noise.acceleration),
        ):
            vectors = block.values if name == driver_name else block.others.get(name)
            fields |= _sensor(path, vectors, density * math.sqrt(rate / 2), frames, noise, len(block.times))
        return fields

    def keep(block: RowBlock) -> Mask:
        values = quaternions(of.attitude.kind, list(block.values.T)) if oriented and of.attitude else block.values
        return np.asarray(np.isfinite(values).all(axis=1))

    return MessageBuilder(
        IMU, RowJoin(driver, places), channels, columns, {"header.frame_id": frames.device}, keep=keep
    )


def _sensor(
    path: str, vectors: Floats | None, sigma: float, frames: FrameNames, noise: SensorProperties, n: int
) -> Columns:
    """A vector of an Imu with its covariance."""
    covariance = np.tile(_diagonal(sigma, sigma, sigma), (n, 1))
    if vectors is None:
        vectors = np.full((n, 3), np.nan)
    there = np.asarray(np.isfinite(vectors).all(axis=1))
    covariance[~there] = ABSENT
    turned = _body(np.where(there[:, None], vectors, 0.0), frames, noise)
    return {**_xyz(path, turned), f"{path}_covariance": covariance}


def _field(place: Place | None, frames: FrameNames, noise: SensorProperties) -> MessageBuilder | None:
    if place is None:
        return None

    def columns(block: RowBlock, rate: float) -> Columns:
        sigma = noise.field * math.sqrt(rate / 2)
        vectors = _body(block.values, frames, noise)
        return {**_xyz("magnetic_field", vectors), "magnetic_field_covariance": _diagonal(sigma, sigma, sigma)}

    return _alone(FIELD, place, columns, {"header.frame_id": frames.device})


def _velocity(place: Place | None, frames: FrameNames, noise: SensorProperties) -> MessageBuilder | None:
    if place is None:
        return None
    is_world = place.frame in WORLD_FRAMES

    def columns(block: RowBlock, rate: float) -> Columns:
        vectors = block.values
        if frames.rep103:
            vectors = world_vectors(vectors, place.frame) if is_world else body_vectors(vectors, noise.axes)
        # A velocity has no rate of turn with it: not a number, rather than a zero that would be believed.
        return {**_xyz("twist.linear", vectors), **_xyz("twist.angular", np.full(vectors.shape, np.nan))}

    return _alone(TWIST, place, columns, {"header.frame_id": frames.map if is_world else frames.device})


def _scalar(type: str, path: str, place: Place | None, frames: FrameNames) -> MessageBuilder | None:
    if place is None:
        return None
    return _alone(type, place, lambda block, rate: {path: block.values[:, 0]}, {"header.frame_id": frames.device})


def _alone(
    type: str, place: Place, columns: Callable[[RowBlock, float], Columns], texts: Mapping[str, str]
) -> MessageBuilder:
    """The builder of a quantity of one channel; rows with a value that is not a number are left out."""
    return MessageBuilder(type, RowJoin(place, {}), {place.channel}, columns, texts, keep=_finite)


def _finite(block: RowBlock) -> Mask:
    return np.asarray(np.isfinite(block.values).all(axis=1))


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

    return _alone(TIME, place, columns, {"header.frame_id": frames.device, "source": source})


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


def _transform(of: DeviceQuantities, frames: FrameNames, noise: SensorProperties) -> MessageBuilder | None:
    place = of.attitude_place
    if place is None:
        return None

    def columns(block: RowBlock, rate: float) -> Columns:
        q = _attitudes(of, frames, noise, block.values)
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


def _attitudes(of: DeviceQuantities, frames: FrameNames, noise: SensorProperties, values: Floats) -> Floats:
    assert of.attitude is not None
    attitudes = quaternions(of.attitude.kind, list(values.T))
    return enu_from_flu(attitudes, of.attitude.frame, noise.axes) if frames.rep103 else attitudes


def _body(vectors: Floats, frames: FrameNames, noise: SensorProperties) -> Floats:
    return body_vectors(vectors, noise.axes) if frames.rep103 else vectors


def _xyz(path: str, vectors: Floats) -> Columns:
    return {f"{path}.{axis}": vectors[:, at] for at, axis in enumerate("xyz")}


def _diagonal(x: float, y: float, z: float) -> Floats:
    """Covariance matrix, row by row, of independent standard deviations."""
    return np.array([x * x, 0, 0, 0, y * y, 0, 0, 0, z * z])


def _rows(block: RowBlock, rows: NDArray[np.intp]) -> RowBlock:
    if len(rows) == len(block.times):
        return block
    others = {name: values[rows] for name, values in block.others.items()}
    return RowBlock(block.times[rows], block.arrivals[rows], block.values[rows], others)
