"""EuRoC folders, as folders and packed: several sensors, cameras, and sensors that cannot be read."""

import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from tests.recordings.readers.formats.opening import damage_of, opened, rows_of
from tests.support.each_row import each_row

BEGIN = 1_403_636_579_758_555_392  # of MH_01_easy
COUNT = 200
HEAD = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],"
)


def data_set(folder: Path, *, root: str = "mav0") -> Path:
    """Two sensors at 200 Hz, a pose, and a camera."""
    for number in (0, 1):
        imu = folder / root / f"imu{number}"
        imu.mkdir(parents=True)
        rows = [f"{BEGIN + n * 5_000_000},{0.1 + number},{n},0,9.81,0,{n / 7!r}" for n in range(COUNT)]
        (imu / "data.csv").write_text("\n".join([HEAD + "a_RS_S_z [m s^-2]", *rows, ""]))
        (imu / "sensor.yaml").write_text(f"%YAML:1.0\nsensor_type: imu\ncomment: ADIS\nrate_hz: {250 - 50 * number}\n")
    pose = folder / root / "state_groundtruth_estimate0"
    pose.mkdir()
    rows = [f"{BEGIN + n * 50_000_000},{n},0,0" for n in range(20)]
    (pose / "data.csv").write_text("\n".join(["#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m]", *rows, ""]))
    camera = folder / root / "cam0"
    camera.mkdir()
    (camera / "data.csv").write_text(f"#timestamp [ns],filename\n{BEGIN},{BEGIN}.png\n")
    (camera / "sensor.yaml").write_text("sensor_type: camera\n")
    return folder


def packed(folder: Path, out: Path) -> Path:
    with zipfile.ZipFile(out, "w") as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                archive.write(path, f"MH_01_easy/{path.relative_to(folder)}")
    return out


@each_row("way", ["folder", "mav0", "inside", "zip"])
def test_each_sensor_is_a_table(way: str, tmp_path: Path) -> None:
    folder = data_set(tmp_path / "set", root="" if way == "inside" else "mav0")
    path = {"mav0": folder / "mav0", "zip": tmp_path / "set.zip"}.get(way, folder)
    if way == "zip":
        packed(folder, path)
    store = opened(path, tmp_path)
    assert {one["message"] for one in store.manifest["channels"]} == {"imu0", "imu1", "state_groundtruth_estimate0"}
    for number in (0, 1):
        rows = rows_of(store, "w_RS_S", f"imu{number}")
        np.testing.assert_array_equal(rows.columns[0], np.full(COUNT, 0.1 + number))
        np.testing.assert_allclose(rows.time, BEGIN / 1e9 + np.arange(COUNT) / 200, atol=1e-6)
        np.testing.assert_array_equal(rows_of(store, "a_RS_S", f"imu{number}").columns[2], np.arange(COUNT) / 7)
    infos = {(one["message"], one["name"]): one["unit"] for one in store.manifest["channels"]}
    assert infos["imu0", "a_RS_S"] == "m/s²"
    assert "names another rate, 250 Hz" in " ".join(store.manifest["time"]["sentences"])


def test_a_sensor_that_cannot_be_read_is_left_out(tmp_path: Path) -> None:
    folder = data_set(tmp_path / "set")
    (folder / "mav0" / "imu1" / "data.csv").write_bytes(b"\x89PNG\r\n\x1a\n")
    store = opened(folder, tmp_path)
    assert {one["message"] for one in store.manifest["channels"]} == {"imu0", "state_groundtruth_estimate0"}
    assert "imu1 is left out" in damage_of(store)


def test_other_folders_are_refused_with_what_opens(tmp_path: Path) -> None:
    folder = data_set(tmp_path / "set")
    for number in (0, 1):
        shutil.rmtree(folder / "mav0" / f"imu{number}")
    with pytest.raises(RecordingError, match="is a folder") as refused:
        open_file(folder)
    assert "EuRoC" in refused.value.hint
