"""HDF5 files written by h5py, and MATLAB 7.3 files: HDF5 with the attributes that MATLAB gives its variables."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.recording_probe import RecordingProbe
from imuscope.recordings.readers.formats import hdf5
from imuscope.recordings.tables.options import TableOptions
from tests.recordings.readers.formats.hdf5_files import (
    COUNT,
    GYRO,
    TIME,
    compact,
    matlab,
    packed,
    packed_records,
    plain,
    records,
)
from tests.recordings.readers.formats.opening import damage_of, opened, rows_of, survives_damage
from tests.support.each_row import each_row

FILES: list[tuple[str, Callable[[Path], None]]] = [
    ("packed.h5", packed),
    ("plain.hdf5", plain),
    ("compact.h5", compact),
    ("records.h5", records),
    ("packed_records.h5", packed_records),
    ("a.mat", matlab),
]


@each_row(("name", "write"), FILES)
def test_arrays_are_columns(name: str, write: Callable[[Path], None], tmp_path: Path) -> None:
    write(tmp_path / name)
    assert RecordingProbe(open_file(tmp_path / name).format).may_be_table
    store = opened(tmp_path / name, tmp_path)
    info = next(one for one in store.manifest["channels"] if one["name"] == "imu.gyro")
    rows = rows_of(store, info["name"])
    assert (info["kind"], [column["name"] for column in info["columns"]]) == ("vector", ["x", "y", "z"])
    assert info["unit"] == ("" if name == "a.mat" or "records" in name else "rad/s")
    np.testing.assert_array_equal(np.stack(rows.columns, axis=1), GYRO)
    np.testing.assert_allclose(rows.time, TIME, atol=1e-6)


@each_row(("name", "write"), FILES)
def test_damage_does_no_harm(name: str, write: Callable[[Path], None], tmp_path: Path) -> None:
    write(tmp_path / name)
    assert sum(survives_damage(tmp_path / name, tmp_path))


def test_what_is_no_column_is_named(tmp_path: Path) -> None:
    matlab(tmp_path / "a.mat")
    words = damage_of(opened(tmp_path / "a.mat", tmp_path / "1"))
    assert "Left out: cell (cell), label (char), none (empty), table (timetable)." in words
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["time"] = TIME
        file["value"] = TIME
        file["few"] = [1.0, 2.0]
        file["complex"] = np.zeros(COUNT, complex)
        file.create_dataset("other", data=GYRO, compression="lzf")
        file.create_dataset("unwritten", (COUNT,), "f8")
        file["nowhere"] = h5py.SoftLink("/none")
        file["loop"] = h5py.SoftLink("/")
        file["group/above"] = file["/"]
    (tmp_path / "b.h5").write_bytes((tmp_path / "b.h5").read_bytes().replace(b"\x00\x7d\x08", b"\x09\x7d\x08"))
    words = damage_of(opened(tmp_path / "b.h5", tmp_path / "2"))
    assert "complex (no numbers)" in words
    assert "other (compressed by filter 32009 of HDF5, not by gzip or lzf)" in words
    assert "unwritten (without values, or cut)" in words
    assert "Arrays without 400 rows of numbers are left out: few 2." in words
    with h5py.File(tmp_path / "c.h5", "w") as file:
        file["label"] = "a"
    with pytest.raises(RecordingError, match=r"has no arrays of numbers\. Left out: label"):
        open_file(tmp_path / "c.h5")


@each_row("shuffle", [False, True])
@each_row("what", ["constant", "steps", "noise"])
def test_lzf_is_decompressed(what: str, shuffle: bool, tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 1 << 60, COUNT).astype(float)
    values = {"constant": np.full(COUNT, 9.81), "steps": np.arange(COUNT) // 7 / 8, "noise": noise}[what]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"] = TIME
        file.create_dataset("value", data=values, chunks=(150,), compression="lzf", shuffle=shuffle)
    store = opened(tmp_path / "a.h5", tmp_path / "1")
    np.testing.assert_array_equal(store.exact(1, 0, 1000).columns[0], values)
    assert sum(survives_damage(tmp_path / "a.h5", tmp_path))


def test_chunks_of_newer_libraries_are_named_with_the_remedy(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w", libver="latest") as file:
        file["time"] = TIME
        file["value"] = TIME
        file.create_dataset("gyro", data=GYRO, chunks=True)
    words = damage_of(opened(tmp_path / "a.h5", tmp_path / "1"))
    assert "gyro (in chunks as HDF5 1.10 keeps them; write it without libver)" in words


def test_chunks_that_are_not_stored_hold_nothing(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"] = TIME
        file.create_dataset("value", (COUNT,), "f8", chunks=(100,))[100:200] = 1.0
    values = rows_of(opened(tmp_path / "a.h5", tmp_path), "value").columns[0]
    assert (np.isfinite(values).sum(), set(values[np.isfinite(values)])) == (100, {1.0})


@each_row(
    ("unit", "counted"),
    [
        ("seconds since 2017-07-14 02:40:00", np.arange(COUNT) / 100),
        ("milliseconds since 2017-07-14T02:40:00Z", np.arange(COUNT) * 10),
        ("days since 2017-07-14 02:40:00 UTC", np.arange(COUNT) / 100 / 86_400),
        ("microseconds since 1970-01-01", (TIME * 1e6).round().astype(np.int64)),
    ],
)
def test_a_unit_with_a_date_gives_dates(unit: str, counted: np.ndarray, tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.nc", "w") as file:
        file["time"], file["value"] = counted, np.arange(COUNT)
        file["time"].attrs["units"] = unit
    np.testing.assert_allclose(rows_of(opened(tmp_path / "a.nc", tmp_path), "value").time, TIME, atol=1e-6)


def test_a_date_that_is_not_understood_is_not_guessed(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["value"] = np.arange(COUNT) / 100, np.arange(COUNT)
        file["time"].attrs["units"] = "seconds since the start"
    store = opened(tmp_path / "a.h5", tmp_path, TableOptions(unit="s"))
    np.testing.assert_allclose(np.diff(rows_of(store, "value").time), 0.01, atol=1e-6)


def test_claims_and_bombs_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"] = TIME
        file["value"] = TIME
        file.create_dataset("huge", (1 << 40,), "f8", chunks=(1 << 10,), compression="gzip")[0] = 1.0
        file.create_dataset("wrong", (COUNT,), "f8", chunks=(COUNT,), fletcher32=True)[:] = 7.0
    data = bytearray((tmp_path / "a.h5").read_bytes())
    data[data.index(np.full(COUNT, 7.0).tobytes()) + 800] ^= 1
    (tmp_path / "a.h5").write_bytes(data)
    words = damage_of(opened(tmp_path / "a.h5", tmp_path))
    assert "huge (too large)" in words
    assert "wrong (a checksum is wrong)" in words
    monkeypatch.setattr(hdf5, "MOST_READS", 5)
    with pytest.raises(RecordingError, match="leads back to itself"):
        open_file(tmp_path / "a.h5")


@each_row("rate", [100, 100.0, np.array([100], np.int32), "100 Hz", np.bytes_(b"100")])
@each_row("is_of_file", [True, False])
def test_a_rate_in_an_attribute_counts_the_rows(rate: object, is_of_file: bool, tmp_path: Path) -> None:
    """An array without times was refused, although the file names its sampling rate."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["acc"] = np.sin(np.arange(300.0)).reshape(100, 3)
        (file if is_of_file else file["acc"]).attrs["sampling_rate"] = rate
    rows = rows_of(opened(tmp_path / "a.h5", tmp_path), "acc")
    assert len(rows.time) == 100
    np.testing.assert_allclose(np.diff(rows.time), 0.01, atol=1e-6)
