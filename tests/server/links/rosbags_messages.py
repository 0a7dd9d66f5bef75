"""Messages of ROS 2 made by rosbags, an implementation that shares no code with ours."""

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
TOPICS = {"/imu/data": "sensor_msgs/msg/Imu", "/fix": "sensor_msgs/msg/NavSatFix"}
IMU, FIX, FIELD = "sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix", "sensor_msgs/msg/MagneticField"


def cdr(name: str, message: Any) -> bytes:
    return bytes(STORE.serialize_cdr(message, name))


def definition(name: str) -> bytes:
    """The text of a type's definition, with those that it contains."""
    return str(STORE.generate_msgdef(name, ros_version=2)[0]).encode()


def header(stamp_ns: int, frame: str = "imu_link") -> Any:
    time = STORE.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return STORE.types["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def vector(x: float, y: float, z: float) -> Any:
    return STORE.types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)


def imu(n: int, stamp_ns: int, *, orientation: bool = True) -> bytes:
    """Message n of a sensor that turns about z."""
    half = 0.005 * n
    q = (0.0, 0.0, float(np.sin(half)), float(np.cos(half))) if orientation else (0.0, 0.0, 0.0, 0.0)
    turn = STORE.types["geometry_msgs/msg/Quaternion"](x=q[0], y=q[1], z=q[2], w=q[3])
    known, unknown = np.eye(3).ravel() * 0.01, np.array([-1.0, *[0.0] * 8])
    message = STORE.types[IMU](
        header=header(stamp_ns),
        orientation=turn,
        orientation_covariance=known if orientation else unknown,
        angular_velocity=vector(0.001 * n, -1.0, 2.0),
        angular_velocity_covariance=known,
        linear_acceleration=vector(0.25 * n, 0.5, 9.81),
        linear_acceleration_covariance=known,
    )
    return cdr(IMU, message)


def fix(n: int, stamp_ns: int) -> bytes:
    """A position that moves north."""
    status = STORE.types["sensor_msgs/msg/NavSatStatus"](status=2, service=1)
    message = STORE.types[FIX](
        header=header(stamp_ns, "gnss"),
        status=status,
        latitude=48.0 + 1e-5 * n,
        longitude=11.5,
        altitude=520.0,
        position_covariance=np.eye(3).ravel(),
        position_covariance_type=2,
    )
    return cdr(FIX, message)


def field(stamp_ns: int) -> bytes:
    """A magnetic field, in tesla."""
    message = STORE.types[FIELD](
        header=header(stamp_ns), magnetic_field=vector(2e-5, 0.0, -4.3e-5), magnetic_field_covariance=np.zeros(9)
    )
    return cdr(FIELD, message)


def bag(folder: Path, count: int = 100, start_ns: int = 1_760_000_000 * 10**9) -> Path:
    """A bag of Imu and NavSatFix messages at 100 Hz, written by rosbags; the path of its MCAP file."""
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {topic: writer.add_connection(topic, name, typestore=STORE) for topic, name in TOPICS.items()}
        for n in range(count):
            at = start_ns + n * 10_000_000
            writer.write(connections["/imu/data"], at, imu(n, at - 3_000_000))
            writer.write(connections["/fix"], at, fix(n, at - 3_000_000))
    (path,) = folder.glob("*.mcap")
    return path
