"""Bags of ROS 1 and 2, in all their compressions, and damaged."""

import io
import sqlite3
import struct
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import StoragePlugin

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.readers.formats import ros2_bag as ros2_bag_reader
from imuscope.recordings.readers.formats.bag_source import BLOCK_BYTES
from imuscope.recordings.readers.formats.ros2_bag import Ros2Database
from tests.recordings.readers.formats.bags import (
    COUNT,
    LATE_NS,
    START_NS,
    imu,
    ros1_bag,
    ros2_bag,
    samples,
    split_bag,
    store_of,
)
from tests.recordings.readers.formats.opening import damage_of, opened, rows_of, survives_damage
from tests.recordings.tables.field_files import field_file
from tests.support.each_row import each_row

TIMES = START_NS / 1e9 + np.arange(COUNT) / 100


def check(store: ColumnStore, *, wheel: bool = True) -> None:
    """Values, times of measurement and arrivals, without damage."""
    rows = rows_of(store, "angular_velocity")
    rates = [value for _, value in samples()]
    np.testing.assert_allclose(rows.columns[0], np.degrees(rates), atol=1e-12)
    np.testing.assert_allclose(rows.time, TIMES, atol=1e-6)
    np.testing.assert_allclose(rows.arrival - rows.time, LATE_NS / 1e9, atol=1e-6)
    units = {one["name"]: one["unit"] for one in store.manifest["channels"]}
    assert (units["/imu/data.angular_velocity"], units["/imu/data.linear_acceleration"]) == ("°/s", "m/s²")
    if wheel:
        np.testing.assert_allclose(rows_of(store, "wheel_speed").columns[0], 2 * np.array(rates), atol=1e-12)
        assert not store.manifest["damage"]


@each_row("name", ["c25_rosbag2.db3", "c27_ros1.bag"])
def test_real_cases_open(name: str, tmp_path: Path) -> None:
    store = opened(field_file(name), tmp_path)
    rows = rows_of(store, "angular_velocity")
    np.testing.assert_allclose(np.diff(rows.time), 0.01, atol=1e-6)
    assert (len(rows.time), rows.time[-1] - rows.time[0]) == (400, pytest.approx(3.99, abs=1e-6))
    assert store.manifest["time"] or "stamp" in str(store.manifest["events"])


@each_row("compression", ["", "BZ2", "LZ4"])
def test_a_ros_1_bag_has_its_numbers(compression: str, tmp_path: Path) -> None:
    check(opened(ros1_bag(tmp_path / "a.bag", compression), tmp_path))


@each_row(
    ("compression", "storage", "version"),
    [
        ("", StoragePlugin.SQLITE3, 9),
        ("FILE", StoragePlugin.SQLITE3, 9),
        ("MESSAGE", StoragePlugin.SQLITE3, 9),
        ("", StoragePlugin.MCAP, 9),
        ("FILE", StoragePlugin.MCAP, 9),
    ],
)
def test_a_ros_2_bag_is_a_folder(compression: str, storage: StoragePlugin, version: int, tmp_path: Path) -> None:
    check(opened(ros2_bag(tmp_path / "a", compression=compression, storage=storage, version=version), tmp_path))


@each_row("compression", ["", "FILE"])
def test_a_split_bag_is_one_recording(compression: str, tmp_path: Path) -> None:
    folder = split_bag(tmp_path / "a", compression)
    check(opened(folder, tmp_path))
    first = min(path for path in folder.iterdir() if path.name != "metadata.yaml")
    first.unlink()
    store = opened(folder, tmp_path / "rest")
    assert len(rows_of(store, "angular_velocity").time) == COUNT - 150
    assert f"{first.name} of the bag is missing." in damage_of(store)


def test_an_old_bag_without_definitions_has_the_common_types(tmp_path: Path) -> None:
    folder = ros2_bag(tmp_path / "a", version=8)
    [path] = folder.glob("*.db3")
    with closing(sqlite3.connect(path)) as database:
        database.execute("DROP TABLE IF EXISTS message_definitions")
    store = opened(path, tmp_path)
    check(store, wheel=False)
    assert "/wheel is left out: the bag does not define its type, own_msgs/msg/Wheel." in damage_of(store)


def test_large_messages_of_a_database_are_read_one_by_one(tmp_path: Path) -> None:
    """Those of a camera beside an inertial sensor: hundreds at once would fill the memory."""
    folder = ros2_bag(tmp_path / "a")
    [path] = folder.glob("*.db3")
    with closing(sqlite3.connect(path)) as database:
        [(wheel,)] = database.execute("SELECT id FROM topics WHERE name = '/wheel'")
        [(time, large)] = database.execute("SELECT timestamp, data FROM messages WHERE topic_id = ? LIMIT 1", (wheel,))
        large = large + bytes(BLOCK_BYTES // 2)
        odd = ["large", 7, 1.5]
        rows = [(wheel, time, data) for data in ([large] * 20 + odd)] + [(9, time, large)]
        database.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
        database.commit()
    pieces = list(Ros2Database(path).pieces(None, None))
    assert max(len(one.data) for one in pieces) < 2 * BLOCK_BYTES
    assert sum(one.data.count(large) for one in pieces) == 20
    store = opened(path, tmp_path)
    assert len(rows_of(store, "angular_velocity").time) == COUNT
    assert f"Messages that cannot be unpacked are left out: {len(odd)}." in damage_of(store)


def test_a_topic_whose_number_is_damaged_is_left_out(tmp_path: Path) -> None:
    """One that cannot be sorted among the others ended in a traceback."""
    [path] = ros2_bag(tmp_path / "a").glob("*.db3")
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE damaged AS SELECT * FROM topics")
        database.execute("DROP TABLE topics")
        database.execute("ALTER TABLE damaged RENAME TO topics")
        database.execute("UPDATE topics SET id = NULL WHERE name = '/wheel'")
        database.commit()
    store = opened(path, tmp_path)
    assert len(rows_of(store, "angular_velocity").time) == COUNT
    assert "/wheel is left out: its row in the table of topics is damaged." in damage_of(store)


def test_a_bag_whose_index_is_missing_or_damaged_opens_with_the_rest(tmp_path: Path) -> None:
    path = ros1_bag(tmp_path / "a.bag")
    data = path.read_bytes()
    cut = tmp_path / "cut.bag"
    cut.write_bytes(data[: len(data) * 2 // 3])
    rows = rows_of(opened(cut, tmp_path / "1"), "linear_acceleration")
    assert set(rows.columns[2].tolist()) <= {9.81}
    assert 200 < len(rows.time) < COUNT
    at = data.index(b"op=\x05", len(data) // 2) - 30
    cut.write_bytes(data[:at] + b"\xff" * 70 + data[at + 70 :])
    store = opened(cut, tmp_path / "2")
    assert 200 < len(rows_of(store, "linear_acceleration").time) < COUNT
    assert store.manifest["damage"]


def test_ros_1_messages_in_mcap_are_read(tmp_path: Path) -> None:
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    text = store.generate_msgdef("sensor_msgs/msg/Imu", ros_version=1)[0]
    out = io.BytesIO()
    writer = McapWriter(out)
    writer.start()
    schema = writer.register_schema("sensor_msgs/Imu", "ros1msg", text.encode())
    channel = writer.register_channel("/imu/data", "ros1", schema)
    for stamp, value in samples():
        data = bytes(store.serialize_ros1(imu(store_of(1), 1, stamp, value), "sensor_msgs/msg/Imu"))
        writer.add_message(channel, stamp + LATE_NS, data, stamp + LATE_NS)
    writer.finish()
    (tmp_path / "a.mcap").write_bytes(out.getvalue())
    check(opened(tmp_path / "a.mcap", tmp_path), wheel=False)


def test_a_database_that_is_no_bag_is_named(tmp_path: Path) -> None:
    with closing(sqlite3.connect(tmp_path / "a.db3")) as database:
        database.execute("CREATE TABLE people (name TEXT)")
    with pytest.raises(RecordingError, match="SQLite database, but not a ROS 2 bag: it has people"):
        open_file(tmp_path / "a.db3")


def test_a_chunk_that_claims_gigabytes_is_refused(tmp_path: Path) -> None:
    path = ros1_bag(tmp_path / "a.bag", "LZ4")
    data = path.read_bytes()
    at = data.index(b"size=") + 5
    path.write_bytes(data[:at] + struct.pack("<I", 0xFFFFFFFF) + data[at + 4 :])
    assert len(rows_of(opened(path, tmp_path), "angular_velocity").time) == COUNT


def test_a_damaged_ros_1_bag_does_no_harm(tmp_path: Path) -> None:
    opened_refused = np.zeros(2)
    for compression in ("", "LZ4", "BZ2"):
        (folder := tmp_path / f"bag{compression}").mkdir()
        opened_refused += survives_damage(ros1_bag(folder / "a.bag", compression), folder)
    assert all(opened_refused)


@each_row("compression", ["", "MESSAGE"])
def test_a_damaged_ros_2_bag_does_no_harm(compression: str, tmp_path: Path) -> None:
    [path] = ros2_bag(tmp_path / "a", compression=compression).glob("*.db3")
    opens, _ = survives_damage(path, tmp_path)
    assert opens


def test_a_folder_that_is_no_bag_names_what_a_bag_has(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="is a folder") as refused:
        open_file(tmp_path)
    assert "metadata.yaml" in refused.value.hint
    for text in (
        "",
        "a: [",
        "rosbag2_bagfile_information: 3",
        "rosbag2_bagfile_information: {relative_file_paths: []}",
    ):
        (tmp_path / "metadata.yaml").write_text(text)
        with pytest.raises(RecordingError):
            open_file(tmp_path)


def test_a_row_that_claims_too_much_costs_the_rest_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SQLite has no memory for the length of a damaged row: the whole recording was refused. Found by fuzzing."""
    [path] = ros2_bag(tmp_path / "bag").glob("*.db3")
    monkeypatch.setattr(ros2_bag_reader, "ROWS_PER_STEP", 100)
    connected = ros2_bag_reader._connected

    class Cursor:
        def __init__(self, cursor: sqlite3.Cursor) -> None:
            self._cursor, self._turns = cursor, 0
            self.fetchone = cursor.fetchone

        def fetchmany(self, rows: int) -> list[tuple[object, ...]]:
            self._turns += 1
            if self._turns > 2:
                raise MemoryError
            return self._cursor.fetchmany(rows)

    class Database:
        def __init__(self, path: Path) -> None:
            self._database = connected(path)
            self.close = self._database.close

        def execute(self, *words: Any) -> Cursor:
            return Cursor(self._database.execute(*words))

    source = open_file(path)
    monkeypatch.setattr(ros2_bag_reader, "_connected", Database)
    assert sum(len(part.ends) for part in source.parts()) == 200
    assert "takes too much memory" in source.damage[0].words
