"""Text logs in which rows of several sensors or messages follow one another."""

from __future__ import annotations

import re
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.probe import probe
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode
from tests.support.each_row import each_row

N = 40
PHONE = "% columns: ACCE;AppTimestamp(s);Acc_X(m/s^2);Acc_Y(m/s^2);Acc_Z(m/s^2);Accuracy(integer)\n"
WITH_ALL = """% Accelerometer data: 'ACCE;AppTimestamp(s);Acc_X(m/s^2);;Acc_Y(m/s^2);Acc_Z(m/s^2);Accuracy(integer)'
% BLE 4.0 data:       'BLE4;AppTimestamp(s);MajorID;MinorID;RSS(dBm);'
"""
FLYSIGHT = (
    "$FLYS,1\n$VAR,ID,1\n$COL,BARO,time,pressure\n$UNIT,BARO,s,Pa\n$COL,IMU,time,ax,ay,az\n$UNIT,IMU,s,g,g,g\n$DATA\n"
)
NAMED = "# Raw,utcTimeMillis,ax,ay,az\n# \n# Fix,Provider,Latitude,(UTC)TimeInMs\n"


def opened(path: Path) -> ColumnStore:
    return decode(open_file(path), path.with_suffix(".columns"), protocol_set.all_protocols())


def channels(store: ColumnStore) -> dict[str, list[dict[str, Any]]]:
    """Channels by message."""
    results: dict[str, list[dict[str, Any]]] = {}
    for info in store.manifest["channels"]:
        results.setdefault(info["message"], []).append(info)
    return results


@each_row(
    ("name", "head", "rows", "message", "vector", "rate"),
    [
        ("a.txt", PHONE, "ACCE;{s:.3f};{x};0;9;3\nWIFI;{s:.3f};home;7;-60", "ACCE", "Acc", 50),
        ("a.txt", WITH_ALL, "ACCE;{s:.3f};{x};0;9;3\nMAGN;{s:.3f};1;2;3;4", "ACCE", "Acc", 50),
        ("A.CSV", FLYSIGHT, "$IMU,{s:.3f},{x},0,9\n$BARO,{s:.3f},10100", "IMU", "a", 50),
        ("a.txt", NAMED, "Raw,15000000{ms},{x},0,9\nFix,gps,48.0,15000000{ms}", "Raw", "a", 50),
        ("a.csv", "time_ms,sensor,x,y,z\n", "{ms},gyroscope,{x},0,9\n{ms},accelerometer,5,0,9", "gyroscope", "xyz", 50),
        ("a.csv", "time_ms,DeviceName,ax,ay,az\n", "{ms},WT(aa),{x},0,9\n{ms},WT(bb),5,0,9", "WT.aa", "a", 50),
    ],
)
def test_each_sensor_is_a_table(
    name: str, head: str, rows: str, message: str, vector: str, rate: float, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_text(head + "".join(rows.format(ms=10_000 + 20 * n, s=100 + n / 50, x=n % 7) + "\n" for n in range(N)))
    store = opened(path)
    assert len(channels(store)) == 2
    [of_message] = [of for one, of in channels(store).items() if re.search(message, one)]
    info = next(one for one in of_message if one["name"] == vector)
    assert [column["name"] for column in info["columns"]] == ["x", "y", "z"]
    samples = store.exact(info["id"], 0, 1000)
    np.testing.assert_array_equal(samples.columns[0], np.arange(N) % 7)
    np.testing.assert_allclose(np.diff(samples.time), 1 / rate, rtol=0, atol=1e-6)
    listed = probe(path)
    assert listed is not None
    assert not listed.damaged


def test_a_name_may_stand_behind_the_time(tmp_path: Path) -> None:
    path = tmp_path / "replay_2017-07-14_02-40-00.csv"
    slow = "".join(f"{4000 * n},gps,3,4,5\n" * (n % 50 == 0) + f"{4000 * n},imu,{n % 7},0,9,1\n" for n in range(1, 300))
    path.write_text(slow)
    store = opened(path)
    of_message = channels(store)
    samples = store.exact(of_message["imu"][0]["id"], 0, 1000)
    np.testing.assert_array_equal(samples.columns[0], np.arange(1, 300) % 7)
    np.testing.assert_allclose(np.diff(samples.time), 0.004, atol=1e-6)
    slower = store.exact(of_message["gps"][0]["id"], 0, 1000)  # its unit alone would be open
    np.testing.assert_allclose(np.diff(slower.time), 0.2, atol=1e-6)
    assert slower.time[0] - samples.time[0] == pytest.approx(49 * 0.004, abs=1e-6)


def test_one_clock_of_two_tables_has_one_zero(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    lines = [f"ACCE;{100 + n / 50:.3f};1;2;9\n" + f"GYRO;{100 + n / 50:.3f};1;2;9;3\n" * (n > 25) for n in range(N)]
    path.write_text("".join(lines))
    store = opened(path)
    assert "last change" in " ".join(store.manifest["time"]["sentences"])
    assert store.exact(1, 0, 1).time[0] == pytest.approx(path.stat().st_mtime, abs=1e-3)
    first = {message: store.exact(of[0]["id"], 0, 1).time[0] for message, of in channels(store).items()}
    assert first["GYRO"] - first["ACCE"] == pytest.approx(26 / 50, abs=1e-6)


def test_ascii_logs_of_novatel_have_their_week(tmp_path: Path) -> None:
    path = tmp_path / "a.asc"
    short = "%RAWIMUSA,2254,{0:.3f};2254,{0:.3f},00000077,-16000,{1},12,-5,6,7*0123abcd\n"
    long = (
        "#INSPVAA,COM1,0,54.5,FINESTEERING,2254,{0:.3f},00000000,54e2,4;"
        "2254,{0:.3f},48.1,11.5,500,0,0,0,1,2,3,GOOD*0123abcd\n"
    )
    path.write_text("".join((short + long).format(367_200 + n / 50, n % 7) for n in range(N)))
    store = opened(path)
    raw = {info["name"]: info["id"] for info in channels(store)["RAWIMUSA"]}
    assert "accel -y" in raw
    samples = store.exact(raw["accel -y"], 0, 1000)
    np.testing.assert_array_equal(samples.columns[0], np.arange(N) % 7)
    np.testing.assert_allclose(samples.time, 315_964_800 + 2254 * 604_800 + 367_200 - 18 + np.arange(N) / 50, atol=1e-6)
    assert any("latitude" in info["name"] for info in channels(store)["INSPVAA"])


def test_tables_that_all_leave_something_open_are_requested(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("".join(f"ATT,{n},0,1\nCTUN,{n},0,1,2\n" for n in range(N)))
    with pytest.raises(RecordingError, match="the unit of column 1 can be s"):
        opened(path)


def test_tables_of_one_file_are_dated_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "walk_2017-07-14_02-40-00.txt"
    path.write_text("".join(f"ACCE;{100 + n / 50:.3f};1;2;9\nGYRO;{100 + n / 50:.3f};1;2;9;3\n" for n in range(N)))
    store = opened(path)
    assert {store.exact(of[0]["id"], 0, 1).time[0] for of in channels(store).values()} == {1_500_000_000.0}
    assert "the file's name" in " ".join(store.manifest["time"]["sentences"])


def test_rows_with_blanks_between_their_cells_have_a_table_for_each_name(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    lines = [f"IMU {1_500_000_000 + n / 100:.2f} {n % 7} 0 0 0 0 9.8" for n in range(300)]
    for n in range(0, 300, 20):
        lines.insert(n, f"GNSS {1_500_000_000 + n / 100:.2f} 48.1 11.5 500")
    path.write_text("\n".join(lines) + "\n")
    store = opened(path)
    assert set(channels(store)) == {"IMU", "GNSS"}
    assert store.rows(channels(store)["IMU"][0]["id"]) == 300


def test_devices_with_numbers_have_clocks_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{n % 2},{n // 2 * 10 + n % 2 * 50_000},{n % 7},0,9" for n in range(400)]
    path.write_text("sensor_id,time_ms,a_x,a_y,a_z\n" + "\n".join(rows) + "\n")
    store = opened(path)
    results = channels(store)
    assert list(results) == ["sensor_id 0", "sensor_id 1"]
    for infos in results.values():
        np.testing.assert_allclose(np.diff(store.exact(infos[0]["id"], 0, 1000).time), 0.01, atol=1e-6)


@each_row("prompt", ["", "[ICOM5]"])
def test_a_log_of_one_novatel_message_has_its_columns_and_gps_time(prompt: str, tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    head = "COM1,0,73.5,FINESTEERING,2288,{:.3f},01000000,471d,15715"
    body = "INS_SOLUTION_GOOD,INS_PSRSP,48.1,11.5,{},47.0,0.1,0.2,0.3,1.1,1.2,90.5,1,1,1,0.1,0.1,0.1,0.5,0.5,0.5,3,0"
    times = [(604_790 + n / 10, n % 7) for n in range(60)]
    lines = [f"{prompt}#INSPVAXA,{head.format(time)};{body.format(height)}*ffffffff" for time, height in times]
    path.write_text("\r\n\r\n".join(lines) + "\r\n")
    store = opened(path)
    results = {info["name"]: info for info in channels(store)["INSPVAXA"]}
    assert results["height"]["unit"] == "m"
    rows = store.exact(results["height"]["id"], 0, 1000)
    np.testing.assert_array_equal(rows.columns[0], np.arange(60) % 7)
    np.testing.assert_allclose(rows.time, 315_964_800 + 2288 * 604_800 + 604_790 - 18 + np.arange(60) / 10, atol=1e-6)


def test_a_terminal_may_write_its_times_before_the_sentences_of_a_receiver(tmp_path: Path) -> None:
    lines = []
    for second in range(30):
        body = f"GPRMC,1030{second:02}.00,A,4800.0,N,01100.0,E,0.0,0.0,010126,,,A"
        check = reduce(xor, body.encode())
        lines.append(f"[2026-01-01 12:30:{second:02}.250] ${body}*{check:02X}\r\n")
    path = tmp_path / "a.txt"
    path.write_text("".join(lines))
    store = opened(path)
    [info] = store.manifest["channels"]
    rows = store.exact(info["id"], 0, 100)
    assert rows.time[0] == 1_767_263_400
    np.testing.assert_allclose(np.diff(rows.time), 1.0, atol=1e-6)
    assert probe(path) is not None


def test_rows_of_a_flysight_relate_its_uptime_to_gps_time(tmp_path: Path) -> None:
    path = tmp_path / "SENSOR.CSV"
    head = FLYSIGHT.replace("$DATA", "$COL,TIME,time,tow,week\n$UNIT,TIME,s,s,\n$DATA")
    rows = [f"$BARO,{603_000 + n / 50:.3f},10100\n$IMU,{603_000.01 + n / 50:.3f},{n % 7},0,9" for n in range(100)]
    for second in (1, 0):
        rows.insert(50 * second + 20, f"$TIME,{603_000.4 + second:.3f},{252_818.0 + second:.3f},2288")
    path.write_text(head + "\n".join(rows) + "\n")
    store = opened(path)
    for message, begin in (("IMU", 0.01), ("BARO", 0.0)):
        [info, *_] = channels(store)[message]
        time = store.exact(info["id"], 0, 1000).time
        np.testing.assert_allclose(time, 1_700_000_000 - 0.4 + begin + np.arange(100) / 50, atol=1e-6)


def test_a_log_with_one_row_of_each_message_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    head = "USB1,0,73.0,FINESTEERING,2237,270605.000,1a000000,a40a,17007"
    path.write_text(f"#BESTUTMA,{head};1,2,3*ffffffff\n#VERSIONA,{head};4,5,6*ffffffff\n")
    with pytest.raises(RecordingError, match="one row of each message only"):
        opened(path)
