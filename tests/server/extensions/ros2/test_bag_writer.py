"""Exported ROS 2 bags, as rosbags reads them: topics, values, stamps, arrivals, covariances, and what is left out."""

import io
import json
import sqlite3
import zipfile
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

import imuscope
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.messages.records import MessageChannel, definition, message_record
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.exporters import FORMATS, ExportError, ExportRequest, export
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.server.extensions.ros2.axes import FLIP
from imuscope.server.library.export_worker import one_file
from imuscope.server.settings.config import Config
from tests.recordings.readers.formats.bags import LATE_NS, ros1_bag, ros2_bag, samples, store_of
from tests.recordings.recorded_drive import START, drive
from tests.recordings.store_fixtures import store
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.waiting import block_until

BAGS = [name for name in FORMATS if name.startswith("rosbag2-")]


@pytest.fixture(scope="module")
def mti(tmp_path_factory: pytest.TempPathFactory) -> imuscope.Recording:
    """A recording of an MTi."""
    path = tmp_path_factory.mktemp("mti") / "drive.mcap"
    drive(path)
    return imuscope.open(path)


@pytest.fixture(scope="module")
def imx(tmp_path_factory: pytest.TempPathFactory) -> imuscope.Recording:
    """A recording of an IMX-5, whose body has y right and z down, and which sends its own clock."""
    path = tmp_path_factory.mktemp("imx") / "drive.mcap"
    writer, device = McapWriter(path, {"title": "A drive"}), IsbSimulator()
    writer.device("1", {"source": "/dev/ttyUSB0", "link": "serial", "baud": 921600, "protocol": "isb"})
    for time_ns in range(10_000_000, 2_000_000_000, 10_000_000):
        writer.chunk("1", "rx", device.advance(time_ns), START + time_ns)
    writer.close()
    return imuscope.open(path)


def messages(bag: Path) -> dict[str, list[tuple[int, Any]]]:
    """Topic → (time of the bag, message)."""
    results: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([bag]) as reader:
        for connection, time, data in reader.messages():
            results.setdefault(connection.topic, []).append((time, reader.deserialize(data, connection.msgtype)))
    return results


def stamp(time: Any) -> int:
    return int(time.sec) * 10**9 + int(time.nanosec)


def vectors(some: list[tuple[int, Any]], name: str) -> np.ndarray[Any, Any]:
    return np.array([[getattr(getattr(one, name), axis) for axis in "xyz"] for _, one in some])


@each_row("suffix", [FORMATS[name].suffix for name in BAGS])
def test_rosbags_reads_every_sample(mti: imuscope.Recording, suffix: str, tmp_path: Path) -> None:
    [bag] = mti.export(tmp_path / f"drive{suffix}")
    results = messages(bag)
    turn, acceleration, attitude = (mti[name] for name in ("RateOfTurn", "Acceleration", "Quaternion"))
    imus = results["/mti_630/imu/data"]
    assert [stamp(one.header.stamp) for _, one in imus] == attitude.time_ns.tolist()
    assert [time for time, _ in imus] == attitude.arrival_ns.tolist()
    np.testing.assert_array_equal(vectors(imus, "angular_velocity"), turn.in_units("device").values)
    np.testing.assert_array_equal(vectors(imus, "linear_acceleration"), acceleration.values)
    np.testing.assert_allclose([one.orientation.w for _, one in imus], attitude.column("w"), atol=1e-6)
    raw = results["/mti_630/imu/data_raw"]
    assert {one.orientation_covariance[0] for _, one in raw} == {-1.0}
    assert {one.header.frame_id for _, one in raw} == {"mti_630"}
    assert all(one.angular_velocity_covariance[0] > 0 for _, one in imus)  # of the data sheet
    pressure = [one.fluid_pressure for _, one in results["/mti_630/pressure"]]
    np.testing.assert_array_equal(pressure, mti["BaroPressure"].values)
    assert "/tf" not in results
    about = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    left_out = about["custom_data"]["imuscope.left_out"]
    assert "MTData2/StatusWord" in left_out
    assert "MTData2/MagneticField" in left_out  # in arbitrary units
    assert "RateOfTurn" not in left_out


def test_samples_that_lack_a_number_are_left_out_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    cells = [f"{1.7e9 + n / 100:.2f},0.1,{'' if n in (3, 7) else 0.2},0.3" for n in range(20)]
    path.write_text("\n".join(["time (s),gyr_x (rad/s),gyr_y (rad/s),gyr_z (rad/s)", *cells]))
    with imuscope.open(path) as source:
        [bag] = source.export(tmp_path / f"walk{FORMATS[BAGS[0]].suffix}")
    [(topic, some)] = messages(bag).items()
    assert len(some) == 18
    about = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert json.loads(about["custom_data"]["imuscope.rows_left_out"]) == {topic: 2}


def test_a_bag_is_opened_again(mti: imuscope.Recording, tmp_path: Path) -> None:
    [bag] = mti.export(tmp_path / "drive.db3.rosbag2")
    assert [path.suffix for path in sorted(bag.iterdir())] == [".db3", ".yaml"]
    with closing(sqlite3.connect(next(bag.glob("*.db3")))) as database:
        assert database.execute("SELECT count(*) FROM messages").fetchone()[0] > 2 * len(mti["RateOfTurn"])
    packed = one_file([bag], tmp_path, "packed")
    with imuscope.open(packed) as again:
        turn = again["/mti_630/imu/data_raw.angular_velocity"]
        np.testing.assert_array_equal(turn.time, mti["RateOfTurn"].time)
        np.testing.assert_array_equal(turn.arrival, mti["RateOfTurn"].arrival)
        np.testing.assert_array_equal(turn.in_units("device").values, mti["RateOfTurn"].in_units("device").values)
        assert (turn.units, turn.frame) == (("°/s",) * 3, "body")


def test_a_bag_is_downloaded_as_a_zip(tmp_path: Path) -> None:
    (tmp_path / "recordings").mkdir()
    drive(tmp_path / "recordings" / "a.mcap", seconds=1.0)
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), FakeLink) as running:
        client = running.client
        job = client.post("/api/recordings/a/exports", json={"format": "rosbag2-mcap"}).json()["id"]

        def done() -> dict[str, Any] | None:
            [one] = client.get("/api/recordings/exports").json()
            return one if one["state"] not in ("waiting", "running") else None

        state = block_until(done, "the export is finished")
        assert state["file"] == "A-drive-rosbag2-mcap.zip", (state["message"], state["hint"])
        data = client.get(f"/api/recordings/exports/{job}/file").content
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.namelist() == ["A-drive.rosbag2/A-drive.rosbag2.mcap", "A-drive.rosbag2/metadata.yaml"]
        archive.extractall(tmp_path)
    assert "/mti_630/imu/data" in messages(tmp_path / "A-drive.rosbag2")


def test_axes_are_those_of_ros_and_clocks_are_references_of_time(imx: imuscope.Recording, tmp_path: Path) -> None:
    [bag] = imx.export(tmp_path / "drive.rosbag2")
    result = messages(bag)
    raw = result["/imx_5/imu/data_raw"]
    acceleration = imx["DID_IMU.I.acc"]
    np.testing.assert_array_equal(vectors(raw, "linear_acceleration"), acceleration.values * FLIP)
    clocks = result["/imx_5/clock/did_imu"]
    assert len(clocks) == len(acceleration)
    assert {one.source for _, one in clocks} == {"DID_IMU.time"}
    apart = np.array([stamp(one.header.stamp) - stamp(one.time_ref) for _, one in clocks])
    assert np.ptp(apart) < 50_000_000  # both run alike
    np.testing.assert_array_equal(np.diff([time for time, _ in clocks]) >= 0, True)


def test_a_bag_without_messages_is_an_error(tmp_path: Path) -> None:
    columns: ColumnStore = store(tmp_path / "store")
    with pytest.raises(ExportError, match="No message of ROS holds"):
        export("rosbag2-mcap", ExportRequest(columns, channels=(2,)), tmp_path / "run.rosbag2")
    [bag] = export("rosbag2-mcap", ExportRequest(columns, channels=(1,)), tmp_path / "run.rosbag2")
    with pytest.raises(ExportError, match="is a folder that exists"):
        export("rosbag2-mcap", ExportRequest(columns, channels=(1,)), bag)


@each_row("export_format", BAGS)
def test_a_cancelled_bag_leaves_nothing(export_format: str, tmp_path: Path) -> None:
    columns = store(tmp_path / "store")
    (tmp_path / "out").mkdir()

    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(export_format, ExportRequest(columns), tmp_path / "out" / "run.rosbag2", stop)
    assert list((tmp_path / "out").iterdir()) == []


@each_row("version", [1, 2])
def test_messages_of_a_bag_are_the_same_in_a_bag_made_of_it(version: int, tmp_path: Path) -> None:
    """Stamps were off by up to 118 ns, covariances zero, and the frame that of the device."""
    made = ros1_bag(tmp_path / "a.bag") if version == 1 else ros2_bag(tmp_path / "a")
    with imuscope.open(made) as source:
        [bag] = source.export(tmp_path / f"b{FORMATS[BAGS[0]].suffix}")
    store = store_of(2)
    with Reader(bag) as reader:
        kinds = {one.topic: one.msgtype for one in reader.connections}
        rows = [(one.topic, time, store.deserialize_cdr(data, one.msgtype)) for one, time, data in reader.messages()]
    assert kinds == {"/imu/data": "sensor_msgs/msg/Imu", "/wheel": "own_msgs/msg/Wheel"}
    imus = [(time, message) for topic, time, message in rows if topic == "/imu/data"]
    assert [(stamp(one.header.stamp), one.angular_velocity.x) for _, one in imus] == samples()
    assert [time for time, _ in imus] == [at + LATE_NS for at, _ in samples()]
    assert {one.header.frame_id for _, one in imus} == {"imu_link"}
    assert {one.orientation_covariance[0] for _, one in imus} == {-1.0}
    assert {message.name for topic, _, message in rows if topic == "/wheel"} == {"left"}


def test_a_range_of_a_bag_has_its_messages_alone(tmp_path: Path) -> None:
    with imuscope.open(ros2_bag(tmp_path / "a")) as source:
        [bag] = source.export(
            tmp_path / f"b{FORMATS[BAGS[0]].suffix}", signals="angular_velocity", begin_s=1.0, end_s=2.0
        )
    with Reader(bag) as reader:
        assert {one.topic for one in reader.connections} == {"/imu/data"}
        assert 100 <= reader.message_count <= 101


def test_topics_of_a_live_source_are_copied_where_their_definition_can_be_read(tmp_path: Path) -> None:
    """The export ended with an error of the library."""
    path, text = tmp_path / "a.mcap", b"\x00\x01\x00\x00\x03\x00\x00\x00on\x00"
    topics = [("/good", "own/msg/Good", "float64 value"), ("/bad", "own/msg/Bad", "nope/msg/Thing x")]
    topics.append(("/words", "std_msgs/msg/String", "string data"))
    channels = [
        MessageChannel(number, topic, "cdr", kind, "ros2msg", own.encode())
        for number, (topic, kind, own) in enumerate(topics, start=1)
    ]
    writer = McapWriter(path, {})
    writer.device("1", {"source": "ros2:", "link": "ros2", "protocol": "messages"})
    for channel in channels:
        writer.messages("1", [(definition(channel), START)])
    for n in range(50):
        for channel in channels:
            data = text if channel.topic == "/words" else text[:4] + bytes(8)
            writer.messages("1", [(message_record(channel.id, data), START + n * 10_000_000)])
    writer.close()
    with imuscope.open(path) as source:
        [bag] = source.export(tmp_path / f"b{FORMATS[BAGS[0]].suffix}")
    with Reader(bag) as reader:
        assert {one.topic: one.msgcount for one in reader.connections} == {"/good": 50, "/words": 50}
