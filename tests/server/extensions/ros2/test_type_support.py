"""Types of ROS 2 messages: hashes that ROS ships, serialization, foreign bytes."""

import subprocess
import sys

import numpy as np
import pytest

from imuscope.server.extensions.ros2 import type_support
from imuscope.server.extensions.ros2.type_support import TypeSupportError
from tests.server.extensions.ros2.samples import deserialize
from tests.support.each_row import each_row

# As `ros2 topic info --verbose` prints them in Jazzy.
HASHES = {
    "std_msgs/msg/String": "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    "sensor_msgs/msg/Imu": "7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    "sensor_msgs/msg/NavSatFix": "62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404",
    "sensor_msgs/msg/Temperature": "72514a14126ab9f8a9abec974c78e5610a367b59db5da355ff1fb982d5bad4b8",
    "nav_msgs/msg/Odometry": "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    "diagnostic_msgs/msg/DiagnosticArray": "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
}


@each_row("type_name", HASHES)
def test_hashes_are_those_of_ros(type_name: str) -> None:
    assert type_support.type_hash(type_name) == f"RIHS01_{HASHES[type_name]}"


def test_messages_survive() -> None:
    kind = "sensor_msgs/msg/Temperature"
    header = type_support.message_class("std_msgs/msg/Header")
    time = type_support.message_class("builtin_interfaces/msg/Time")
    message = type_support.message_class(kind)(
        header=header(stamp=time(sec=5, nanosec=6), frame_id="imu"), temperature=21.5, variance=0.25
    )
    data = type_support.serialize(message, kind)
    assert data[:4] == b"\0\1\0\0"
    assert data[4:12] == (5).to_bytes(4, "little") + (6).to_bytes(4, "little")
    assert np.frombuffer(data[-16:], "<f8").tolist() == [21.5, 0.25]
    assert deserialize(data, kind) == message
    assert "float64 variance" in type_support.definition(kind)


def test_unknown_types_are_an_error_of_ours() -> None:
    assert not type_support.is_known("vendor_msgs/msg/Imu")
    for call in (type_support.type_hash, type_support.message_class, type_support.definition):
        with pytest.raises(TypeSupportError, match="vendor_msgs"):
            call("vendor_msgs/msg/Imu")


def test_libraries_are_loaded_on_first_use() -> None:
    names = ", ".join(
        f"imuscope.server.extensions.ros2.{name}"
        for name in ("attachment", "key_expressions", "session", "type_support")
    )
    code = f"import sys, {names}; print(sorted({{'rosbags', 'zenoh', 'xxhash'}} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
