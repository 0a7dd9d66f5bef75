"""MCAP files written by other libraries: ROS 2 bags, protobuf; malformed ones do no harm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer as RosWriter

from imuscope.protocols.events import Batch
from imuscope.protocols.messages.decoder import MessageDecoder, reader_of
from imuscope.protocols.messages.records import MessageChannel
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.readers.message_source import MessageSource
from tests.recordings.mcap_files import OF_ROS
from tests.recordings.store_fixtures import START
from tests.support.each_row import each_row

NS = round(START * 1e9)
IMU = f"""std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
geometry_msgs/Vector3 linear_acceleration
uint8[] raw
{OF_ROS}================================================================================
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
"""


def bag(path: Path) -> Path:
    with path.open("wb") as file:
        writer = RosWriter(file)
        schema = writer.register_msgdef("sensor_msgs/msg/Imu", IMU)
        for n in range(50):
            stamp = NS + n * 10_000_000 - 3_000_000
            message = {
                "header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "imu" * (n % 3)},
                "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                "orientation_covariance": [float(k) for k in range(9)],
                "angular_velocity": {"x": 0.1 * n, "y": -1.0, "z": 2.0},
                "linear_acceleration": {"x": 0.0, "y": 0.0, "z": 9.81},
                "raw": [1, 2, 3],
            }
            writer.write_message("/imu", schema, message, log_time=NS + n * 10_000_000)
        writer.finish()
    return path


def batch_of(path: Path) -> list[Batch]:
    """The messages of a file, in one batch for each layout."""
    source = open_file(path)
    assert isinstance(source, MessageSource)
    decoder = MessageDecoder()
    for part in source.parts():
        decoder.feed_chunks(part.data, part.ends, part.times)
    events = decoder.drain(stalled=True)
    assert all(isinstance(event, Batch) for event in events), events
    return [event for event in events if isinstance(event, Batch)]


def column(batches: list[Batch], name: str) -> np.ndarray:
    """A quantity of all batches, in the order of the file."""
    order = np.argsort(np.concatenate([batch.offset for batch in batches]), kind="stable")
    return np.concatenate([batch.columns[name] for batch in batches])[order]


def test_a_ros_2_bag_has_its_numbers_with_their_units_at_the_time_they_were_measured(tmp_path: Path) -> None:
    batches = batch_of(bag(tmp_path / "bag.mcap"))
    assert {batch.message.name for batch in batches} == {"/imu"}
    fields = {field.name: field for field in batches[0].message.fields}
    np.testing.assert_allclose(column(batches, "angular_velocity")[:, 0], 0.1 * np.arange(50))
    assert fields["angular_velocity"].unit == "rad/s"
    assert fields["linear_acceleration"].unit == "m/s²"
    assert column(batches, "linear_acceleration")[0].tolist() == [0.0, 0.0, 9.81]
    assert column(batches, "orientation_covariance")[0, 8] == 8.0
    assert column(batches, "raw")[0].tolist() == [1, 2, 3]
    assert (fields["orientation"].axes, fields["orientation"].frame) == (("w", "x", "y", "z"), "ENU from body")
    assert column(batches, "orientation")[0].tolist() == [1.0, 0.0, 0.0, 0.0]
    assert not [name for name in fields if "stamp" in name]
    for batch in batches:
        assert batch.time_ns is not None
        assert (batch.arrival_ns - batch.time_ns == 3_000_000).all()


def described() -> tuple[bytes, type]:
    """A schema as foxglove's programs write it, and the class that it describes."""
    file = descriptor_pb2.FileDescriptorProto(name="own.proto", package="own", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    inner = file.message_type.add(name="Vector")
    outer = file.message_type.add(name="Motion")
    double, bytes_, message = (descriptor_pb2.FieldDescriptorProto.Type.Value(f"TYPE_{one}") for one in KINDS)
    one, many = 1, 3
    for n, name in enumerate("xyz", start=1):
        inner.field.add(name=name, number=n, type=double, label=one)
    outer.field.add(name="timestamp", number=1, type=message, type_name=".google.protobuf.Timestamp", label=one)
    outer.field.add(name="turn", number=2, type=message, type_name=".own.Vector", label=one)
    outer.field.add(name="noise", number=3, type=double, label=many)
    outer.field.add(name="picture", number=4, type=bytes_, label=one)
    stamp = descriptor_pb2.FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(stamp)
    files = descriptor_pb2.FileDescriptorSet(file=[file, stamp])  # the required part is last, as some writers do
    pool = descriptor_pool.DescriptorPool()
    pool.Add(stamp)
    pool.Add(file)
    return files.SerializeToString(), message_factory.GetMessageClass(pool.FindMessageTypeByName("own.Motion"))


KINDS = ("DOUBLE", "BYTES", "MESSAGE")


def test_protobuf_that_describes_itself_is_read_zeros_too(tmp_path: Path) -> None:
    schema, motion = described()
    path = tmp_path / "motion.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        number = writer.register_schema("own.Motion", "protobuf", schema)
        channel = writer.register_channel("/motion", "protobuf", number)
        for n in range(20):
            report = motion(turn={"x": float(n)}, noise=[1.0, 2.0], picture=b"abc")
            report.timestamp.FromNanoseconds(NS + n * 10**7 - 10**6)
            writer.add_message(channel, NS + n * 10**7, report.SerializeToString(), 0)
        writer.finish()
    (batch,) = batch_of(path)
    assert batch.columns.keys() == {"turn", "noise"}
    assert batch.columns["turn"][:, 0].tolist() == list(range(20))
    assert batch.columns["turn"][:, 1].tolist() == [0.0] * 20  # unset: it is zero, and included
    assert batch.columns["noise"].shape == (20, 2)
    assert batch.time_ns is not None
    assert (batch.arrival_ns - batch.time_ns == 1_000_000).all()


@each_row("encoding", [("cdr", "ros2msg"), ("protobuf", "protobuf")])
@given(schema=st.binary(max_size=200), message=st.binary(max_size=60))
def test_malformed_schemas_and_messages_give_no_numbers(
    encoding: tuple[str, str], schema: bytes, message: bytes
) -> None:
    read = reader_of(MessageChannel(1, "/odd", encoding[0], "a/msg/B", encoding[1], schema))
    if read is not None:
        read([message])


@given(message=st.binary(max_size=120))
def test_malformed_messages_of_a_known_kind_are_harmless(message: bytes) -> None:
    read = reader_of(MessageChannel(1, "/imu", "cdr", "sensor_msgs/msg/Imu", "ros2msg", IMU.encode()))
    assert read is not None
    result, refused = read([b"\x00\x01\x00\x00" + message])
    assert (result, len(refused)) == ([], 1)  # shorter than the shortest of its kind


def test_an_array_of_empty_elements_takes_no_time() -> None:
    """Its elements take no bytes: it can claim any number of them."""
    text = b"a/Empty[] many\nuint8 last\n====\nMSG: a/Empty\n# nothing\n"
    read = reader_of(MessageChannel(1, "/odd", "cdr", "a/msg/B", "ros2msg", text))
    assert read is not None
    results, refused = read([bytes([0, 1, 0, 0]) + b"\xff" * 4 + b"\x07"])
    assert not refused
    assert results[0].columns["last"].tolist() == [7]


def test_unreadable_messages_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "theirs.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("a/B", "flatbuffer", b"float64 x")
        writer.add_message(writer.register_channel("/old", "flatbuffer", schema), 1, bytes(8), 1)
        writer.finish()
    with pytest.raises(RecordingError, match="flatbuffer"):
        open_file(path)
