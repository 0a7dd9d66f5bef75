"""Tables as loggers, phones and programs of vendors write them: where each begins, its vectors and units."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.probe import probe
from imuscope.recordings.tables.options import TableOptions
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode
from tests.support.each_row import each_row

N = 60
STEP = 0.02
SHIMMER = "Accel_LN_{}_CAL\t".format
SHIMMER_HEAD = f"Timestamp_CAL\t{''.join(map(SHIMMER, 'XYZ'))}\nms\tm/(s^2)\tm/(s^2)\tm/(s^2)\t\n"
OLD_SHIMMER = (
    "Unit\tUnit\tUnit\tUnit\nTimestamp\tGyro X\tGyro Y\tGyro Z\nCAL\tCAL\tCAL\tCAL\nmSecs\tdeg/sec\tdeg/sec\tdeg/sec\n"
)
MARKED = "% made by a program\nTimestamp\tAcc X\tAcc Y\tAcc Z\n(us)\t(m.s-2)\t(m.s-2)\t(m.s-2)\n"
VBOX = "File created on 14/07/2017\n\n[header]\nsatellites\n\n[column names]\nuptime a_x a_y a_z\n\n[data]\n"
MS, US, S = "{ms},{x},0,9", "{us},{x},0,9", "{s},{x},0,9"


def written(head: str, row: str, name: str, folder: Path) -> Path:
    """A file of N rows 20 ms apart, with the fields ms, us, s (from 100 s on), and x, which counts to 6."""
    path = folder / name
    rows = (
        row.format(ms=100_000 + 20 * n, us=100_000_000 + 20_000 * n, s=f"{100 + STEP * n:.3f}", x=n % 7, n=n)
        for n in range(N)
    )
    path.write_text(head + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def opened(path: Path) -> ColumnStore:
    return decode(open_file(path), path.with_suffix(".columns"), protocol_set.all_protocols())


@each_row(
    ("head", "row", "channel", "unit"),
    [
        ('"sep=\t"\n' + SHIMMER_HEAD, "{ms}\t{x}\t0\t9\t", "Accel_LN_CAL", "m/s²"),
        (OLD_SHIMMER, "{ms}\t{x}\t0\t9", "Gyro", "deg/s"),
        (MARKED, "{us}\t{x}\t0\t9", "Acc", "m/s²"),
        ("@ Logger\n@ Date:Sat Apr 04, Sampling Rate:20ms\n\ntime_ms,a.x,a.y,a.z\n", MS, "a", ""),
        ("accelerometer-a1,vendor,2020-02-15\ntime[ms],acc_x[m/s^2],acc_y[m/s^2],acc_z[m/s^2]\n", MS, "acc", "m/s²"),
        ("# Some format: time[us], wx(rad/s), wy(rad/s), wz(rad/s)\n", US, "w", "rad/s"),
        ("# time (s), a x (g), a y (g), a z (g)\n# ---\n", S, "a", "g"),
        ("time_s ax (m/s^2) ay (m/s^2) az (m/s^2)\n", "{s} {x} 0 9", "a", "m/s²"),
        (VBOX.replace("uptime", "uptime_s"), "{s} {x} +00 9", "a", ""),
        ("time (s),a_x,a_y,a_z\n", S + ",", "a", ""),
        ("time (s),a_x,a_y,a_z,\n", S, "a", ""),
        ("time_ms;a/x;a/y;a/z\n", "{ms},0;{x},0;0,5;9,1", "a", ""),
        ("time_ms,accel_x_mps2,accel_y_mps2,accel_z_mps2\n", MS, "accel", "m/s²"),
        ("time_ms,Gyro_X_deg_per_s,Gyro_Y_deg_per_s,Gyro_Z_deg_per_s\n", MS, "Gyro", "deg/s"),
        ("time_ms,Acc_X_g,Acc_Y_g,Acc_Z_g\n", MS, "Acc", "g"),
        ("time_ms,x (in radians/s),y (in radians/s),z (in radians/s)\n", MS, "xyz", "rad/s"),
        ("time_ms,/imu/gyro/x,/imu/gyro/y,/imu/gyro/z\n", MS, "/imu/gyro", ""),
        ("time_ms,acc_x_raw,acc_y_raw,acc_z_raw\n", MS, "acc_raw", ""),
        ("time_ms,x_gyro,y_gyro,z_gyro,x_acc,y_acc,z_acc\n", MS + ",0,0,9", "gyro", ""),
        ("time_ms,X Accel [x8004],Y Accel [x8004],Z Accel [x8004]\n", MS, "Accel", ""),
        ("time_ms,pitch_x (degrees),pitch_y (degrees),pitch_z (degrees)\n", MS, "pitch", "degrees"),
        ("time_ms,turn_x (radians),turn_y (radians),turn_z (radians)\n", MS, "turn", "radians"),
        ("time_ms,w.x,w.y,w.z,w_covariance0,w_covariance1\n", MS + ",1,2", "w", ""),
    ],
)
def test_a_table_begins_where_its_rows_do(head: str, row: str, channel: str, unit: str, tmp_path: Path) -> None:
    store = opened(written(head, row, "a.csv", tmp_path))
    info = next(one for one in store.manifest["channels"] if one["name"] == channel)
    assert [column["name"] for column in info["columns"]] == ["x", "y", "z"]
    assert info["unit"] == unit
    rows = store.exact(info["id"], 0, 1000)
    np.testing.assert_allclose(np.diff(rows.time), STEP, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(rows.columns[0], np.arange(N) % 7)
    assert not store.manifest["damage"]


@each_row("names", [("qx", "qy", "qz", "qw"), ("q.w", "q.x", "q.y", "q.z"), ("quatX", "quatY", "quatZ", "quatW")])
def test_w_goes_with_its_vector(names: Sequence[str], tmp_path: Path) -> None:
    store = opened(written(f"time_ms,{','.join(names)}\n", MS + ",1", "a.csv", tmp_path))
    [info] = store.manifest["channels"]
    assert [column["name"] for column in info["columns"]] == ["w", "x", "y", "z"]


def test_empty_columns_without_a_name_are_left_out(tmp_path: Path) -> None:
    store = opened(written("time_ms,a,b,c,\n", MS + ",", "a.csv", tmp_path))
    assert [info["name"] for info in store.manifest["channels"]] == ["a", "b", "c"]


WEEK_2254 = 1_679_184_000.0 - 18.0  # Unix s of its begin, by UTC
HEADED = "{},a_x,a_y,a_z\n".format
START = 1_500_000_000
FINE = "SampleTimeFine"
RTKLIB = "% program   : RTKPOST\n%  {}          latitude(deg) longitude(deg)  height(m)\n".format
GNSS = "2017/07/14 02:40:{n:02}.000   48.{x}   11.5   500.5"


@each_row(
    ("head", "row", "start", "words"),
    [
        (HEADED("TimeStamp (s)"), S, None, "TimeStamp in s"),
        (HEADED("Time stamp"), "1500000000.{n:02},{x},0,9", START, "Time stamp in s"),
        (HEADED("relative_time_ms"), MS, None, "relative_time_ms in ms"),
        (HEADED("epoc (ms)"), "15000000{ms},{x},0,9", None, "epoc in ms"),
        (HEADED("Zeit (s)"), S, None, "Zeit in s"),
        (HEADED("utcTimeMillis"), "1500000{ms},{x},0,9", None, "utcTimeMillis in ms"),
        (HEADED("elapsedRealtimeMillis"), MS, None, "elapsedRealtimeMillis in ms"),
        (HEADED("anything"), "2017-07-14 02:40:{n:02},{x},0,9", START, "anything, since 1970"),
        (HEADED("utc"), "0240{n:02}.00,{x},0,9", None, "utc, of a day that is not in the file"),
        ("sats time lat long\n\n[data]\n", "008 1141{n:02}.00 +3119.1 +58.{x}", None, "time, of a day"),
        (HEADED("stamp"), "20170714_0240{n:02}000000,{x},0,9", START, "stamp, since 1970"),
        (HEADED("GPST"), "302400.{n:02},{x},0,9", None, "of a GPS week that is not in the file"),
        (" Week GPSTime Roll\n (weeks) (sec) (deg)\n", " 2254 3672{n:02}.000 {x}", WEEK_2254 + 367_200, "of GPS"),
        ("", "1500000000.{n:02},{x},0,9", START, "column 1 in s, since 1970 (UTC)"),
        ("", "1500000000{n:03}000,{x},0,9", START, "column 1 in µs, since 1970 (UTC)"),
        ("", "{n},1500000000.{n:02},{x},0,9", START, "column 2 in s, since 1970 (UTC)"),
        ("", "{s} {x} 0 9", None, "column 1 in s, since the start of the device"),
        ("", "10,{n:02};0,{x};0,0;9,8", None, "read with a decimal comma"),
        ("", "2017-07-14 02:40:{n:02}.000,{x},0,9", START, "column 1, since 1970 (UTC)"),
        ("Date,Timestamp,a_x\n", "2017-07-14 02:40:00,1500000000.{n:02},{x}", START, "Timestamp in s"),
        (HEADED("uptime_ms,server_time"), "{ms},2017-07-14 02:40:{n:02},0,0,9", START, "date is that of server_time"),
        (HEADED("time"), "{s},{x},0,9", None, "time in s"),
        ("# Sampling Rate: 20 ms\n" + HEADED("timestamp"), "1{ms},{x},0,9", None, "timestamp in ms"),
        ("Recorder at 50 Hz\nSerial: 12\n----\na x,a y,a z\n", "{x},0,9", None, "counts the rows, 50 Hz"),
        ("# Config: data_rate = 50.0 Hz, range = 4 g\ncount,a_x\n", "{n},{x}", None, "count in samples"),
        ("1500000000.0, 1500000000.0, 1500000000.0\n50.0, 50.0, 50.0\n", "{x},0,9", START, "counts the rows, 50 Hz"),
        (HEADED("Timestamp"), "14-Jul-2017 02:40:{n:02}.000,{x},0,9", START, "Timestamp, since 1970"),
        (HEADED("timestamp (UTC+1)"), "2017-07-14T03:40:{n:02},{x},0,9", START, "of UTC+1 by the heading"),
        (HEADED("timestamp (+0100)"), "2017-07-14T04:40:{n:02}+02:00,{x},0,9", START, "timestamp, since 1970"),
        (HEADED("TimeGps"), "11840352{n:02}000000000,{x},0,9", START - 18, "of GPS, shown as UTC"),
        (HEADED("GPSTime"), "15000000000{n:02}000,{x},0,9", START, "GPSTime in µs, since 1970"),
        (HEADED("Timpstemp"), "{us},{x},0,9", None, "Timpstemp in µs"),
        ("Clock:offsetTime,GPS:dateTimeStamp,a_x\n", "{s},2017-07-14T02:40:00Z,{x}", None, "Clock:offsetTime in s"),
        ("# Start time: 2017-07-14 02:40:00\n" + HEADED("time (s)"), S, START, "the head of the file"),
        (
            "StartTime: 2017-07-14 02:40:00\n" + HEADED("Time(s)"),
            " 02:40:{n:02},{x},0,9",
            START,
            "the head of the file",
        ),
        (
            "StartTime: 2017-07-14 23:59:30\n" + HEADED("Time"),
            "00:00:{n:02},{x},0,9",
            1_500_076_800,
            "head of the file",
        ),
        (HEADED("time"), "2017/07/14/02:40:{n:02}.000,{x},0,9", START, "time, since 1970"),
        ("Date,Time,a_x\n", "14-Jul-17,02:40:{n:02},{x}", START, "Date + Time, since 1970"),
        ("Year,Month,Day,Hours,Minutes,Seconds,a_x\n", "2017,7,14,2,40,{n},{x}", START, "UTC, since 1970"),
        ("date,millis,a_x,lat\n", "140717,1500000000{n:03},{x},48", START, "columns: date"),
        ("GpsCycle,GpsWeek,GpsTow [s],a_x\n", "1,933,441618.{n:02},{x}", START, "of GPS"),
        ("GpsWeek,GpsTow [s],a_x\n", "933,441618.{n:02},{x}", START, "a GPS week of ten bits"),
        (f"// Update Rate: 50.0Hz\nPacketCounter\t{FINE}\ta_x\n", "{n}\t\t{x}", None, "PacketCounter in samples"),
        (f"// Update Rate: 50.0Hz\nPacketCounter\t{FINE}\ta_x\n", "{n}\t{us}\t{x}", None, f"{FINE} in µs"),
        (HEADED("times"), S, None, "times in s"),
        ("sensor.name,ref.t,a_x\n", "1,{s},{x}", None, "ref.t in s"),
        (RTKLIB("GPST"), GNSS, START - 18, "of GPS time by the heading"),
        (RTKLIB("UTC"), GNSS, START, "UTC + time, since 1970"),
        (RTKLIB("JST"), GNSS, START - 32_400, "of JST by the heading"),
        (RTKLIB("GPST"), "1957 441618.{n:02}0 48.{x} 11.5 500.5", START, "GPS week and time of week"),
        (
            "note,Date,Time,a_x,state\n,2017-07-14,02:40:00,B,x\n",
            ",2017-07-14,02:40:{n:02},{x},y",
            START,
            "Date + Time",
        ),
        (
            "----- Data of a logger -----,,,\nSerial: 12,,,\nRate: 50 Hz,,,\n-----,,,\n",
            "{x},0,9,1",
            None,
            "the rows, 50 Hz",
        ),
    ],
)
def test_the_clock_of_a_foreign_table(head: str, row: str, start: float | None, words: str, tmp_path: Path) -> None:
    store = opened(written(head, row, "a.txt", tmp_path))
    assert words in " ".join(store.manifest["time"]["sentences"])
    time = store.exact(1, 0, 1000).time
    assert len(time) == N
    assert (np.diff(time) > 0).all()
    if start is not None:
        assert time[0] == start


@each_row(
    ("head", "row", "words"),
    [
        ("", "{n},{x},0,9", "the unit of column 1 can be s (1 Hz) or ms (1000 Hz)"),
        ("", "{ms},{x},0,9", "the unit of column 1 can be"),
        ("", "{x},{n},0,9", "no column of times"),
        ("", "{x}.5", "one column of numbers"),
        (HEADED("T (°)"), "2{n},{x},0,9", "no column of times"),
        ("# Start: 01/02/2017 10:00\n" + HEADED("stamp"), "01/02/2017 10:{n:02},{x},0,9", "day or the month first"),
    ],
)
def test_what_has_two_readings_is_queried(head: str, row: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=re.escape(words)):
        opened(written(head, row, "a.csv", tmp_path))


@each_row(("head", "factor"), [("time", 1), ("timestamp", 1000), ("time_ms", 1000)])
def test_rows_without_order_have_the_unit_and_rate_of_those_in_order(head: str, factor: int, tmp_path: Path) -> None:
    times = [f"{100 + n / 50:.2f}" if factor == 1 else str(100_000 + 20 * n) for n in range(300)]
    rows = [f"{time},{n % 7},0,9" for n, time in enumerate(times)]
    random.Random(1).shuffle(rows)
    path = tmp_path / "a.csv"
    path.write_text("\n".join([HEADED(head), *rows]) + "\n")
    store = opened(path)
    message = " ".join(store.manifest["time"]["sentences"])
    assert f"in {'s' if factor == 1 else 'ms'}, since the start of the device, 50 Hz" in message
    assert "out of order" in message


def test_rows_without_a_time_are_reported_to_be_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = [f"{100 + n / 50:.2f},302400.{n:02},{n % 7}" if n >= 20 else f",,{n % 7}" for n in range(N)]
    path.write_text("Time [s],GpsTow [s],a_x\n" + "\n".join(rows) + "\n,,\n")
    store = opened(path)
    assert len(store.exact(1, 0, 1000).time) == N - 20
    assert "20 rows have no time and are left out (Time)." in [one["words"] for one in store.manifest["damage"]]


@each_row("row", [GNSS, "1957 441618.{n:02}0 48.{x} 11.5 500.5"])
def test_names_stand_above_their_cells_if_one_name_has_two(row: str, tmp_path: Path) -> None:
    store = opened(written(RTKLIB("GPST"), row, "a.pos", tmp_path))
    assert [info["name"] for info in store.manifest["channels"]] == ["latitude", "longitude", "height"]
    assert store.exact(1, 0, 1).columns[0][0] == 48
    assert store.exact(3, 0, 1).columns[0][0] == 500.5


@each_row(("head", "inner"), [("DataType=Quaternion\nversion=3\n", "wxyz"), ("version=3\n", "0123")])
def test_cells_with_lists_of_numbers_are_a_column_for_each(head: str, inner: str, tmp_path: Path) -> None:
    row = "{s}\t1,{x},0,0.5\t0.1,0.2,0.3,-4e-2"
    store = opened(written(f"{head}endheader\ntime\ttorso_imu\tfemur_imu\n", row, "a.sto", tmp_path))
    path = tmp_path / "cut.sto"
    path.write_bytes((tmp_path / "a.sto").read_bytes()[:-9])  # in the middle of the last row
    assert len(opened(path).exact(1, 0, 1000).time) == N - 1
    torso, femur = store.manifest["channels"]
    assert (torso["name"], femur["name"]) == ("torso_imu", "femur_imu")
    assert [column["name"] for column in torso["columns"]] == [*inner]
    np.testing.assert_array_equal(store.exact(1, 0, 1000).columns[1], np.arange(N) % 7)
    assert not store.manifest["damage"]


def test_lines_may_end_as_on_an_old_mac(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(
        written("  time_s ax ay az\n", "  {s}  {x}  0  9", "a.csv", tmp_path).read_bytes().replace(b"\n", b"\r")
    )
    np.testing.assert_array_equal(opened(path).exact(1, 0, 1000).columns[0], np.arange(N) % 7)


def test_three_columns_are_a_vector_if_they_are_axes(tmp_path: Path) -> None:
    store = opened(written("time_ms,L_cmd,L_tau,L_pos,Mat[1],Mat[2],Mat[3]\n", MS + ",1,2,3", "a.csv", tmp_path))
    assert {info["name"]: info["kind"] for info in store.manifest["channels"]} == {"L": "record", "Mat": "vector"}


def test_the_unit_of_a_table_without_a_heading_can_be_given(tmp_path: Path) -> None:
    path = written("", "{ms},{x},0,9", "a.csv", tmp_path)
    store = decode(open_file(path, "", TableOptions(unit="ms")), tmp_path / "c", protocol_set.all_protocols())
    np.testing.assert_allclose(np.diff(store.exact(1, 0, 1000).time), STEP, atol=1e-6)


@each_row(("head", "rate"), [("", 50.0), ("acc_z\n", 50.0), ("1700000000.0\n64.0\n", 0.0)])
def test_one_column_is_a_table_if_its_rate_is_known(head: str, rate: float, tmp_path: Path) -> None:
    path = written(head, "{x}.5", "BVP.csv", tmp_path)
    store = decode(open_file(path, "", TableOptions(rate=rate)), tmp_path / "c", protocol_set.all_protocols())
    result = store.exact(1, 0, 1000)
    np.testing.assert_array_equal(result.columns[0], np.arange(N) % 7 + 0.5)
    np.testing.assert_allclose(np.diff(result.time), 1 / (rate or 64), atol=1e-6)


@each_row("name", ["a.dat", "a.raw", "a.log", "a.tsv", "a.unheard-of"])
def test_a_table_is_one_whatever_its_suffix(name: str, tmp_path: Path) -> None:
    path = written("", "{s} 0 NaN 30.375 {x}", name, tmp_path)
    assert opened(path).rows(1) == N
    assert probe(path).format == "csv"


def test_words_above_the_sentences_of_a_receiver_do_no_harm(tmp_path: Path) -> None:
    sentences = []
    for second in range(20):
        body = f"GPRMC,1030{second:02}.00,A,4800.0,N,01100.0,E,0.0,0.0,010126,,,A"
        sentences.append(f"${body}*{reduce(xor, body.encode()):02X}\r\n")
    path = tmp_path / "a.log"
    path.write_text("# Name: a receiver\n# Submitter: a person\n# Date: 2026-01-01\n" + "".join(sentences))
    store = opened(path)
    [info] = store.manifest["channels"]
    np.testing.assert_allclose(np.diff(store.exact(info["id"], 0, 100).time), 1.0, atol=1e-6)


def test_columns_of_a_wide_table_are_chosen(tmp_path: Path) -> None:
    names = ",".join(f"c{i}" for i in range(700))
    path = written(f"time_ms,a_x,a_y,a_z,{names}\n", MS + ",1" * 700, "a.csv", tmp_path)
    with pytest.raises(RecordingError, match="has 704 columns; 500 are read") as refused:
        opened(path)
    assert "“* =”" in refused.value.hint
    table = TableOptions(columns={"*": "", "2": "turn (rad/s)", "c7": "seventh"})
    store = decode(open_file(path, "", table), tmp_path / "c", protocol_set.all_protocols())
    assert [info["name"] for info in store.manifest["channels"]] == ["turn", "seventh"]
    np.testing.assert_allclose(np.diff(store.exact(1, 0, 1000).time), STEP, atol=1e-6)
