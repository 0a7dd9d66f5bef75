"""Parquet, Arrow, NumPy and MATLAB files, written by their libraries, read as tables are."""

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.tables.options import TableOptions
from imuscope.server.commands.inspect import inspect_file
from tests.recordings.readers.formats.binary_tables import (
    BEGIN,
    COUNT,
    GYRO,
    NS,
    arrow,
    arrow_stream,
    mat,
    npy,
    npz,
    parquet,
)
from tests.recordings.readers.formats.opening import damage_of, opened, rows_of, survives_damage
from tests.support.each_row import each_row

FILES: list[tuple[str, Callable[[Path], None], str]] = [
    ("a.parquet", parquet, "gyro"),
    ("a.arrow", arrow, "gyro"),
    ("a.arrows", arrow_stream, "gyro"),
    ("a.npz", npz, "gyro"),
    ("a.npy", npy, "gyro"),
    ("a.mat", mat, "imu.gyro"),
    ("b.mat", lambda path: savemat(path, {"time": NS / 1e9, "gyro": GYRO.T}, format="4"), "gyro"),
]


@each_row(("name", "write", "channel"), FILES)
def test_a_binary_table_has_its_times_and_vectors(
    name: str, write: Callable[[Path], None], channel: str, tmp_path: Path
) -> None:
    write(tmp_path / name)
    store = opened(tmp_path / name, tmp_path)
    info = next(one for one in store.manifest["channels"] if one["name"] == channel)
    rows = rows_of(store, channel)
    assert (info["kind"], [column["name"] for column in info["columns"]]) == ("vector", ["x", "y", "z"])
    assert info["unit"] == ("rad/s" if name.startswith("a.a") or name == "a.parquet" else "")
    np.testing.assert_array_equal(np.stack(rows.columns, axis=1), GYRO)
    np.testing.assert_allclose(rows.time, BEGIN + np.arange(COUNT) / 100, atol=1e-6)
    assert store.manifest["time"]["axis"]


def test_what_is_no_column_is_named(tmp_path: Path) -> None:
    npz(tmp_path / "a.npz")
    assert "Arrays without 400 rows of numbers are left out: matrix 4x4, label single value." in damage_of(
        opened(tmp_path / "a.npz", tmp_path / "1")
    )
    mat(tmp_path / "a.mat")
    assert "name (char)" in damage_of(opened(tmp_path / "a.mat", tmp_path / "2"))
    parquet(tmp_path / "a.parquet")
    assert "left out: flags." in damage_of(opened(tmp_path / "a.parquet", tmp_path / "3"))


def test_an_array_without_names_needs_a_rate(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", GYRO)
    with pytest.raises(RecordingError) as refused:
        opened(tmp_path / "a.npy", tmp_path / "1")
    assert "--rate" in refused.value.hint
    options = TableOptions(rate=100.0, columns={"1": "Gyro.x (rad/s)", "2": "Gyro.y (rad/s)", "3": "Gyro.z (rad/s)"})
    store = opened(tmp_path / "a.npy", tmp_path / "2", options)
    np.testing.assert_allclose(np.diff(rows_of(store, "Gyro").time), 0.01, atol=1e-6)


def test_objects_and_claims_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([{"a": 1}, None]), allow_pickle=True)
    with pytest.raises(RecordingError, match="damaged"):
        open_file(tmp_path / "a.npy")
    out = io.BytesIO()
    np.lib.format.write_array_header_1_0(out, {"descr": "<f8", "fortran_order": False, "shape": (1 << 40,)})
    (tmp_path / "b.npy").write_bytes(out.getvalue())
    with pytest.raises(RecordingError, match="damaged"):
        open_file(tmp_path / "b.npy")
    with zipfile.ZipFile(tmp_path / "c.npz", "w") as archive:
        archive.writestr("a.npy", out.getvalue())
    with pytest.raises(RecordingError, match="no arrays"):
        open_file(tmp_path / "c.npz")


@each_row(("name", "write", "channel"), FILES)
def test_damage_does_no_harm(name: str, write: Callable[[Path], None], channel: str, tmp_path: Path) -> None:
    write(tmp_path / name)
    opens, refused = survives_damage(tmp_path / name, tmp_path)
    assert opens + refused
    assert channel


@given(st.data())
def test_numbers_are_the_same_in_every_format(tmp_path_factory: pytest.TempPathFactory, data: Any) -> None:
    folder = tmp_path_factory.mktemp("tables")
    numbers = st.floats(allow_infinity=False, width=data.draw(st.sampled_from([32, 64])))
    values = np.array(data.draw(st.lists(numbers, min_size=5, max_size=30)))
    time = BEGIN + np.arange(len(values)) / 100
    np.savez(folder / "a.npz", time=time, value=values)
    pq.write_table(pa.table({"time": time, "value": values}), folder / "a.parquet")
    for name in ("a.npz", "a.parquet"):
        source = open_file(folder / name)
        [rows] = source.rows()  # type: ignore[attr-defined]
        np.testing.assert_array_equal(rows.columns["value"][0], values)


@each_row("name", ["a.h5", "a.mat", "a.dat", "a.bin", "a.csv", "a.raw"])
@each_row(
    "head", [b"\x89HDF\r\n\x1a\n", b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Thu Jan  1 00:00:00 2026"]
)
def test_hdf5_is_known_by_its_first_bytes(head: bytes, name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(head.ljust(512, b"\0") + b"\x89HDF\r\n\x1a\n" + bytes(600))
    with pytest.raises(RecordingError, match="is a damaged HDF5 file") as refused:
        open_file(path)
    assert "-v7" in refused.value.hint
    with pytest.raises(RecordingError, match="HDF5"):
        inspect_file(path, io.StringIO())


def moments(kind: str) -> dict[str, pa.Array]:
    """Columns of the times, of some types."""
    times = pa.array(NS, pa.timestamp("ns"))
    match kind:
        case "dictionary":
            return {"time": times.cast(pa.string()).dictionary_encode()}
        case "date and time":
            return {"day": times.cast(pa.date32(), safe=False), "time": times.cast(pa.time64("ns"))}
        case _:
            return {"time": times}


@each_row("kind", ["dictionary", "date and time", "plain"])
def test_times_of_every_type_are_read(kind: str, tmp_path: Path) -> None:
    """Tables of Polars and of categories in pandas had no column of times."""
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({**moments(kind), "gx": GYRO[:, 0]}), path)
    rows = rows_of(opened(path, tmp_path), "gx")
    np.testing.assert_allclose(rows.time, NS / 1e9, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(rows.columns[0], GYRO[:, 0])


def test_structures_and_lists_of_one_length_are_columns(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    lists = pa.array(GYRO.tolist(), pa.list_(pa.float64(), 3))
    structures = pa.array([{"x": x, "y": y, "z": z, "name": "a"} for x, y, z in GYRO.tolist()])
    columns = {"time": pa.array(NS, pa.timestamp("ns")), "gyro": lists, "acc": structures, "free": [[1.0]] * COUNT}
    pq.write_table(pa.table(columns), path, row_group_size=150)
    store = opened(path, tmp_path)
    for name in ("gyro", "acc"):
        np.testing.assert_array_equal(np.stack(rows_of(store, name).columns, axis=1), GYRO)
    assert "Columns without numbers are left out: free." in damage_of(store)


@each_row("suffix", ["mat", "npz"])
def test_a_rate_beside_the_arrays_counts_their_rows(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    arrays = {"Fs": 200.0, "gyro": GYRO}
    savemat(path, arrays) if suffix == "mat" else np.savez(path, **arrays)
    store = opened(path, tmp_path)
    np.testing.assert_allclose(np.diff(rows_of(store, "gyro").time), 0.005, atol=1e-6)
    assert "counts the rows, 200 Hz" in store.manifest["time"]["sentences"][0]


def test_one_matrix_with_the_time_in_front_is_a_table(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"data": np.column_stack([np.arange(COUNT) / 100, GYRO, GYRO])})
    np.testing.assert_allclose(np.diff(rows_of(opened(path, tmp_path), "column 2").time), 0.01, atol=1e-6)


def test_an_array_of_objects_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(RecordingError, match="has objects"):
        open_file(path)
