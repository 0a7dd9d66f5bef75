"""Clocks of recordings of other kinds in the field: stamps of ROS messages, GNSS logs, legacy output of a device."""

from __future__ import annotations

import io
import os
import re
from pathlib import Path

import numpy as np
import pytest
from mcap_ros2.writer import Writer as RosWriter

from imuscope.protocols.embedded.nmea import sentence
from imuscope.protocols.messages.stamps import StampTrack
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.server.commands.decode import time_sentences
from imuscope.server.commands.inspect import inspect_file
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode
from tests.oracles.foreign import ubx
from tests.recordings.mcap_files import OF_ROS
from tests.recordings.tables.field_files import field_file
from tests.support.each_row import each_row

IMU = f"""std_msgs/Header header
geometry_msgs/Vector3 angular_velocity
{OF_ROS}"""
NS = 1_500_000_000_000_000_000
STEP = 10_000_000
N = 400


def opened(path: Path, folder: Path) -> ColumnStore:
    return decode(open_file(path), folder / "columns", protocol_set.all_protocols())


def columns_of(store: ColumnStore, name: str) -> list[np.ndarray]:
    info = next(one for one in store.manifest["channels"] if one["name"].endswith(name))
    rows = store.exact(info["id"], 0, 10 * N)
    return [rows.time, rows.arrival, *rows.columns]


def bag(path: Path, stamps: list[int], late: list[int]) -> Path:
    """A recording of stamped messages that arrive at 100 Hz."""
    return log_of(path, stamps, [NS + n * STEP + delay for n, delay in enumerate(late)])


def log_of(path: Path, stamps: list[int], logged: list[int], topics: list[str] | None = None) -> Path:
    """A recording with these log times; it was published long before, which means nothing."""
    with path.open("wb") as file:
        writer = RosWriter(file)
        schema = writer.register_msgdef("sensor_msgs/msg/Imu", IMU)
        for n, (stamp, time) in enumerate(zip(stamps, logged, strict=True)):
            message = {
                "header": {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": "imu"},
                "angular_velocity": {"x": 0.1 * n, "y": 0.0, "z": 0.0},
            }
            topic = topics[n] if topics is not None else "/imu"
            writer.write_message(topic, schema, message, log_time=time, publish_time=1)
        writer.finish()
    return path


def test_stamps_that_are_the_uptime_give_the_spacing(tmp_path: Path) -> None:
    late = [n % 7 * 200_000 for n in range(N)]
    store = opened(bag(tmp_path / "a.mcap", [10**9 + n * STEP for n in range(N)], late), tmp_path)
    time, arrival, *_ = columns_of(store, "angular_velocity")
    np.testing.assert_allclose(np.diff(time), 0.01, atol=1e-6)
    assert abs(time - arrival).max() < 0.002
    _, _, stamp = columns_of(store, ".stamp")
    np.testing.assert_allclose(stamp, 1 + np.arange(N) / 100, atol=1e-9)
    [event] = [one for one in store.manifest["events"] if one["data"].get("reason") == "remark"]
    assert "behind the time of arrival" in event["text"]
    assert "“stamp”" in event["text"]


def test_stamps_that_go_back_begin_a_segment(tmp_path: Path) -> None:
    """A recording whose clock was set back by 2 s: 51 samples had one time, and 99 had none."""
    stamps = [NS + n * STEP - (2 * 10**9 if n >= 250 else 0) for n in range(N)]
    store = opened(bag(tmp_path / "a.mcap", stamps, [300_000] * N), tmp_path)
    time, *_ = columns_of(store, "angular_velocity")
    np.testing.assert_allclose(np.diff(time), 0.01, atol=1e-6)
    axis, event = [one for one in store.manifest["events"] if one["kind"] == "clock"]
    assert axis["text"] == "The time axis is the spacing of the stamps, placed by the arrival of each message."
    assert event["data"] == {"kind": "jump", "by_ns": -2_000_000_000}
    assert store.manifest["segments"] == {"1": [pytest.approx(1_500_000_002.5, abs=0.001)]}
    _, _, stamp = columns_of(store, ".stamp")
    assert np.diff(stamp).min() == pytest.approx(-1.99, abs=1e-6)


@each_row(
    ("first", "ahead_s"),
    [(NS, 18.0), (10**10, 3.0), (10**10, 18.0), (NS, 100.0)],
    ids=["UTC less GPS", "uptime", "uptime, more", "far ahead"],
)
def test_stamps_that_go_ahead_begin_a_segment(first: int, ahead_s: float, tmp_path: Path) -> None:
    """Half of the samples had the arrival, and nothing said so."""
    stamps = [first + n * STEP + (round(ahead_s * 1e9) if n >= 200 else 0) for n in range(N)]
    store = opened(bag(tmp_path / "a.mcap", stamps, [300_000] * N), tmp_path)
    time, *_ = columns_of(store, "angular_velocity")
    np.testing.assert_allclose(np.diff(time), 0.01, atol=1e-6)
    [event] = [one for one in store.manifest["events"] if one["kind"] == "clock" and one["level"] == "warning"]
    assert event["data"] == {"kind": "jump", "by_ns": round(ahead_s * 1e9)}
    assert store.manifest["segments"] == {"1": [pytest.approx(1_500_000_002.0, abs=0.001)]}
    _, _, stamp = columns_of(store, ".stamp")
    assert np.diff(stamp).max() == pytest.approx(ahead_s + 0.01, abs=1e-6)


@each_row(
    ("stamps", "words"),
    [
        ([NS] * N, "The stamps of /imu stand still"),
        ([NS + n * STEP // 10**9 * 10**9 for n in range(N)], "The stamps of /imu stand still"),
        ([NS + (n if n < 200 else 199) * STEP for n in range(N)], "Some stamps of /imu stand still"),
    ],
    ids=["all", "whole seconds", "from the middle"],
)
def test_stamps_that_stand_still_give_no_time(stamps: list[int], words: str, tmp_path: Path) -> None:
    """All samples had one time, and nothing said so."""
    store = opened(bag(tmp_path / "a.mcap", stamps, [300_000] * N), tmp_path)
    time, arrival, *_ = columns_of(store, "angular_velocity")
    axis = np.where(np.isfinite(time), time, arrival)
    np.testing.assert_allclose(np.diff(axis), 0.01, atol=0.001)
    [event] = [one for one in store.manifest["events"] if one["data"].get("reason") == "remark"]
    assert event["text"].startswith(words)


@each_row("block", [1, 7, 64, N])
def test_a_step_of_the_stamps_is_one_however_the_messages_come(block: int) -> None:
    arrivals = NS + np.arange(N) * STEP
    stamps = arrivals - 300_000 - np.where(np.arange(N) >= 200, NS, 0)  # the time of the host, then the uptime
    track, steps, times = StampTrack(), [], []
    for begin in range(0, N, block):
        some = track.times(stamps[begin : begin + block], arrivals[begin : begin + block])
        steps += [step.by_ns for step in some.steps]
        times += np.where(some.used, some.time_ns, arrivals[begin : begin + block]).tolist()
    assert steps == [-NS]
    np.testing.assert_allclose(np.diff(times), STEP, atol=400_000)


def test_a_first_message_that_is_late_is_no_step() -> None:
    arrivals = NS + np.arange(N) * STEP
    late = np.where(np.arange(N), arrivals, NS + 2_000_000_000)
    some = StampTrack().times(arrivals - NS + 10**9, late)
    assert not some.steps
    np.testing.assert_array_equal(np.diff(some.time_ns[1:]), STEP)


def set_back(n: int) -> int:
    return NS + n * STEP - (2 * 10**9 if n >= 250 else 0)


@each_row(
    ("stamps", "size", "kind"),
    [
        ([set_back(n) for n in range(N)], -1.991, "jump"),  # the clock of both
        ([0] * N, -1.99, "log"),  # there are no stamps
        ([10**9 + n * STEP for n in range(N)], -1.99, "log"),  # uptime
        ([NS + n * STEP for n in range(N)], -1.99, "log"),  # of another host, whose clock is right
    ],
    ids=["both", "unstamped", "uptime", "stamped"],
)
def test_log_times_that_go_back_begin_a_segment(stamps: list[int], size: float, kind: str, tmp_path: Path) -> None:
    store = opened(log_of(tmp_path / "a.mcap", stamps, [set_back(n) for n in range(N)]), tmp_path)
    time, arrival, *_ = columns_of(store, "angular_velocity")
    axis = np.where(np.isfinite(time), time, arrival)
    assert np.diff(axis).min() > 0
    assert np.diff(axis).max() < 0.011
    assert np.diff(arrival).min() > 0
    steps = [one for one in store.manifest["events"] if one["data"].get("kind") in ("jump", "log")]
    [event] = steps
    assert event["data"]["kind"] == kind
    assert event["data"]["by_ns"] / 1e9 == pytest.approx(size, abs=0.002)
    assert store.manifest["segments"] == {"1": [pytest.approx(axis[250], abs=0.02)]}


def test_topics_that_were_written_one_after_the_other_are_no_step(tmp_path: Path) -> None:
    times = [NS + n % 200 * STEP for n in range(N)]
    path = log_of(tmp_path / "a.mcap", times, times, ["/a"] * 200 + ["/b"] * 200)
    store = opened(path, tmp_path)
    assert store.manifest["segments"] == {}
    for name in ("/a.angular_velocity", "/b.angular_velocity"):
        np.testing.assert_allclose(columns_of(store, name)[0], NS / 1e9 + np.arange(200) / 100, atol=1e-6)


def test_a_stamp_of_zero_is_the_time_of_the_log(tmp_path: Path) -> None:
    store = opened(field_file("c21_header_stamp_zero.mcap"), tmp_path)
    time, *_ = columns_of(store, "angular_velocity")
    np.testing.assert_allclose(np.diff(time), 0.01, atol=1e-6)


def test_the_uptime_of_the_field_gives_the_spacing(tmp_path: Path) -> None:
    store = opened(field_file("c22_stamp_is_uptime.mcap"), tmp_path)
    time, *_ = columns_of(store, "angular_velocity")
    np.testing.assert_allclose(np.diff(time), 0.01, atol=1e-6)
    assert columns_of(store, ".stamp")[2][0] == 1.0


def test_an_unknown_orientation_is_left_out_and_messages_are_listed(tmp_path: Path) -> None:
    path = field_file("c20_imu_without_orientation.mcap")
    store = opened(path, tmp_path)
    assert not [one for one in store.manifest["channels"] if one["kind"] == "quaternion"]
    out = io.StringIO()
    inspect_file(path, out)
    assert out.getvalue().count("/imu/data_raw") == N


def test_the_legacy_output_is_named_with_the_remedy(tmp_path: Path) -> None:
    store = opened(field_file("c30_legacy_mtdata.bin"), tmp_path)
    [event] = [one for one in store.manifest["events"] if one["data"].get("reason") == "remark"]
    assert "legacy" in event["text"]
    assert "SetOutputConfiguration" in event["text"]


def test_all_covariances_of_a_pose_are_decoded(tmp_path: Path) -> None:
    store = opened(field_file("c31_ros_covariance.raw"), tmp_path)
    _, _, of_week, *columns = columns_of(store, "DID_ROS_COVARIANCE_POSE_TWIST")
    assert (len(of_week), len(columns)) == (20, 42)
    np.testing.assert_allclose(columns, 1e-4, rtol=1e-6)


def test_a_counter_that_wraps_within_two_kinds_of_messages_is_continued(tmp_path: Path) -> None:
    store = opened(field_file("c32_idtp_wrap.bin"), tmp_path)
    spans = {}
    for one in store.manifest["channels"]:
        time = store.exact(one["id"], 0, 10 * N).time
        spans[round(float(np.median(np.diff(time))), 4)] = float(time[-1] - time[0])
    assert spans == {0.01: pytest.approx(3.99, abs=1e-3), 0.04: pytest.approx(3.96, abs=1e-3)}


def sentences(seconds: list[float], date: str = "010126") -> bytes:
    """GGA and RMC of a receiver at some times of day."""
    lines = []
    for second in seconds:
        clock = f"{int(second) // 3600 % 24:02}{int(second) // 60 % 60:02}{second % 60:05.2f}"
        lines.append(f"GNGGA,{clock},4800.0000,N,01100.0000,E,4,12,0.8,500.0,M,47.0,M,1.0,0001")
        lines.append(f"GNRMC,{clock},A,4800.0000,N,01100.0000,E,0.10,90.0,{date},,,R")
    return b"".join(map(sentence, lines))


def test_a_log_of_sentences_has_their_times(tmp_path: Path) -> None:
    """A log of 20 s was 0.3 s long, dated by the file, without a time."""
    path = tmp_path / "gnss.nmea"
    path.write_bytes(sentences([37_800.0 + n for n in range(20)]))
    store = opened(path, tmp_path)
    for name in ("GNGGA", "GNRMC"):
        time, arrival, *_ = columns_of(store, name)
        np.testing.assert_allclose(time, 1_767_263_400 + np.arange(20), atol=1e-6)
        np.testing.assert_array_equal(time, arrival)


def test_a_log_of_navigation_messages_has_their_times(tmp_path: Path) -> None:
    path = tmp_path / "gnss.ubx"
    solutions = []
    for n in range(50):
        of_week = (302_400_000 + 100 * n).to_bytes(4, "little")
        date = (2026).to_bytes(2, "little") + bytes([1, 7, 11, 59, 42 + n // 10])
        nano = (n % 10 * 100_000_000).to_bytes(4, "little")
        solutions.append(
            ubx(1, 7, of_week + date + bytes([7, 0, 0, 0, 0]) + nano + bytes(72)) + ubx(1, 5, of_week + bytes(28))
        )
    path.write_bytes(b"".join(solutions))
    store = opened(path, tmp_path)
    for one in store.manifest["channels"]:
        time = store.exact(one["id"], 0, 100).time
        np.testing.assert_allclose(time, 1_767_787_182 + np.arange(50) / 10, atol=1e-6)


@each_row(
    ("week", "begin"),
    [(1694, 1_340_829_196.0), (2400, 1_767_817_993.0)],  # GPS is 15 s, then 18 s ahead of UTC
)
def test_messages_of_vectornav_are_dated_by_their_week(week: int, begin: float, tmp_path: Path) -> None:
    lines = []
    for n in range(50):
        lines.append(
            f"VNINS,{333_811 + n / 10 - 600:.6f},{week},0004,9.5,-4.7,-0.2,32.9,-96.7,179.5,0.1,0,0,7.8,1.6,0.2"
        )
        lines.append(f"VNACC,{n},0,-9.8")
    path = tmp_path / "vectornav.log"
    path.write_bytes(b"".join(sentence(line) for line in lines))
    store = opened(path, tmp_path)
    time = columns_of(store, "VNINS")[0]
    np.testing.assert_allclose(time, begin + np.arange(50) / 10, atol=1e-6)
    others = columns_of(store, "Acceleration")[1]  # between them, by the pace of the line
    np.testing.assert_allclose(others, begin + np.arange(50) / 10, atol=0.11)


def test_midnight_is_continued_where_no_sentence_has_a_date(tmp_path: Path) -> None:
    path = tmp_path / "gnss.nmea"
    lines = sentences([(86_390 + n) % 86_400 for n in range(20)]).splitlines(keepends=True)
    path.write_bytes(b"".join(line for line in lines if b"GGA" in line))
    time, *_ = columns_of(opened(path, tmp_path), "GNGGA")
    np.testing.assert_allclose(np.diff(time), 1.0, atol=1e-6)


@each_row(
    ("name", "messages", "begin", "dated_by"),
    [
        ("gnss.nmea", "GGA", 1_767_225_600 + 81_000.5, "the file's last change"),  # 2026-01-01, the day before
        ("log_20251224_120000.nmea", "GGA", 1_766_534_400 + 81_000.5, "the file's name"),
        ("gnss.ubx", "ATT", 1_766_880_000 + 81_000.5 - 18.0, "the file's last change"),  # the week from 2025-12-28
    ],
)
def test_times_without_a_date_are_of_the_day_or_week_of_the_file(
    name: str, messages: str, begin: float, dated_by: str, tmp_path: Path
) -> None:
    """A log ended when its file was last changed, at another time of day than its sentences say."""
    path = tmp_path / name
    lines = sentences([81_000.5 + n for n in range(20)]).splitlines(keepends=True)
    frames = [ubx(1, 5, (81_000_500 + 1000 * n).to_bytes(4, "little") + bytes(28)) for n in range(20)]
    path.write_bytes(b"".join(frames if messages == "ATT" else [line for line in lines if b"GGA" in line]))
    os.utime(path, (1_767_323_400, 1_767_323_400))  # 2026-01-02 03:10
    store = opened(path, tmp_path)
    time, *_ = columns_of(store, "NAV-ATT" if messages == "ATT" else "GNGGA")
    np.testing.assert_allclose(time, begin + np.arange(20), atol=1e-6)
    period = "week" if messages == "ATT" else "day"
    assert store.manifest["time"]["sentences"] == [
        f"The time axis is the time of {period} in the messages of the GNSS receiver.",
        f"Its date is that of {dated_by}.",
    ]


def test_a_receiver_that_is_set_back_was_right_before(tmp_path: Path) -> None:
    path = tmp_path / "gnss.nmea"
    path.write_bytes(sentences([37_800.0 + n - (5 if n >= 10 else 0) for n in range(20)]))
    time, *_ = columns_of(opened(path, tmp_path), "GNGGA")
    np.testing.assert_allclose(time, 1_767_263_400 + np.arange(20), atol=1e-6)


def test_the_clock_of_a_capture_and_its_date_are_reported(tmp_path: Path) -> None:
    store = opened(field_file("c32_idtp_wrap.bin"), tmp_path)
    texts = ["The time axis is the clock of the device.", "Its date is that of the file's last change."]
    assert time_sentences(store) == store.manifest["time"]["sentences"] == texts


@each_row("name", ["gnss.nmea", "gnss.txt", "gnss.csv"])
def test_sentences_are_read_whatever_the_file_is_called(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(sentences([37_800.0 + n for n in range(20)]))
    time, *_ = columns_of(opened(path, tmp_path), "GNGGA")
    np.testing.assert_allclose(time, 1_767_263_400 + np.arange(20), atol=1e-6)


@each_row("name", ["gnss.nmea", "gnss.csv"])
def test_sentences_without_checksums_are_read_with_a_remark(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(re.sub(rb"\*..\r", b"", sentences([37_800.0 + n for n in range(20)])))
    store = opened(path, tmp_path)
    time, *_ = columns_of(store, "GNGGA")
    np.testing.assert_allclose(time, 1_767_263_400 + np.arange(20), atol=1e-6)
    assert [one["words"] for one in store.manifest["damage"]] == [
        "Its sentences have no checksums: damage in them cannot be found."
    ]


@each_row(
    ("name", "words"),
    [
        ("gnss.nmea", "40 sentences of NMEA"),
        ("gnss.csv", "40 sentences of NMEA"),
        ("gnss.ubx", "50 frames of UBX"),
        ("mti.bin", "50 frames of Xbus"),
    ],
)
def test_frames_with_a_bad_checksum_are_named(name: str, words: str, tmp_path: Path) -> None:
    """It was no format that imuscope knows, or a table without times."""
    path = tmp_path / name
    match name:
        case "gnss.ubx":
            data = b"".join(ubx(1, 7, bytes([n, *bytes(91)]))[:-1] + b"\x01" for n in range(50))
        case "mti.bin":
            data = b"".join(bytes([0xFA, 0xFF, 0x36, 5, 0x10, 0x20, 2, 0, n, 0]) for n in range(50))
        case _:
            data = re.sub(rb"\*..\r", b"*0X\r", sentences([37_800.0 + n for n in range(20)])).replace(b"*0X", b"*00")
    path.write_bytes(data + b"\n")
    with pytest.raises(RecordingError, match=rf"begins with {words}, all with a bad checksum"):
        open_file(path)


def test_the_log_of_the_field_has_its_times(tmp_path: Path) -> None:
    time, *_ = columns_of(opened(field_file("c16_gnss.nmea"), tmp_path), "GNGGA")
    np.testing.assert_allclose(time, 1_767_263_400 + np.arange(20), atol=1e-6)


def test_a_log_that_goes_back_begins_a_segment(tmp_path: Path) -> None:
    path = tmp_path / "gnss.nmea"
    path.write_bytes(sentences([37_800.0 + n for n in range(20)]) + sentences([37_000.0 + n for n in range(20)]))
    store = opened(path, tmp_path)
    time, *_ = columns_of(store, "GNGGA")
    np.testing.assert_allclose(np.diff(time), 1.0, atol=1e-6)
    axis, event = [one for one in store.manifest["events"] if one["kind"] == "clock"]
    assert "GNSS" in axis["text"]
    assert event["data"] == {"kind": "jump", "by_ns": -819_000_000_000}
    assert store.manifest["segments"] == {"1": [pytest.approx(1_767_263_420.0)]}
