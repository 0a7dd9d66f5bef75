"""Logs of CAN frames: files of python-can and can-utils, every kind of times, other identifiers, and damage."""

import gzip
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from imuscope.protocols.can.lines import LINE, scan
from imuscope.protocols.framing.stream_buffer import QUANTITIES
from imuscope.protocols.native.kernels import plain
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.readers.formats.can_kernels import ASC, LOG, TERMINAL, read_lines, write_lines
from imuscope.recordings.tables.options import TableOptions
from tests.recordings.readers.formats.opening import damage_of, opened, rows_of, survives_damage
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

GOLDEN = ROOT / "tests" / "golden" / "can"
BEGIN = 1_767_225_600.0
GROUPS = 200
WRITTEN = 1_790_000_000


def golden(name: str) -> bytes:
    return gzip.decompress((GOLDEN / f"{name}.gz").read_bytes())


def written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    os.utime(path, (WRITTEN, WRITTEN))
    return path


def remarks(store: ColumnStore) -> str:
    return " ".join(one["text"] for one in store.manifest["events"])


def changed(data: bytes, change: object) -> bytes:
    """A log with other times: `change` gives each in µs, of the row and the old one; None for none."""
    lines = []
    for row, line in enumerate(data.splitlines()):
        match = re.match(rb"\((\d+)\.(\d+)\)(.*)", line)
        assert match is not None
        now = change(row, int(match[1]) * 1_000_000 + int(match[2]))  # type: ignore[operator]
        lines.append(b"(%d.%06d)%s" % (now // 1_000_000, now % 1_000_000, match[3]) if now is not None else match[3])
    return b"\n".join(lines) + b"\n"


@each_row("name", ["mti.log", "mti.asc", "mti_29_bits.log", "mti_terminal.txt", "mti_can_utils.asc"])
def test_files_of_others_have_the_values_that_were_encoded(name: str, tmp_path: Path) -> None:
    store = opened(written(tmp_path / name, golden(name)), tmp_path)
    expected = json.loads((GOLDEN / "values.json").read_text())
    for quantity, message, lsb in (
        ("Quaternion", "Quaternion", 1 / 32_767),
        ("EulerAngles", "EulerAngles", 2.0**-7),
        ("RateOfTurn", "RateOfTurn", 2.0**-9),
        ("Acceleration", "Acceleration", 2.0**-8),
    ):
        rows = rows_of(store, quantity)
        assert len(rows.time) == GROUPS
        values = np.stack(rows.columns, axis=1)[::20]
        if quantity == "RateOfTurn":  # shown in °/s, as that of MTData2
            values = np.radians(values)
        np.testing.assert_allclose(values, [list(one[message].values()) for one in expected], atol=0.51 * lsb)
        np.testing.assert_allclose(rows.time, BEGIN + np.arange(GROUPS) / 100, atol=2e-3)
        np.testing.assert_allclose(np.diff(rows.time), 0.01, atol=1e-6)
    for quantity, values in (
        ("StatusWord", [0x0080_0007]),
        ("MagneticField", [0.5, -0.25, 0.75]),
        ("Temperature", [-12.5]),
        ("BaroPressure", [101_325.25]),
        ("AltitudeEllipsoid", [-3.5]),
        ("VelocityXYZ", [1.25, -20.5, 0.0]),
        ("LatLon", [48.0, -11.5]),
    ):
        np.testing.assert_allclose([column[0] for column in rows_of(store, quantity).columns], values, atol=1e-7)
    infos = {one["name"]: one for one in store.manifest["channels"]}
    assert (infos["Quaternion"]["kind"], infos["Quaternion"]["frame"]) == ("quaternion", "ENU from body")
    assert infos["Acceleration"]["unit"] == "m/s²"
    assert store.manifest["figures"]["1"]["lost"] == 0
    assert store.manifest["timed"]
    assert "200 frames of 1 other identifier left out: " in damage_of(store)
    assert "1 request, 1 error frame" in damage_of(store)
    assert ("Identifiers from 19FF0000 on" in remarks(store)) == (name == "mti_29_bits.log")
    assert "ENU" in remarks(store)


def test_a_packed_log_is_read(tmp_path: Path) -> None:
    store = opened(written(tmp_path / "mti.log.gz", gzip.compress(golden("mti.log"))), tmp_path)
    assert len(rows_of(store, "Acceleration").time) == GROUPS


@each_row(
    ("name", "change", "origin", "words"),
    [
        ("1970", lambda row, us: us, BEGIN, ""),
        ("zero", lambda row, us: us - 1_767_225_600_000_000, BEGIN, "since its start. Their date is that of the UTC"),
        ("delta", None, BEGIN, "since the line before; they are added up"),
        ("none", lambda row, us: None, None, "no times: the clock of the device gives the spacing"),
    ],
    ids=["1970", "zero", "delta", "none"],
)
def test_every_kind_of_times_gives_the_spacing(
    name: str, change: object, origin: float | None, words: str, tmp_path: Path
) -> None:
    """Those of candump -t a, z and d, and of candump without -t."""
    before = [0]

    def delta(row: int, us: int) -> int:
        passed = us - (before[0] or us)
        before[0] = us
        return passed

    data = changed(golden("mti_terminal.txt"), change or delta)
    store = opened(written(tmp_path / "a.txt", data), tmp_path)
    rows = rows_of(store, "Acceleration")
    np.testing.assert_allclose(np.diff(rows.time), 0.01, atol=2e-6)
    assert words in damage_of(store)
    if origin is not None:
        np.testing.assert_allclose(rows.time[0], origin, atol=2e-3)
    else:
        assert rows.time[0] == pytest.approx(WRITTEN, abs=1)
        assert "the file's last change" in damage_of(store)
    assert store.manifest["timed"] == (name != "none")


def test_local_times_are_reported_as_such(tmp_path: Path) -> None:
    """Those of candump -t A."""
    lines = [b" (2026-01-01 00:00:%09.6f)  can0  034   [6]  00 00 00 00 09 CF" % (n / 100) for n in range(50)]
    store = opened(written(tmp_path / "a.txt", b"\n".join(lines) + b"\n"), tmp_path)
    np.testing.assert_allclose(rows_of(store, "Acceleration").arrival, BEGIN + np.arange(50) / 100, atol=1e-6)
    assert "local times (candump -t A)" in damage_of(store)


def test_flags_text_and_carriage_returns_are_no_obstacle(tmp_path: Path) -> None:
    """Lines of candump -x -a, and a file that went through Windows."""
    lines = [b" (%.6f)  can0  RX - -  034   [6]  00 00 00 00 09 CF   '......'\r" % (BEGIN + n) for n in range(9)]
    store = opened(written(tmp_path / "a.log", b"\n".join(lines)), tmp_path)
    assert len(rows_of(store, "Acceleration").time) == 9
    assert damage_of(store) == ""


def test_can_fd_is_left_out_and_reported(tmp_path: Path) -> None:
    lines = [
        b"(%.6f) can0 034#0000000009CF\n(%.6f) can0 035##1000000000000\n" % (BEGIN + n, BEGIN + n) for n in range(4)
    ]
    store = opened(written(tmp_path / "a.log", b"".join(lines)), tmp_path)
    assert damage_of(store) == "Left out: 4 frames of CAN FD."


def test_each_bus_is_a_device(tmp_path: Path) -> None:
    log = golden("mti.log")
    both = b"".join(
        one + other for one, other in zip(lines_of(log), lines_of(log.replace(b"can0", b"can1")), strict=True)
    )
    store = opened(written(tmp_path / "a.log", both), tmp_path)
    assert [one["name"] for one in store.manifest["devices"]] == ["a can0", "a can1"]
    infos = [one for one in store.manifest["channels"] if one["name"] == "Acceleration"]
    assert {one["device"] for one in infos} == {"1", "2"}
    assert [store.rows(one["id"]) for one in infos] == [GROUPS, GROUPS]


def lines_of(data: bytes) -> list[bytes]:
    return data.splitlines(keepends=True)


def test_identifiers_can_be_named(tmp_path: Path) -> None:
    data = golden("mti.log").replace(b" 034#", b" 5A4#").replace(b" 005#", b" 5A5#")
    path = written(tmp_path / "a.log", data)
    columns = {"5A4": "acceleration", "0x5a5": "SampleTimeFine", "3A5": ""}
    store = opened(path, tmp_path, TableOptions(columns=columns))
    assert len(rows_of(store, "Acceleration").time) == GROUPS
    assert "5A4 Acceleration" in remarks(store)
    with pytest.raises(RecordingError, match="no such message"):
        open_file(path, "", TableOptions(columns={"5A4": "Accelerator"}))


@each_row(
    ("lines", "words"),
    [
        (
            b"(1767225600.000000) can0 3A5#0102\n(1767225600.1) can0 34#00\n",
            "1 frame and 1 identifier (can0 3A5), none",
        ),
        (b"(1767225600.000000) can0 021#0102030405060708\n" * 20, "none of a known device"),
        (b"(1767225600.000000) can0 034#0102\n" * 20, "none of a known device"),
        (b"  can0  034   [6]  00 00 00 00 09 CF\n" * 20, "has no times, and no clock of a device"),
        (b"date Thu Jan 1 00:00:00 2026\nbase dec  timestamps absolute\n", "decimal numbers"),
        (b"date Thu Jan 1 00:00:00 2026\nbase hex  timestamps absolute\n", "no frames of CAN"),
    ],
)
def test_what_is_not_known_is_answered_with_what_it_is(lines: bytes, words: str, tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as refused:
        open_file(written(tmp_path / "a.log", lines))
    assert words in refused.value.message
    assert refused.value.hint


def test_a_sample_time_in_microseconds_is_found_by_the_times_of_the_log(tmp_path: Path) -> None:
    def ticks(match: re.Match[bytes]) -> bytes:
        return b" 005#%08X" % ((int(match[1], 16) - 0xFFFFEC78) % 2**32 * 100)

    data = re.sub(rb" 005#(\w{8})", ticks, golden("mti.log"))
    store = opened(written(tmp_path / "a.log", data), tmp_path)
    np.testing.assert_allclose(np.diff(rows_of(store, "Acceleration").time), 0.01, atol=1e-6)
    assert "SampleTimeFine counts 1 µs, by the times of the log." in remarks(store)
    assert next(one for one in store.manifest["channels"] if one["name"] == "SampleTimeFine")["unit"] == "µs"


def test_lost_groups_are_counted(tmp_path: Path) -> None:
    lines = [one for one in lines_of(golden("mti.log")) if not b"(1767225600.5" <= one[:14] < b"(1767225600.7"]
    store = opened(written(tmp_path / "a.log", b"".join(lines)), tmp_path)
    assert store.manifest["figures"]["1"]["lost"] == 20


def test_a_clock_of_the_host_that_was_set_back_changes_no_spacing(tmp_path: Path) -> None:
    half = 1_767_225_601_000_000
    data = changed(golden("mti.log"), lambda row, us: us - (3_000_000 if us >= half else 0))
    store = opened(written(tmp_path / "a.log", data), tmp_path)
    rows = rows_of(store, "Acceleration")
    np.testing.assert_allclose(np.diff(rows.time), 0.01, atol=1e-3)
    assert "The clock of the log goes back by 2.9" in damage_of(store)
    assert store.manifest["segments"] == {}


def test_without_a_clock_of_the_device_a_step_back_begins_a_segment(tmp_path: Path) -> None:
    half = 1_767_225_601_000_000
    data = changed(golden("mti.log"), lambda row, us: us - (3_000_000 if us >= half else 0))
    data = b"".join(one for one in lines_of(data) if b" 005#" not in one and b" 007#" not in one)
    store = opened(written(tmp_path / "a.log", data), tmp_path)
    rows = rows_of(store, "Acceleration")
    assert np.diff(rows.arrival).min() > 0
    assert store.manifest["segments"] == {"1": [pytest.approx(BEGIN + 1, abs=0.02)]}
    [event] = [one for one in store.manifest["events"] if one["data"].get("kind") == "log"]
    assert event["text"].startswith("The clock of the log was set back by")


def test_a_stray_time_is_left_out_and_a_pause_of_years_is_quick(tmp_path: Path) -> None:
    years = 20 * 365 * 86_400_000_000
    data = changed(golden("mti.log"), lambda row, us: us + (years if row == 600 else 0) + (years if row > 900 else 0))
    store = opened(written(tmp_path / "a.log", data), tmp_path)
    assert "1 line has no frame and was left out." in damage_of(store)
    assert store.manifest["ended"] - store.manifest["started"] == pytest.approx(years / 1e6, abs=5)
    assert len(rows_of(store, "Acceleration").time) in (GROUPS - 1, GROUPS)


@each_row("name", ["mti.log", "mti.asc", "mti_terminal.txt"])
def test_damage_does_no_harm(name: str, tmp_path: Path) -> None:
    data = b"".join(lines_of(golden(name))[:300])
    opens, _ = survives_damage(written(tmp_path / name, data), tmp_path)
    assert opens > 10


@each_row(("name", "form"), [("mti.log", LOG), ("mti_terminal.txt", TERMINAL), ("mti.asc", ASC)])
def test_the_loops_give_the_same_in_plain_python(name: str, form: int) -> None:
    data = np.frombuffer(b"".join(lines_of(golden(name))[:40]) + b"(1.5) x\n\xff(2026-01-0\n 0.5 1 Z\n", np.uint8)
    tables = [np.zeros((LINE, 64), np.int64) for _ in range(2)]
    counts = [read(data, 0, form, table) for read, table in zip((read_lines, plain(read_lines)), tables, strict=True)]
    assert counts[0] == counts[1]
    np.testing.assert_array_equal(*tables)
    frames = np.ascontiguousarray(tables[0][:, : counts[0][0]])
    written_by = []
    for write in (write_lines, plain(write_lines)):
        out, ends = np.zeros(5000, np.uint8), np.zeros(frames.shape[1], np.int64)
        written_by.append(bytes(out[: write(data, frames, np.arange(frames.shape[1]) * 1_000_001, out, ends)]))
    assert written_by[0] == written_by[1]
    lines = np.frombuffer(written_by[0] + b"(1.5) x\n#CAN {}\n", np.uint8)
    tables = [np.zeros((QUANTITIES, 64), np.int64) for _ in range(2)]
    ends_of = [one(lines, 0, True, table) for one, table in zip((scan, plain(scan)), tables, strict=True)]
    assert ends_of[0] == ends_of[1]
    np.testing.assert_array_equal(*tables)
    assert ends_of[0][0] == frames.shape[1] + 2
