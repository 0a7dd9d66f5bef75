"""Exported EuRoC folders: layout, heading, description; moments that lack a number."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import imuscope
from imuscope.recordings.columns.store import ChannelLayout, ColumnStoreWriter
from imuscope.recordings.exporters import ExportError, ExportRequest, export
from tests.recordings.recorded_drive import drive
from tests.recordings.store_fixtures import ACCELERATION, START, store

TURN = {**ACCELERATION, "id": 2, "name": "RateOfTurn", "title": "Rate of turn"}
TURN["columns"] = [{**column, "unit": "°/s"} for column in TURN["columns"]]
HEADING = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)


def test_a_folder_is_as_in_the_data_sets(tmp_path: Path) -> None:
    drive(tmp_path / "drive.mcap")
    with imuscope.open(tmp_path / "drive.mcap") as recording:
        [folder] = recording.export(tmp_path / "drive.euroc")
        sent = recording["RateOfTurn"].in_units("device").values
    assert sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()) == [
        "mav0/imu0/data.csv",
        "mav0/imu0/sensor.yaml",
    ]
    heading, *rows = (folder / "mav0/imu0/data.csv").read_text().splitlines()
    assert heading == HEADING
    numbers = np.array([row.split(",") for row in rows], np.float64)
    np.testing.assert_array_equal(numbers[:, 1:4].astype(np.float32), sent)
    assert {len(row.split(",")) for row in rows} == {7}
    about = yaml.safe_load((folder / "mav0/imu0/sensor.yaml").read_text())
    assert (about["sensor_type"], about["rate_hz"]) == ("imu", 100)
    assert np.array_equal(np.reshape(about["T_BS"]["data"], (4, 4)), np.eye(4))
    assert not any("noise" in name for name in about)


def test_moments_that_lack_a_number_are_left_out_and_counted(tmp_path: Path) -> None:
    writer = ColumnStoreWriter(tmp_path / "store")
    time = START + np.arange(10) / 100
    for info in (ACCELERATION, TURN):
        writer.channel(info["id"], ChannelLayout(("f4",) * 3, (False,) * 3))
        values = np.ones((3, 10), np.float32)
        values[0, 3] = np.nan if info is TURN else 1
        rows = slice(None) if info is TURN else slice(1, None)
        writer.append(info["id"], [time[rows] + 0.002, time[rows], *values[:, rows]])
    device = {"id": "1", "name": "MTi", "protocol": "xbus", "product": ""}
    columns = writer.finish({"channels": [ACCELERATION, TURN], "devices": [device], "format": "mcap"})
    [folder] = export("euroc", ExportRequest(columns), tmp_path / "run.euroc")
    table = np.loadtxt(folder / "mav0/imu0/data.csv", delimiter=",")
    assert table[:, 0].tolist() == [round(t * 1e9) for t in np.delete(time, (0, 3))]
    np.testing.assert_array_equal(table[:, 1:4], np.deg2rad(1.0))
    assert "lack one of the numbers: 2." in (folder / "mav0/imu0/sensor.yaml").read_text()


def test_a_device_needs_both_quantities(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="No device has a rate of turn"):
        export("euroc", ExportRequest(store(tmp_path / "store")), tmp_path / "run.euroc")
