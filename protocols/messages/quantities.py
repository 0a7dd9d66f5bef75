"""Quantities of a message from its numbers: names, units, axes, frames.

    angular_velocity.x, .y, .z             ─> angular_velocity       vector x y z, rad/s, body
    orientation.x, .y, .z, .w              ─> orientation            quaternion w x y z, ENU from body
    latitude, longitude, altitude          ─> position               record, °, °, m
    orientation_covariance.0 … .8          ─> orientation_covariance
    status.status, status.service          ─> status                 record of both
    temperature                            ─> temperature            °C

The standard messages of ROS have units by definition, and frames: a body has x forward, y left, z up; the world x east,
y north, z up. A message whose type is unknown has neither units nor frames, but its quaternions are attitudes all the
same.

An estimate that a driver does not have is marked: by −1 as first element of its covariance, or an orientation of zeros.
Such a quantity is absent.

Source: ROS REP 103 (units, axes), REP 145 (sensor_msgs/Imu), definitions of sensor_msgs and geometry_msgs.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array
from imuscope.protocols.schema.fields import Field

REP_145 = "ROS REP 145"
UNITS: Mapping[str, Mapping[str, str]] = {
    "sensor_msgs/Imu": {"angular_velocity": "rad/s", "linear_acceleration": "m/s²"},
    "sensor_msgs/MagneticField": {"magnetic_field": "T"},
    "sensor_msgs/FluidPressure": {"fluid_pressure": "Pa"},
    "sensor_msgs/Temperature": {"temperature": "°C"},
    "sensor_msgs/RelativeHumidity": {},
    "sensor_msgs/Illuminance": {"illuminance": "lx"},
    "sensor_msgs/Range": {"range": "m", "min_range": "m", "max_range": "m", "field_of_view": "rad"},
    "sensor_msgs/NavSatFix": {"latitude": "°", "longitude": "°", "altitude": "m", "position_covariance": "m²"},
    "sensor_msgs/TimeReference": {"time_ref": "s"},
    "sensor_msgs/BatteryState": {"voltage": "V", "current": "A", "temperature": "°C", "charge": "Ah"},
    "geometry_msgs/Twist": {"linear": "m/s", "angular": "rad/s"},
    "geometry_msgs/TwistStamped": {"twist.linear": "m/s", "twist.angular": "rad/s"},
    "geometry_msgs/TwistWithCovarianceStamped": {"twist.twist.linear": "m/s", "twist.twist.angular": "rad/s"},
    "geometry_msgs/AccelStamped": {"accel.linear": "m/s²", "accel.angular": "rad/s²"},
    "geometry_msgs/PoseStamped": {"pose.position": "m"},
    "geometry_msgs/PoseWithCovarianceStamped": {"pose.pose.position": "m"},
    "geometry_msgs/PointStamped": {"point": "m"},
    "nav_msgs/Odometry": {
        "pose.pose.position": "m",
        "twist.twist.linear": "m/s",
        "twist.twist.angular": "rad/s",
    },
    "foxglove.LocationFix": {"latitude": "°", "longitude": "°", "altitude": "m", "position_covariance": "m²"},
    "foxglove.FrameTransform": {"translation": "m"},
    "foxglove.PoseInFrame": {"pose.position": "m"},
}
BODY_FRAME = ("sensor_msgs/Imu", "sensor_msgs/MagneticField")
WORLD = "ENU from body"
XYZ, XYZW = ("x", "y", "z"), ("x", "y", "z", "w")
_LAST = re.compile(r"^(?P<group>.+?)(?:\.(?P<member>[^.]+)|_(?P<axis>[xyzw])|(?<=[a-z])(?P<letter>[XYZ]))$")
_PLACE = {"latitude": "°", "longitude": "°", "altitude": "m"}
_DECIMALS = {"rad/s": 5, "m/s²": 3, "T": 8, "Pa": 1, "°C": 2}


@dataclass(frozen=True, slots=True)
class MessageQuantity:
    """One quantity of a message.

    Args:
        field: its description.
        paths: of its elements, in order; one of a single value.
    """

    field: Field
    paths: tuple[str, ...]

    def values(self, numbers: Mapping[str, Array], n: int) -> Array:
        """(n,) of a single value, (n,) records, or (n, elements); a missing number is NaN."""
        columns = [numbers[path] if path in numbers else np.full(n, np.nan) for path in self.paths]
        if self.field.fields:
            records = np.empty(n, [(one.name, "<f8") for one in self.field.fields])
            for one, column in zip(self.field.fields, columns, strict=True):
                records[one.name] = column
            return records
        return np.stack(columns, axis=1) if self.field.shape else columns[0]


def quantities_of(schema: str, paths: Sequence[str]) -> list[MessageQuantity]:
    """The quantities of a message, in the order of its numbers.

    Args:
        schema: name of its type; "" if unknown.
    """
    units = UNITS.get(short_name(schema), {})
    groups: dict[str, dict[str, str]] = {}
    for path in paths:
        match = _LAST.match(path)
        group = match["group"] if match is not None else path
        member = (match["member"] or match["axis"] or match["letter"].lower()) if match is not None else ""
        if path.rpartition(".")[2] in _PLACE:
            member = path.rpartition(".")[2]
            group = f"{path.rpartition('.')[0]}.position".lstrip(".")
        members = groups.setdefault(group, {})
        members[member if member not in members else path] = path
    return [_quantity(schema, name, members, units) for name, members in groups.items()]


def _quantity(schema: str, name: str, paths: Mapping[str, str], units: Mapping[str, str]) -> MessageQuantity:
    members = tuple(paths)
    if len(members) == 1:
        return _single(next(iter(paths.values())), units)
    if set(members) == set(XYZW):
        order = ("w", *XYZ)
        doc = "Rotation from the body's axes to the world's, scalar first."
        field = Field(name, "<f8", (4,), axes=order, decimals=4, frame=WORLD, doc=doc, source=REP_145)
        return MessageQuantity(field, tuple(paths[one] for one in order))
    unit = unit_of(units, name)
    if members == XYZ or all(one.isdecimal() for one in members):
        frame = "body" if short_name(schema) in BODY_FRAME and members == XYZ else ""
        decimals = _DECIMALS.get(unit, -1)
        shape = (len(members),)
        field = Field(name, "<f8", shape, unit=unit, axes=members, decimals=decimals, frame=frame)
        return MessageQuantity(field, tuple(paths.values()))
    inner = tuple(Field(one, "<f8", unit=unit_of(units, path) or _PLACE.get(one, "")) for one, path in paths.items())
    return MessageQuantity(Field(name, fields=inner), tuple(paths.values()))


def _single(path: str, units: Mapping[str, str]) -> MessageQuantity:
    unit = unit_of(units, path)
    field = Field(path, "<f8", unit=unit, decimals=_DECIMALS.get(unit, -1))
    return MessageQuantity(field, (path,))


def unit_of(units: Mapping[str, str], path: str) -> str:
    """The unit of a number, if the message type defines it."""
    return next((unit for name, unit in units.items() if path == name or path.startswith(f"{name}.")), "")


def absent_quantities(numbers: Mapping[str, Array], names: Collection[str]) -> set[str]:
    """Names of the quantities that the sender marks as unknown in all of these messages."""
    absent = set()
    for name in names:
        covariance = numbers.get(f"{name}_covariance.0")
        if covariance is not None and (covariance == -1).all():
            absent |= {name, f"{name}_covariance"}
        elements = [numbers.get(f"{name}.{one}") for one in XYZW]
        if all(one is not None and not one.any() for one in elements):
            absent |= {name, f"{name}_covariance"}
    return absent


def unknown_rows(numbers: Mapping[str, Array], name: str) -> NDArray[np.bool_] | None:
    """Rows in which the sender marks a quantity as unknown; None for none."""
    covariance = numbers.get(f"{name}_covariance.0")
    if covariance is None:
        return None
    unknown: NDArray[np.bool_] = covariance == -1
    return unknown if unknown.any() else None


def short_name(schema: str) -> str:
    """sensor_msgs/msg/Imu → sensor_msgs/Imu."""
    return schema.replace("/msg/", "/")
