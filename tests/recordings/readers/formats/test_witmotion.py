"""Binary logs of WitMotion sensors, written by the formulas of their documents."""

from __future__ import annotations

import struct
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
from tests.recordings.readers.formats.opening import survives_damage
from tests.recordings.readers.formats.witmotion_frames import cycle, frame
from tests.support.each_row import each_row

N = 80
START = 1_780_000_000  # 2026-05-28 20:26:40


def opened(path: Path, rate: float = 0.0) -> ColumnStore:
    source = open_file(path, "", TableOptions(rate=rate))
    return decode(source, path.with_suffix(".columns"), protocol_set.all_protocols())


@each_row("clock", [True, False])
def test_a_cycle_of_frames_is_a_row(clock: bool, tmp_path: Path) -> None:
    path = tmp_path / "WIT1.TXT"
    path.write_bytes(b"".join(cycle(n, clock=clock) for n in range(N)))
    if not clock:
        with pytest.raises(RecordingError, match="no column of times"):
            opened(path)
    store = opened(path, 0.0 if clock else 50.0)
    results = {info["name"]: info for info in store.manifest["channels"]}
    assert [(name, info["unit"]) for name, info in results.items()] == [
        ("Acceleration", "g"),
        ("Angular velocity", "deg/s"),
        ("Roll", "deg"),
        ("Pitch", "deg"),
        ("Yaw", "deg"),
        ("Pressure", "Pa"),
        ("Height", "cm"),
        ("Quaternion", ""),
    ]
    rows = store.exact(results["Acceleration"]["id"], 0, 1000)
    np.testing.assert_allclose(rows.columns[0], np.arange(N) * 100 * 16 / 32_768)
    np.testing.assert_allclose(rows.columns[2], 1.0)
    np.testing.assert_allclose(np.diff(rows.time), 0.02, atol=1e-6)
    assert not clock or rows.time[0] == START
    assert store.exact(results["Yaw"]["id"], 0, 1).columns[0][0] == -90
    assert store.exact(results["Height"]["id"], 0, 1).columns[0][0] == 50_000
    assert [one["words"] for one in store.manifest["damage"]] == ["Frames of the types 0x5A are left out."]
    listed = probe(path)
    assert listed is not None
    assert not listed.damaged


def test_damaged_frames_are_left_out_and_reported(tmp_path: Path) -> None:
    data = b"".join(cycle(n, clock=True) for n in range(N))
    path = tmp_path / "a.bin"
    cut = bytearray(data[5:])  # begins inside of a frame
    cut[77 * 20 + 8] ^= 0xFF  # the acceleration of one row
    path.write_bytes(cut)
    store = opened(path)
    rows = store.exact(1, 0, 1000)
    assert np.isnan(rows.columns[0]).sum() <= 1
    assert "no whole frame" in store.manifest["damage"][-1]["words"]
    assert sum(survives_damage(path, tmp_path))


@each_row("data", [b"\x55\x51" * 200, bytes(range(256)) * 4, frame(0x51, bytes(8)) * 3])
def test_other_bytes_are_not_taken_for_frames(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(data)
    with pytest.raises(RecordingError):
        open_file(tmp_path / "a.bin")


def sample(n: int) -> bytes:
    """A frame of 20 bytes."""
    return b"\x55\x61" + struct.pack("<9h", 100 * n, 0, 2048, -100 * n, 0, 16384, 0, 16384, -16384)


@each_row("begin", [0, 7])
def test_frames_by_bluetooth_are_rows(begin: int, tmp_path: Path) -> None:
    """They were named, and not read."""
    path = tmp_path / "ble.bin"
    path.write_bytes((b"".join(map(sample, range(40))) + b"\x55\x71" + bytes(18) + sample(40) + sample(41))[begin:])
    with pytest.raises(RecordingError, match="no column of times"):
        opened(path)
    store = opened(path, 50.0)
    results = {info["name"]: (info["id"], info["unit"]) for info in store.manifest["channels"]}
    assert {name: unit for name, (_, unit) in results.items()} == {
        **{"Acceleration": "g", "Angular velocity": "deg/s", "Roll": "deg", "Pitch": "deg", "Yaw": "deg"}
    }
    rows = store.exact(results["Acceleration"][0], 0, 1000)
    first = 1 if begin else 0
    np.testing.assert_allclose(rows.columns[0], np.arange(first, 42) * 100 * 16 / 32_768)
    np.testing.assert_allclose(rows.columns[2], 1.0)
    np.testing.assert_allclose(np.diff(rows.time), 0.02, atol=1e-6)
    assert store.exact(results["Angular velocity"][0], 0, 1).columns[2][0] == 1000
    assert store.exact(results["Yaw"][0], 0, 1).columns[0][0] == -90
    assert store.manifest["damage"][0]["words"] == "1 answer is left out."
    assert sum(survives_damage(path, tmp_path))
