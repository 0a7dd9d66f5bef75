"""Real cases of the field: each file of ../shared/field that is a table is read right, or refused with the remedy."""

from pathlib import Path

import numpy as np
import pytest

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.tables.options import TableOptions
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode
from tests.recordings.tables.field_files import field_file
from tests.support.each_row import each_row

RATE = 100.0
EPOCH_2017 = 1_500_000_000.0
TABLES = [  # file, start (None: not in the file), channel of the gyroscope and its columns
    ("c01_mt_manager_export.txt", None, "Gyr", ["x", "y", "z"]),
    ("c02_euroc_imu0.csv", EPOCH_2017, "w_RS_S", ["x", "y", "z"]),
    ("c03_px4_ulog2csv_sensor_combined.csv", None, "gyro_rad", ["0", "1", "2"]),
    ("c04_arduino_millis.csv", None, "g", ["x", "y", "z"]),
    ("c05_date_and_time.csv", 1_767_263_425.0, "gyr_x", ["value"]),
    ("c06_decimal_comma.csv", EPOCH_2017, "gyr_x", ["value"]),
    ("c08_phone_sensor_logger_Gyroscope.csv", EPOCH_2017, "xyz", ["x", "y", "z"]),
    ("c09_phyphox_Gyroscope.csv", None, "Gyroscope", ["x", "y", "z"]),
    ("c10_xsens_dot.csv", None, "Gyr", ["x", "y", "z"]),
    ("c15_blackbox_decode.csv", None, "gyroADC", ["0", "1", "2"]),
    ("c17_mavlogdump_IMU.csv", EPOCH_2017, "Gyr", ["x", "y", "z"]),
    ("c19_secs_nsecs.csv", EPOCH_2017, "angular_velocity", ["x", "y", "z"]),
]


def opened(name: str, folder: Path, table: TableOptions | None = None) -> ColumnStore:
    return decode(open_file(field_file(name), "", table), folder / "columns", protocol_set.all_protocols())


@each_row(("name", "start", "channel", "columns"), TABLES)
def test_a_table_has_its_times_and_vectors(
    name: str, start: float | None, channel: str, columns: list[str], tmp_path: Path
) -> None:
    store = opened(name, tmp_path)
    info = next(one for one in store.manifest["channels"] if one["name"] == channel)
    rows = store.exact(info["id"], 0, 1000)
    assert [column["name"] for column in info["columns"]] == columns
    np.testing.assert_allclose(np.diff(rows.time), 1 / RATE, atol=2e-6)
    if start is not None:
        assert rows.time[0] == pytest.approx(start, abs=1e-6)
    t = np.arange(len(rows.time)) / RATE
    scale = np.degrees(1.0) if name.startswith("c15") else 1.0
    np.testing.assert_allclose(rows.columns[0], scale * np.sin(4 * np.pi * t), atol=1e-3 * scale)
    assert store.manifest["time"]["axis"]
    assert not store.manifest["damage"]


def test_a_clock_that_goes_back_begins_a_segment(tmp_path: Path) -> None:
    store = opened("c12_clock_goes_back.csv", tmp_path)
    [event] = [one for one in store.manifest["events"] if one["data"].get("kind") == "back"]
    assert event["data"]["by_s"] == pytest.approx(-2.0, abs=1e-6)
    assert event["data"]["row"] == 251
    assert store.manifest["segments"] == {"1": [event["time"]]}
    info = next(one for one in store.manifest["channels"] if one["name"] == "gyr_x")
    time = store.exact(info["id"], 0, 1000).time
    steps = np.diff(time)
    np.testing.assert_allclose(np.delete(steps, 249), 0.01, atol=1e-6)
    assert steps[249] > 0.05  # seen as a gap by whatever draws or computes
    clock = next(one for one in store.manifest["channels"] if one["name"] == "time")
    values = store.exact(clock["id"], 0, 1000).columns[0]
    assert np.diff(values).min() == pytest.approx(-1.99, abs=1e-6)  # the clock itself, as it is in the file


def test_a_table_without_heading_and_times_is_refused_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as refused:
        opened("c14_kitti_oxts.txt", tmp_path)
    assert "--rate" in refused.value.hint
    options = TableOptions(rate=10.0, columns={"18": "Gyro.x (rad/s)", "19": "Gyro.y (rad/s)", "20": "Gyro.z (rad/s)"})
    store = opened("c14_kitti_oxts.txt", tmp_path, options)
    info = next(one for one in store.manifest["channels"] if one["name"] == "Gyro")
    rows = store.exact(info["id"], 0, 1000)
    np.testing.assert_allclose(np.diff(rows.time), 0.1, atol=1e-6)
    assert (info["kind"], info["unit"]) == ("vector", "rad/s")
