"""Rows as programs print them, with the names beside the numbers; and headings of more lines or names than the rows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.tables.line_marks import labels_of
from imuscope.recordings.tables.options import TableOptions
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode
from tests.support.each_row import each_row

N = 60
CLOCK = "10:30:{n:02}.500"


def opened(path: Path, rate: float = 0.0) -> ColumnStore:
    source = open_file(path, "", TableOptions(rate=rate))
    return decode(source, path.with_suffix(".columns"), protocol_set.all_protocols())


def written(head: str, row: str, path: Path) -> Path:
    """N rows with the fields n, x (which counts to 6), ms and s, 20 ms apart."""
    rows = (row.format(n=n, x=n % 7, ms=100_000 + 20 * n, s=f"{100 + n / 50:.2f}") for n in range(N))
    path.write_text(head + "\n".join(rows) + "\n", encoding="utf-8")
    return path


@each_row(
    ("line", "names"),
    [
        ("Mag: 0.5 -0.8 -7  Accel: 0.1 .3 9e1", ["Mag[0]", "Mag[1]", "Mag[2]", "Accel[0]", "Accel[1]", "Accel[2]"]),
        (
            "10:15:12.186,GYRO: X=0.1,Y=0.2,Z=0.3,TEMP: 25,GPS: 3D_FIX,SAT=4",
            ["time", "GYRO.X", "GYRO.Y", "GYRO.Z", "TEMP", "SAT"],
        ),
        ("2026-01-02 10:15:12.186 R(deg): 1, P(deg): 2", ["time", "R (deg)", "P (deg)"]),
        ("EULER(deg): R=1.7,P=9,ACC: X=1", ["EULER.R (deg)", "EULER.P (deg)", "ACC.X"]),
        ("ax:0.1 ay:0.2 az:9.81, t=1234", ["ax", "ay", "az", "t"]),
        ("Linear Accel X = 12, Y = -2, qw = 3", ["Linear Accel X", "Linear Accel Y", "qw"]),
        ("Roll: 1.2 deg, Pitch: 3.4 deg", ["Roll (deg)", "Pitch (deg)"]),
        ("Time: 123 ms Acc x: 0.1 m/s^2 y: 2 m/s^2", ["Time (ms)", "Acc x (m/s^2)", "Acc y (m/s^2)"]),
        ("{'ax': 0.1, 'ay': nan}", ["ax", "ay"]),
        ("[12.5] AcX = 12 | Tmp = 36.5 C", ["time", "AcX", "Tmp (C)"]),
        ("Accel[0]: 1 Accel[1]: 2", ["Accel[0]", "Accel[1]"]),
        ("imu,0.1,0.2", None),
        ("0.1,0.2,0.3", None),
        ("$GPGGA,103025.00,4800.0,N,01100.0,E", None),
    ],
)
def test_names_beside_the_numbers_are_the_heading(line: str, names: Sequence[str] | None) -> None:
    labels = labels_of([line] * 4)
    assert (labels and list(labels.names)) == names
    if labels is not None:
        assert len(labels.cells(line).split("\t")) == len(labels.names)
        assert labels.cells("another: 1") == "another: 1"


@each_row(
    ("row", "channel", "words"),
    [
        ("t: {ms} ms, Gyro X: {x}, Y: 0, Z: 9", "Gyro", "t in ms"),
        ("time={s} ax={x} ay=0 az=9", "a", "time in s"),
        (f"{CLOCK} -> ax={{x}}\tay=0\taz=9", "a", "time, of a day"),
        (f"2026-01-02 {CLOCK},GYRO: X={{x}},Y=0,Z=9,FIX: {{n}}D_FIX", "GYRO", "time, since 1970"),
    ],
)
def test_printed_rows_are_a_table(row: str, channel: str, words: str, tmp_path: Path) -> None:
    store = opened(written("MPU6050 ready\n", row, tmp_path / "a.log"))
    assert words in " ".join(store.manifest["time"]["sentences"])
    info = next(one for one in store.manifest["channels"] if one["name"] == channel)
    assert [column["name"] for column in info["columns"]] == ["x", "y", "z"]
    rows = store.exact(info["id"], 0, 10_000)
    np.testing.assert_array_equal(rows.columns[0], np.arange(N) % 7)
    np.testing.assert_allclose(np.diff(rows.time), 1.0 if "day" in words or "1970" in words else 0.02, atol=1e-6)


def test_printed_rows_without_a_time_have_the_rate_that_is_given(tmp_path: Path) -> None:
    path = written("", "Mag: {x} 0 1  Accel: 0 {n} 9", tmp_path / "a.txt")
    with pytest.raises(RecordingError, match="no column of times") as refused:
        opened(path)
    assert "There are: Mag[0], Mag[1]" in refused.value.hint
    store = opened(path, 50.0)
    assert [info["name"] for info in store.manifest["channels"]] == ["Mag", "Accel"]


@each_row(
    ("head", "row", "names"),
    [
        ("time_s,a_x,b,c_1,c_2\n", "{s},{x},", ["a_x"]),
        ('"time_s" "gx" "gy" "gz"\n', '"{n}" {s} {x} 0 9', ["column 1", "g"]),
        (",acc,acc,acc,gyr,gyr,gyr\n,x,y,z,x,y,z\ntime_s,,,,,,\n", "{s},{x},0,9,0,0,1", ["acc", "gyr"]),
        ("time,acc,,,gyr,,\n(s),x,y,z,x,y,z\n", "{s},{x},0,9,0,0,1", ["acc", "gyr"]),
        ("{{System 1}};;;;\ntime_s;a_x;a_y;a_z;\n".replace("{{", "{").replace("}}", "}"), "{s};{x};0;9;", ["a"]),
        ("0,1,2,3\n", "{s},{x},0,9", ["column 2", "column 3", "column 4"]),
        ("", "{s} {x} 0 9 \r", ["column 2", "column 3", "column 4"]),
        ('time_s,frame,a_x,a_y,a_z,raw\n', '{s},1,{x},0,9,"$VNYMR,{n}\r\n"', ["frame", "a"]),
    ],
)  # fmt: skip
def test_the_heading_names_the_columns(head: str, row: str, names: list[str], tmp_path: Path) -> None:
    store = opened(written(head, row, tmp_path / "a.csv"))
    assert [info["name"] for info in store.manifest["channels"]] == names
    result = store.exact(1 + ("column 1" in names or "frame" in names), 0, 10_000)
    np.testing.assert_array_equal(result.columns[0], np.arange(N) % 7)
    np.testing.assert_allclose(np.diff(result.time), 0.02, atol=1e-6)
    texts = [one["words"] for one in store.manifest["damage"]]
    assert ("The heading has 5 names, the rows 3 cells: the first names are taken." in texts) is ("c_2" in head)


IMU, GPS = "stamp_sec_imu,stamp_nanosec_imu", "stamp_sec_gps,stamp_nanosec_gps"
HEAD = "--- Data File Created By a watch, date format M/d/yyyy at 50 Hz ---\nStart Time 02:40:00\nStart Date 7/4/2017\n"


@each_row(
    ("head", "row", "start", "words"),
    [
        (f"{GPS},{IMU},a_x\n", ",,1500000000,{n}0000000,{x}", 1_500_000_000.0, "stamp_sec_imu + stamp_nanosec_imu"),
        ("// Update Rate: 50.0Hz\nPacketCounter\tSampleTimeFine\ta_x\n", "{n}\t0\t{x}", None, "PacketCounter"),
        (HEAD + "----\nAccelerometer X,Accelerometer Y,Accelerometer Z\n", "{x},0,9", 1_499_136_000.0, "the rows"),
        ("PC Time,test_time,a_x\n", "23:00:49,{s},{x}", None, "test_time in s"),
    ],
)
def test_a_clock_that_stands_or_has_few_times_is_not_the_axis(
    head: str, row: str, start: float | None, words: str, tmp_path: Path
) -> None:
    path = written(head, row, tmp_path / "a.txt")
    if "sec_gps" in head:  # now and then a row of the other sensor
        lines = path.read_text().splitlines()
        path.write_text("\n".join([*lines[:20], "1500000000,150000000,,,", *lines[20:]]) + "\n")
    store = opened(path)
    assert words in store.manifest["time"]["sentences"][0]
    time = store.exact(store.manifest["channels"][-1]["id"], 0, 10_000).time
    assert len(time) == N
    assert (np.diff(time) > 0).all()
    assert start is None or time[0] == start


def test_an_empty_column_of_times_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no column of times") as refused:
        opened(written("a_x,a_y,time\n", "{x},0,", tmp_path / "a.csv"))
    assert refused.value.hint.startswith("time is empty in all rows.")


def test_all_columns_that_may_be_the_time_are_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="the unit of column 1") as refused:
        opened(written("", "{n},{ms},{x},0", tmp_path / "a.csv"))
    assert "too: column 2, with --time-column" in refused.value.hint


@each_row(
    ("stamp", "start"),
    [
        ("[10:15:{n:02}.500] ", None),
        ("10:15:{n:02}.500: ", None),
        ("[2017-07-14 02:40:{n:02}.500] ", 1_500_000_000.5),
        ("2017-07-14T02:40:{n:02}.500 -> ", 1_500_000_000.5),
        ("2017-07-14 02:40:{n:02},500 INFO imu: ", 1_500_000_000.5),
    ],
)
@each_row("row", ["{x},0.5,9.8", "{x} 0.5 9.8", "{x}\t0.5\t9.8"])
def test_the_stamp_of_a_terminal_is_the_time(stamp: str, start: float | None, row: str, tmp_path: Path) -> None:
    store = opened(written("", stamp + row, tmp_path / "a.txt"))
    rows = store.exact(1, 0, 1000)
    np.testing.assert_array_equal(rows.columns[0], np.arange(N) % 7)
    np.testing.assert_allclose(np.diff(rows.time), 1.0, atol=1e-6)
    assert start is None or rows.time[0] == pytest.approx(start, abs=1e-6)


def test_the_text_of_mavlogdump_has_a_table_for_each_message(tmp_path: Path) -> None:
    lines = []
    for n in range(N):
        stamp = f"2017-07-14 02:40:{n // 50:02}.{n % 50 * 2:02}"
        lines.append(f"{stamp}: IMU {{TimeUS : {20_000 * n}, GyrX : {n % 7}.0, GyrY : 0.0, GyrZ : 0.0}}")
        lines.append(f"{stamp}: ATT {{TimeUS : {20_000 * n + 5000}, Roll : 1.5, Mode : AUTO, Pitch : 2.5}}")
    path = tmp_path / "a.txt"
    path.write_text("\n".join(lines) + "\n")
    store = opened(path)
    assert "TimeUS in µs" in store.manifest["time"]["sentences"][0]
    results = {(info["message"], info["name"]): info for info in store.manifest["channels"]}
    rows = store.exact(results["IMU", "Gyr"]["id"], 0, 1000)
    np.testing.assert_array_equal(rows.columns[0], np.arange(N) % 7)
    np.testing.assert_allclose(rows.time, 1_500_000_000 + np.arange(N) / 50, atol=1e-6)
    assert store.exact(results["ATT", "Pitch"]["id"], 0, 1).columns[0][0] == 2.5


def test_the_text_of_rostopic_echo_is_refused_with_the_remedy(tmp_path: Path) -> None:
    path = written("", "header:\n  seq: {n}\n  stamp:\n    secs: {n}\n    nsecs: 0\nx: {x}\n---", tmp_path / "a.txt")
    with pytest.raises(RecordingError, match="rostopic echo") as refused:
        opened(path)
    assert "rostopic echo -p" in refused.value.hint
