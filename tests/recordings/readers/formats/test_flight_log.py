"""Logs of PX4 and ArduPilot, with their date, units and what is left out; and damaged."""

import os
import struct
from pathlib import Path

import numpy as np
import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from tests.recordings.readers.formats.flight_logs import BOOT_US, COUNT, RATES, UTC_US, _record, dataflash, ulog
from tests.recordings.readers.formats.opening import damage_of, opened, rows_of, survives_damage
from tests.support.each_row import each_row

BEGIN = UTC_US / 1e6 - 1.0  # the fix comes after a second


def written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def units_of(store: object) -> dict[str, str]:
    return {f"{one['message']}/{one['name']}": one["unit"] for one in store.manifest["channels"]}  # type: ignore[attr-defined]


def test_a_ulog_has_its_topics_and_the_date_of_its_receiver(tmp_path: Path) -> None:
    store = opened(written(tmp_path / "a.ulg", ulog()), tmp_path)
    rows = rows_of(store, "gyro_rad", "sensor_combined")
    np.testing.assert_allclose(rows.columns[0], RATES)
    np.testing.assert_allclose(rows.time, BEGIN + np.arange(COUNT) / 100, atol=1e-5)
    units = units_of(store)
    assert units["sensor_combined/gyro_rad"] == "rad/s"
    assert units["sensor_combined/accelerometer_m_s2"] == "m/s²"
    assert {one["message"] for one in store.manifest["channels"]} == {
        "sensor_combined",
        "wheels",
        "wheels.1",
        "sensor_gps",
    }
    assert len(rows_of(store, "at[1]", "wheels.1").columns[0]) == COUNT // 10
    assert rows_of(store, "at[1]", "wheels.1").columns[1][0] == 4.0
    words = damage_of(store)
    assert "The logger dropped records 1 time, for 5 ms in all." in words
    assert "Left out: parameters, logged texts." in words
    assert store.manifest["timed"]
    assert "since the start of the device" in store.manifest["time"]["sentences"][0]
    assert "GNSS receiver in sensor_gps" in store.manifest["time"]["sentences"][1]


def test_a_dataflash_log_has_its_units_and_instances(tmp_path: Path) -> None:
    store = opened(written(tmp_path / "a.BIN", dataflash()), tmp_path)
    for one in (0, 1):
        rows = rows_of(store, "Gyr", f"IMU[{one}]")
        np.testing.assert_allclose(rows.columns[0], RATES * (1 + one))
        np.testing.assert_allclose(rows.time, BEGIN + np.arange(COUNT) / 100, atol=1e-5)
    units = units_of(store)
    assert (units["IMU[0]/Gyr"], units["IMU[0]/Acc"], units["RATE/Milli"]) == ("rad/s", "m/s²", "furlong")
    assert rows_of(store, "Milli").columns[0][0] == pytest.approx(1.5)
    assert rows_of(store, "Temp").columns[0][0] == pytest.approx(21.5)
    assert (rows_of(store, "Lat").columns[0][0], rows_of(store, "Alt").columns[0][0]) == pytest.approx((48.0, 50.12))
    assert "Left out: " in damage_of(store)
    assert "logged texts" in damage_of(store)


@each_row(("name", "data"), [("a.ulg", ulog(with_fix=False)), ("a.bin", dataflash(with_fix=False))])
def test_without_a_fix_the_date_is_that_of_the_file(name: str, data: bytes, tmp_path: Path) -> None:
    path = written(tmp_path / name, data)
    os.utime(path, (1_600_000_000, 1_600_000_000))
    source = open_file(path)
    store = opened(path, tmp_path)
    assert not source.timed
    assert store.manifest["started"] == pytest.approx(1_600_000_000)
    assert "date is that of the file's last change" in store.manifest["time"]["sentences"][1]


@each_row(("name", "data"), [("a.ulg", ulog()), ("a.bin", dataflash())])
def test_a_hole_costs_only_what_was_in_it(name: str, data: bytes, tmp_path: Path) -> None:
    middle = len(data) // 2
    path = written(tmp_path / name, data[:middle] + b"\x01\x02\xa3\x95\xff" * 40 + data[middle + 200 :])
    store = opened(path, tmp_path)
    table = "sensor_combined" if name == "a.ulg" else "IMU[0]"
    name = "accelerometer_m_s2" if name == "a.ulg" else "Acc"
    rows = rows_of(store, name, table)
    assert COUNT - 30 < len(rows.time) < COUNT
    assert "damaged" in damage_of(store)


def test_a_ulog_of_a_newer_kind_is_refused(tmp_path: Path) -> None:
    opened(written(tmp_path / "a.ulg", ulog(appended=1)), tmp_path)
    with pytest.raises(RecordingError, match="features that are not known"):
        open_file(written(tmp_path / "b.ulg", ulog(unknown=2)))


@each_row(("name", "data"), [("a.ulg", ulog()), ("a.bin", dataflash())])
def test_damage_does_no_harm(name: str, data: bytes, tmp_path: Path) -> None:
    opens, refused = survives_damage(written(tmp_path / name, data), tmp_path)
    assert opens
    assert refused


def test_the_clock_that_goes_back_is_reported(tmp_path: Path) -> None:
    data = dataflash()
    path = written(tmp_path / "a.bin", data + data[-2000:])
    assert "TimeUS goes back 1 times" in damage_of(opened(path, tmp_path))
    assert BOOT_US


def restarted(name: str) -> bytes:
    """A log that goes on after a restart, from half of its records on."""
    data = ulog() if name == "a.ulg" else dataflash()
    first = data.index(struct.pack("<Q", BOOT_US), 24)
    head = first - 5 if name == "a.ulg" else first - 3
    return data + data[head:]


@each_row(
    ("name", "table", "quantity", "clock"),
    [("a.ulg", "sensor_combined", "gyro_rad", "timestamp"), ("a.bin", "IMU[0]", "Gyr", "TimeUS")],
)
def test_a_restart_begins_a_segment_of_all_tables(
    name: str, table: str, quantity: str, clock: str, tmp_path: Path
) -> None:
    store = opened(written(tmp_path / name, restarted(name)), tmp_path)
    rows = rows_of(store, quantity, table)
    np.testing.assert_allclose(rows.columns[0], np.tile(RATES, 2))
    np.testing.assert_allclose(np.delete(np.diff(rows.time), COUNT - 1), 0.01, atol=1e-6)
    assert np.diff(rows.time)[COUNT - 1] == pytest.approx(1.0, abs=1e-5)  # in the place of 3.99 s back
    np.testing.assert_allclose(
        rows_of(store, clock, table).columns[0], BOOT_US / 1e6 + np.tile(np.arange(COUNT), 2) / 100
    )
    [event] = [one for one in store.manifest["events"] if one["data"].get("kind") == "back"]
    assert event["text"].startswith(f"{clock} goes back by 3.99 s at row ")
    assert event["data"]["by_s"] == pytest.approx(-3.99)
    assert store.manifest["segments"] == {"1": [pytest.approx(rows.time[COUNT])]}
    slow = rows_of(store, "at[1]", "wheels.1") if name == "a.ulg" else rows_of(store, "Milli")
    np.testing.assert_allclose(slow.time, rows.time[::10], atol=1e-5)


def test_a_slow_table_is_in_the_segment_of_its_place(tmp_path: Path) -> None:
    """Its own clock does not go back: it has one record late before the restart, and one later after it."""
    early = [_record(10, "QBffffff", 1_000_000 + n * 10_000, 0, *[0.0] * 6) for n in range(50)]
    late = [_record(10, "QBffffff", 100_000 + n * 10_000, 0, *[0.0] * 6) for n in range(200)]
    early.insert(10, _record(15, "QH", 1_100_000, 1))
    late.insert(150, _record(15, "QH", 1_600_000, 2))
    data = dataflash(with_fix=False)
    data = data[: data.index(b"\xa3\x95\x0a")] + b"".join(early + late)
    store = opened(written(tmp_path / "a.bin", data), tmp_path)
    times = rows_of(store, "Milli").time
    assert times[1] - times[0] == pytest.approx(1.49 - 1.1 + 1.0 + 1.6 - 0.1, abs=1e-5)


def test_records_that_are_out_of_order_are_no_step(tmp_path: Path) -> None:
    """One record comes late, among those of its kind and of another."""
    records = [_record(10, "QBffffff", 1_000_000 + n * 10_000, 0, *[0.0] * 6) for n in range(50)]
    records.insert(30, records.pop(20))
    records.insert(10, _record(15, "QH", 1, 7))
    data = dataflash(with_fix=False)
    data = data[: data.index(b"\xa3\x95\x0a")] + b"".join(records)
    store = opened(written(tmp_path / "a.bin", data), tmp_path)
    assert store.manifest["segments"] == {"1": []}
    assert not [one for one in store.manifest["channels"] if one["name"] == "TimeUS"]


def test_a_long_pause_begins_a_segment(tmp_path: Path) -> None:
    times = [*range(0, 1_000_000, 10_000), *range(100_000_000, 101_000_000, 10_000)]
    data = dataflash(with_fix=False)
    data = data[: data.index(b"\xa3\x95\x0a")]
    data += b"".join(_record(10, "QBffffff", one, 0, *[0.0] * 6) for one in times)
    store = opened(written(tmp_path / "a.bin", data), tmp_path)
    assert len(store.manifest["segments"]["1"]) == 1
    [event] = [one for one in store.manifest["events"] if one["data"].get("kind") == "ahead"]
    assert event["data"]["by_s"] == pytest.approx(99.01)
