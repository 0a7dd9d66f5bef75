"""Bags of ROS 1 and 2 with the same samples, written by rosbags."""

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

COUNT, STEP_NS, START_NS = 400, 10_000_000, 1_500_000_000_000_000_000
LATE_NS = 2_000_000  # of the arrival, after the stamp
CUSTOM = "float64 wheel_speed\nstring name\n"


def store_of(version: int) -> Any:
    """Types of ROS, with one of a package that nobody else has."""
    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(CUSTOM, "own_msgs/msg/Wheel"))
    return store


def imu(store: Any, version: int, stamp_ns: int, value: float) -> Any:
    """A message with the gyroscope's x."""
    types = store.types
    time = types["builtin_interfaces/msg/Time"](stamp_ns // 10**9, stamp_ns % 10**9)
    header = types["std_msgs/msg/Header"]
    vector, zeros = types["geometry_msgs/msg/Vector3"], np.zeros(9)
    return types["sensor_msgs/msg/Imu"](
        header=header(7, time, "imu_link") if version == 1 else header(time, "imu_link"),
        orientation=types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        orientation_covariance=np.array([-1.0, *zeros[1:]]),
        angular_velocity=vector(value, 0.0, 0.0),
        angular_velocity_covariance=zeros,
        linear_acceleration=vector(0.01, 0.02, 9.81),
        linear_acceleration_covariance=zeros,
    )


def samples() -> list[tuple[int, float]]:
    """(stamp ns, gyroscope's x) of all messages."""
    return [(START_NS + n * STEP_NS, float(np.sin(4 * np.pi * n / 100))) for n in range(COUNT)]


def ros1_bag(path: Path, compression: str = "") -> Path:
    """A bag of ROS 1; compression "BZ2" or "LZ4"."""
    store = store_of(1)
    writer = Writer1(path)
    writer.chunk_threshold = 1 << 14  # some chunks
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression])
    with writer:
        imus = writer.add_connection("/imu/data", "sensor_msgs/msg/Imu", typestore=store)
        wheels = writer.add_connection("/wheel", "own_msgs/msg/Wheel", typestore=store)
        wheel = store.types["own_msgs/msg/Wheel"]
        for stamp, value in samples():
            data = store.serialize_ros1(imu(store, 1, stamp, value), imus.msgtype)
            writer.write(imus, stamp + LATE_NS, data)
            data = store.serialize_ros1(wheel(2 * value, "left"), wheels.msgtype)
            writer.write(wheels, stamp + LATE_NS, data)
    return path


def ros2_bag(
    folder: Path,
    *,
    compression: str = "",
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    version: int = 9,
    rows: slice = slice(None),
) -> Path:
    """A bag of ROS 2; compression "FILE" or "MESSAGE"."""
    store = store_of(2)
    writer = Writer2(folder, version=version, storage_plugin=storage)
    if compression:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with writer:
        imus = writer.add_connection("/imu/data", "sensor_msgs/msg/Imu", typestore=store)
        wheels = writer.add_connection("/wheel", "own_msgs/msg/Wheel", typestore=store)
        wheel = store.types["own_msgs/msg/Wheel"]
        for stamp, value in samples()[rows]:
            writer.write(imus, stamp + LATE_NS, store.serialize_cdr(imu(store, 2, stamp, value), imus.msgtype))
            writer.write(wheels, stamp + LATE_NS, store.serialize_cdr(wheel(2 * value, "left"), wheels.msgtype))
    return folder


def split_bag(folder: Path, compression: str = "") -> Path:
    """A bag of ROS 2 in two files: two bags whose files are one folder."""
    import yaml

    folder.mkdir()
    names, head = [], {}
    for number, rows in enumerate((slice(0, 150), slice(150, None))):
        one = ros2_bag(folder.parent / f"{folder.name}-{number}", compression=compression, rows=rows)
        [file] = [path for path in one.iterdir() if path.name != "metadata.yaml"]
        head = yaml.safe_load((one / "metadata.yaml").read_text())
        names.append(f"{folder.name}_{number}{''.join(file.suffixes)}")
        file.rename(folder / names[-1])
    head["rosbag2_bagfile_information"]["relative_file_paths"] = names
    (folder / "metadata.yaml").write_text(yaml.safe_dump(head))
    return folder
