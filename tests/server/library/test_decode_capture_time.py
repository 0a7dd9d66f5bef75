"""Times of captures without arrival times follow the device's clock: spacing, length, pauses, date."""

from __future__ import annotations

import csv
import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from pyarrow.parquet import read_table

from imuscope.protocols.idtp.frames import build as idtp
from imuscope.protocols.isb.frames import DATA
from imuscope.protocols.isb.frames import build as isb
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.xbus.frames import build as xbus
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.exporters import ExportRequest, export
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.probe import probe
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode
from tests.support.each_row import each_row

UTC_2026 = 1_767_225_600  # 2026-01-01T00:00:00Z


def opened(path: Path, data: bytes, modified: float = 1.7e9) -> ColumnStore:
    path.write_bytes(data)
    os.utime(path, (modified, modified))
    return decode(open_file(path), path.with_name(f"{path.name}.store"), protocol_set.all_protocols())


def times(store: ColumnStore, name: str, device: str = "") -> np.ndarray:  # type: ignore[type-arg]
    """Device times of a channel, s after the first."""
    infos = [one for one in store.manifest["channels"] if one["name"] == name and device in ("", one["device"])]
    assert len(infos) == 1
    return store.exact(infos[0]["id"], 0, store.rows(infos[0]["id"])).time


def clock_events(store: ColumnStore) -> list[str]:
    return [event["text"] for event in store.manifest["events"] if event["kind"] == "clock"]


def sample(counter: int, fine: int, more: bytes = b"") -> bytes:
    items = struct.pack(">HBHHBI", 0x1020, 2, counter & 0xFFFF, 0x1060, 4, fine)
    return xbus(0x36, items + (more or struct.pack(">HB3f", 0x4020, 12, 0.0, 0.0, 9.81)))


def solution(counter: int, fine: int) -> bytes:
    pvt = bytearray(94)
    pvt[20] = 3
    return sample(counter, fine, struct.pack(">HB", 0x7010, 94) + bytes(pvt))


@each_row("place", [0, 24])  # of a solution in each 25 samples: with 24 one falls just before 2 s
@each_row("age_ms", [0, 50, 80, 250])
def test_an_older_gnss_solution_affects_no_other_time(tmp_path: Path, age_ms: int, place: int) -> None:
    """Regression: if the first 2 s of a capture ended with a solution, they ran at half speed, and 12 s took 11."""
    frames = []
    for i in range(1200):
        frames.append(sample(len(frames), 70_000 + 100 * i))
        if i % 25 == place:
            frames.append(solution(len(frames), 70_000 + 100 * i - 10 * age_ms))
    store = opened(tmp_path / "a.bin", b"".join(frames))
    np.testing.assert_allclose(np.diff(times(store, "Acceleration")), 0.01, atol=1e-6)
    np.testing.assert_allclose(np.diff(times(store, "GnssPvtData")), 0.25, atol=1e-6)
    late = times(store, "Acceleration")[place] - times(store, "GnssPvtData")[0]
    assert late == pytest.approx(age_ms / 1e3, abs=1e-6)
    assert not clock_events(store)


@each_row("product", ["MTi-680G", "MTi-630"])
def test_a_capture_of_a_device_lasts_as_long_as_its_clock_states(tmp_path: Path, product: str) -> None:
    device = XbusSimulator(product, start_ns=0)
    store = opened(tmp_path / "a.bin", b"".join(device.advance(n * 50_000_000) for n in range(1, 161)))
    (info,) = [one for one in store.manifest["channels"] if one["name"] == "Acceleration"]
    (clock,) = [one for one in store.manifest["channels"] if one["name"] == "SampleTimeFine"]
    rows = store.exact(info["id"], 0, store.rows(info["id"])).time
    np.testing.assert_allclose(np.diff(rows), np.median(np.diff(rows)), atol=2e-4)  # ticks of 0.1 ms
    report = store.exact(clock["id"], 0, store.rows(clock["id"]))
    timed = ~np.isnan(report.time)
    off = report.time[timed] - report.columns[0][timed] / 1e4
    assert np.ptp(off) < 1e-6
    assert not [text for text in clock_events(store) if "jump" in text]


def inertial(up_s: float) -> bytes:
    return isb(DATA, 58, struct.pack("<d6fI", up_s, *(0.0,) * 5, 9.8, 0))


@each_row("suffix", ["raw", "bin"])
def test_a_pause_in_a_log_is_a_pause(tmp_path: Path, suffix: str) -> None:
    ups = [*np.arange(10, 20, 0.01), *np.arange(120, 130, 0.01)]
    store = opened(tmp_path / f"a.{suffix}", b"".join(map(inertial, ups)))
    (info,) = [one for one in store.manifest["channels"] if one["message"] == "DID_IMU"][:1]
    rows = store.exact(info["id"], 0, store.rows(info["id"]))
    np.testing.assert_allclose(rows.time - rows.time[0], np.array(ups) - ups[0], atol=1e-6)
    np.testing.assert_allclose(rows.arrival, rows.time, atol=1e-6)
    assert len(np.unique(rows.time)) == len(ups)
    assert store.manifest["ended"] - store.manifest["started"] == pytest.approx(119.99, abs=0.02)
    assert clock_events(store) == ["No data was captured for 100.0 s, by the device's clock."]


def test_two_devices_in_one_capture_keep_a_clock_each(tmp_path: Path) -> None:
    """The clocks are five seconds apart; this affects neither device's time nor the arrival times."""
    frames, sequence = [], 0
    for i in range(1000):
        for device, offset in ((1, 3_000_000), (2, 8_000_000)):
            frames.append(idtp(3, bytes(24), timestamp=offset + 10_000 * i, sequence=sequence, device=device))
            sequence += 1
    store = opened(tmp_path / "a.bin", b"".join(frames))
    infos = [one for one in store.manifest["channels"] if one["name"] == "Acceleration"]
    assert len(infos) == 2
    for info in infos:
        rows = store.exact(info["id"], 0, store.rows(info["id"]))
        np.testing.assert_allclose(np.diff(rows.time), 0.01, atol=1e-6)
        np.testing.assert_allclose(np.diff(rows.arrival), 0.01, atol=1e-6)
    assert store.manifest["ended"] - store.manifest["started"] == pytest.approx(9.99, abs=0.02)


def test_a_clock_set_on_one_device_is_not_a_pause_of_the_other(tmp_path: Path) -> None:
    frames, sequence = [], 0
    for i in range(400):
        for device, jump in ((1, 0), (2, 60_000_000 if i > 200 else 0)):
            frames.append(idtp(3, bytes(24), timestamp=1_000_000 + jump + 10_000 * i, sequence=sequence, device=device))
            sequence += 1
    store = opened(tmp_path / "a.bin", b"".join(frames))
    for device in ("1", "1.2"):
        infos = [one for one in store.manifest["channels"] if one["name"] == "Acceleration" and one["device"] == device]
        (info,) = infos
        np.testing.assert_allclose(np.diff(store.exact(info["id"], 0, store.rows(info["id"])).time), 0.01, atol=2e-3)


def dated(counter: int, fine: int, second: int) -> bytes:
    when = struct.pack(">HBIHBBBBBB", 0x1010, 12, 0, 2026, 1, 1, 0, 0, second, 7)
    return sample(counter, fine, when + struct.pack(">HB3f", 0x4020, 12, 0.0, 0.0, 9.81))


@each_row("suffix", ["mtb", "bin"])
def test_a_capture_with_utc_in_its_samples_is_dated_by_it(tmp_path: Path, suffix: str) -> None:
    frames = [sample(i, 100 * i) for i in range(100)]
    frames += [dated(100 + i, 10_000 + 10_000 * i, i) for i in range(5)]
    store = opened(tmp_path / f"a.{suffix}", b"".join(frames))
    assert times(store, "UtcTime")[0] == pytest.approx(UTC_2026, abs=1e-4)
    assert store.manifest["started"] == pytest.approx(UTC_2026 - 1, abs=1e-4)


def test_an_mtb_without_utc_is_dated_by_its_head(tmp_path: Path) -> None:
    head = bytearray(118)
    head[16:32] = b"2025031409265350"
    frames = [xbus(0x0D, bytes(head)), *(sample(i, 100 * i) for i in range(100))]
    store = opened(tmp_path / "a.mtb", b"".join(frames))
    assert store.manifest["started"] == pytest.approx(1741944413.5, abs=1e-3)
    listed = probe(tmp_path / "a.mtb")  # before anybody opens it
    assert listed is not None
    assert listed.started == pytest.approx(1741944413.5, abs=1e-3)


def test_an_mtb_with_utc_is_listed_under_it_before_it_is_opened(tmp_path: Path) -> None:
    utc = struct.pack(">HBIHBBBBBB", 0x1010, 12, 0, 2026, 1, 1, 0, 0, 0, 7)
    frames = [xbus(0x0D, bytes(118)), *(sample(i, 10_000 * i, utc if i == 1 else b"") for i in range(9))]
    (tmp_path / "a.mtb").write_bytes(b"".join(frames))
    listed = probe(tmp_path / "a.mtb")
    assert listed is not None
    assert listed.started == pytest.approx(UTC_2026 - 1, abs=1e-4)


def test_guessed_times_are_marked(tmp_path: Path) -> None:
    frames = [xbus(0x36, struct.pack(">HB3f", 0x4020, 12, 0.0, 0.0, 9.81)) for _ in range(6000)]
    store = opened(tmp_path / "a.bin", b"".join(frames))
    assert any("estimated at 11520 B/s" in text for text in clock_events(store))


# ── the device's own clock in exports ────────────────────────────────────────────────────────────────────────────────


def table(store: ColumnStore, folder: Path, message: str) -> list[dict[str, str]]:
    made = export("csv", ExportRequest(store), folder / "out.csv")
    (path,) = [one for one in made if one.stem == f"out_{message}"]
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_exports_have_the_devices_clock_and_utc(tmp_path: Path) -> None:
    """DID_IMU has its up-time and no other clock field; UTC is known from the first fix on."""
    device = IsbSimulator(start_ns=0)
    store = opened(tmp_path / "a.raw", b"".join(device.advance(n * 50_000_000) for n in range(1, 900)))
    rows = table(store, tmp_path, "DID_INS_1")
    known = [float(row["utc (s)"]) for row in rows if row["utc (s)"]]
    assert 0 < len(known) < len(rows)
    np.testing.assert_allclose(known, [float(row["time (s)"]) for row in rows if row["utc (s)"]], atol=0.011)
    path = read_table(export("parquet", ExportRequest(store), tmp_path / "out.parquet")[0])
    assert path.schema.field("utc").metadata[b"unit"] == b"s"
    interval = np.diff([float(row["time (s)"]) for row in rows])
    np.testing.assert_allclose(interval, np.median(interval), atol=0.011)


def test_the_up_time_that_a_data_set_sends_is_a_column(tmp_path: Path) -> None:
    store = opened(tmp_path / "a.raw", b"".join(inertial(10 + i / 100) for i in range(100)))
    rows = table(store, tmp_path, "DID_IMU")
    assert [float(row["DID_IMU.time (s)"]) for row in rows] == [10 + i / 100 for i in range(100)]
    assert "utc (s)" not in rows[0]


def test_the_header_of_an_idtp_frame_is_in_its_rows(tmp_path: Path) -> None:
    frames = [idtp(3, bytes(24), timestamp=5000 + 10_000 * i, sequence=7 + i, device=1) for i in range(50)]
    rows = table(opened(tmp_path / "a.bin", b"".join(frames)), tmp_path, "Imu6")
    assert [int(row["timestamp"]) for row in rows] == [5000 + 10_000 * i for i in range(50)]
    assert [int(row["sequence"]) for row in rows] == [7 + i for i in range(50)]


def test_aligned_lines_have_the_devices_clock_of_their_sample(tmp_path: Path) -> None:
    frames = [idtp(3, bytes(24), timestamp=5000 + 10_000 * i, sequence=7 + i, device=1) for i in range(50)]
    store = opened(tmp_path / "a.bin", b"".join(frames))
    (path,) = export("csv-aligned", ExportRequest(store), tmp_path / "out.csv")
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    assert list(rows[0])[:4] == ["time (s)", "arrival (s)", "timestamp", "sequence"]
    assert [int(row["timestamp"]) for row in rows] == [5000 + 10_000 * i for i in range(50)]
    assert [int(row["sequence"]) for row in rows] == [7 + i for i in range(50)]


def test_aligned_lines_have_utc_where_the_device_knows_it(tmp_path: Path) -> None:
    device = IsbSimulator(start_ns=0)
    store = opened(tmp_path / "a.raw", b"".join(device.advance(n * 50_000_000) for n in range(1, 900)))
    (path,) = export("csv-aligned", ExportRequest(store), tmp_path / "out.csv")
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    (head,) = [name for name in rows[0] if name.endswith("utc (s)")]
    known = [float(row[head]) for row in rows if row[head]]
    assert 0 < len(known) < len(rows)
    np.testing.assert_allclose(known, [float(row["time (s)"]) for row in rows if row[head]], atol=0.011)


def test_two_coordinate_systems_are_two_quantities_by_name(tmp_path: Path) -> None:
    frames = []
    for i in range(20):
        matrix = struct.pack(">HB9f", 0x2024 if i < 10 else 0x2028, 36, *(1, 0, 0, 0, 1, 0, 0, 0, 1))
        frames.append(sample(i, 100 * i, matrix))
    store = opened(tmp_path / "a.bin", b"".join(frames))
    head = list(table(store, tmp_path, "MTData2")[0])
    assert "RotationMatrix[NED from body].m11 (NED from body)" in head
    assert "RotationMatrix[NWU from body].m11 (NWU from body)" in head
    assert not any("#2" in name for name in head)
    schema = read_table(export("parquet", ExportRequest(store), tmp_path / "out.parquet")[0]).schema
    assert schema.field("RotationMatrix[NED from body].m11").metadata[b"frame"] == b"NED from body"


def test_other_viewers_receive_the_coordinate_system(tmp_path: Path) -> None:
    frames = [sample(i, 100 * i, struct.pack(">HB3f", 0xD014, 12, 1, 2, 3)) for i in range(20)]
    store = opened(tmp_path / "a.bin", b"".join(frames))
    (path,) = export("mcap", ExportRequest(store), tmp_path / "out.mcap")
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    (schema,) = (one for one in summary.schemas.values() if one.name.startswith("Velocity"))
    assert {axis["frame"] for axis in json.loads(schema.data)["properties"].values()} == {"NED"}


def test_an_import_of_an_export_has_its_units_again(tmp_path: Path) -> None:
    frames = [sample(i, 100 * i, struct.pack(">HB3f", 0xD014, 12, 1, 2, 3)) for i in range(20)]
    store = opened(tmp_path / "a.bin", b"".join(frames))
    (path,) = export("csv", ExportRequest(store), tmp_path / "out.csv")
    again = decode(open_file(path), tmp_path / "again", protocol_set.all_protocols())
    units = {column["unit"] for info in again.manifest["channels"] for column in info["columns"]}
    assert "m/s" in units
    assert not any(";" in unit or "NED" in unit for unit in units)
