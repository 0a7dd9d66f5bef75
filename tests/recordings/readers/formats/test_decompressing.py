"""Zip, gzip and Zstandard of whatever opens, with their limits; and files that are not known."""

from __future__ import annotations

import gzip
import io
import json
import shutil
import sqlite3
import tempfile
import zipfile
from contextlib import closing
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.download import full_recording
from imuscope.recordings.readers.file_suffixes import suffixes
from imuscope.recordings.readers.formats import decompressing
from imuscope.recordings.readers.known_files import FILES
from tests.recordings.readers.formats.bags import COUNT, ros1_bag, ros2_bag
from tests.recordings.readers.formats.flight_logs import dataflash
from tests.recordings.readers.formats.opening import damage_of, opened, rows_of, survives_damage
from tests.recordings.tables.field_files import field_file
from tests.support.each_row import each_row
from tests.support.read_library import ReadLibrary

PHONE = "c08_phone_sensor_logger_Gyroscope.csv"


def zstd(data: bytes) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.CompressedOutputStream(sink, "zstd") as stream:
        stream.write(data)
    return sink.getvalue().to_pybytes()


def zipped(path: Path, files: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return path


@each_row("suffix", [".gz", ".zst", ".zip"])
def test_whatever_opens_also_opens_compressed(suffix: str, tmp_path: Path) -> None:
    for name, channel in (
        ("c27_ros1.bag", "angular_velocity"),
        (PHONE, "xyz"),
        ("c25_rosbag2.db3", "angular_velocity"),
    ):
        data = field_file(name).read_bytes()
        path = tmp_path / f"{name}{suffix}"
        if suffix == ".zip":
            zipped(path, {f"folder/{name}": data})
        else:
            path.write_bytes(gzip.compress(data) if suffix == ".gz" else zstd(data))
        store = opened(path, tmp_path / f"store-{name}")
        assert len(rows_of(store, channel).time) == 400


def test_a_zip_of_tables_is_one_recording(tmp_path: Path) -> None:
    data = field_file(PHONE).read_bytes()
    path = zipped(
        tmp_path / "a.zip", {"Gyroscope.csv": data, "Accelerometer.csv": data, "__MACOSX/._a": b"x", "a.md": b"x"}
    )
    store = opened(path, tmp_path)
    assert {one["message"] for one in store.manifest["channels"]} == {"Gyroscope", "Accelerometer"}
    assert "Of a.zip these are left out: a.md." in damage_of(store)


def test_a_zip_of_a_bag_is_the_bag(tmp_path: Path) -> None:
    folder = ros2_bag(tmp_path / "bag", compression="FILE")
    shutil.make_archive(str(tmp_path / "bag"), "zip", tmp_path, "bag")
    store = opened(tmp_path / "bag.zip", tmp_path)
    assert len(rows_of(store, "angular_velocity").time) == COUNT
    assert folder.is_dir()


def test_several_recordings_and_nested_archives_are_refused(tmp_path: Path) -> None:
    bag = field_file("c27_ros1.bag").read_bytes()
    with pytest.raises(RecordingError, match=r"several recordings: a\.bag, b\.bag"):
        open_file(zipped(tmp_path / "a.zip", {"a.bag": bag, "b.bag": bag}))
    inner = zipped(tmp_path / "inner.zip", {"a.bag": bag}).read_bytes()
    with pytest.raises(RecordingError, match="an archive in an archive"):
        open_file(zipped(tmp_path / "b.zip", {"inner.zip": inner}))
    with pytest.raises(RecordingError, match="holds no files"):
        open_file(zipped(tmp_path / "c.zip", {}))
    with pytest.raises(RecordingError, match="an Excel workbook"):
        open_file(zipped(tmp_path / "d.xlsx", {"xl/workbook.xml": b"<x/>"}))


def test_nothing_is_written_outside_of_the_folder_and_nothing_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    bag = field_file("c27_ros1.bag").read_bytes()
    source = open_file(zipped(tmp_path / "a.zip", {"../../../evil.bag": bag}))
    assert [path.name for path in (tmp_path / "temporary").rglob("*.bag")] == ["evil.bag"]
    assert not list(tmp_path.glob("evil*"))
    del source
    assert not list((tmp_path / "temporary").iterdir())


def test_bombs_are_refused_before_they_fill_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decompressing, "RATIO_FROM", 1 << 20)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    zeros = bytes(8 << 20)
    for path in (tmp_path / "a.csv.gz", tmp_path / "a.csv.zst"):
        path.write_bytes(gzip.compress(zeros) if path.suffix == ".gz" else zstd(zeros))
        with pytest.raises(RecordingError, match="times as large"):
            open_file(path)
    with pytest.raises(RecordingError, match="times as large"):
        open_file(zipped(tmp_path / "a.zip", {"a.csv": zeros}))
    monkeypatch.setattr(decompressing, "MAX_UNPACKED_BYTES", 1 << 20)
    with pytest.raises(RecordingError, match="larger than 1 MB"):
        open_file(zipped(tmp_path / "b.zip", {"a.csv": np.random.default_rng(1).bytes(3 << 20)}))
    assert not list((tmp_path / "temporary").iterdir())


def test_a_zip_that_claims_other_sizes_is_refused(tmp_path: Path) -> None:
    path = zipped(tmp_path / "a.zip", {"a.csv": b"time,x\n1,2\n2,3\n3,4\n" * 100})
    data = bytearray(path.read_bytes())
    at = data.index(b"PK\x01\x02") + 24
    data[at : at + 4] = b"\xf0\xff\xff\xff"
    path.write_bytes(data)
    with pytest.raises(RecordingError):
        open_file(path)


@each_row("suffix", [".gz", ".zst", ".zip"])
def test_damaged_archives_do_no_harm(suffix: str, tmp_path: Path) -> None:
    data = dataflash()[:60_000]
    path = tmp_path / f"a.bin{suffix}"
    if suffix == ".zip":
        zipped(path, {"a.bin": data})
    else:
        path.write_bytes(gzip.compress(data) if suffix == ".gz" else zstd(data))
    opens, refused = survives_damage(path, tmp_path)
    assert opens + refused


def test_a_file_that_is_not_known_is_named(tmp_path: Path) -> None:
    for number, known in enumerate(FILES):
        for mark in known.marks:
            path = tmp_path / f"file-{number}.dat2"
            path.write_bytes(bytes(known.offset) + mark + bytes(range(256)) * 4)
            with pytest.raises(RecordingError) as refused:
                open_file(path)
            assert refused.value.message == f"{path.name} is {known.name}, which imuscope does not read."
            assert refused.value.hint == known.remedy
    for length in (11, 20, 28):
        (tmp_path / "a.TXT").write_bytes((b"\x55\x51" + bytes(range(length - 2))) * 60)
        with pytest.raises(RecordingError, match="a binary log of WitMotion"):
            open_file(tmp_path / "a.TXT")
    (tmp_path / "a.csv").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    with pytest.raises(RecordingError, match="a PNG image"):
        open_file(tmp_path / "a.csv")


def test_the_library_lists_takes_and_hands_out_these_files(tmp_path: Path) -> None:
    library = ReadLibrary(tmp_path)
    bag = ros1_bag(tmp_path.parent / f"{tmp_path.name}.bag").read_bytes()
    for name, data in (("a.bag", bag), ("b.bag.gz", gzip.compress(bag)), ("c.BIN", dataflash())):
        path = library.incoming(name)
        path.write_bytes(data)
        entry = library.upload(path)
        assert entry.path.name == name
        out = io.BytesIO()
        full_recording(entry.path, entry.title, entry.edits, entry.probe.format, out)
        assert out.getvalue() == data
    path = library.incoming("people.db3")
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE people (name TEXT)")
    with pytest.raises(RecordingError, match="not a ROS 2 bag"):
        library.upload(path)
    assert json.dumps(sorted(entry.path.name for entry in library.all())) == '["a.bag", "b.bag.gz", "c.BIN"]'
    assert {".bag", ".db3", ".ulg", ".zip", ".parquet", ".npz", ".mat"} <= set(suffixes())


def test_an_archive_that_was_cut_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    """A short one was refused, and of a long one nobody said that the end is missing."""
    for count in (COUNT, 50 * COUNT):
        lines = "".join(f"{n / 100:.2f},{n % 7}\n" for n in range(count))
        packed = gzip.compress(f"time (s),gx\n{lines}".encode())
        path = tmp_path / f"log-{count}.csv.gz"
        path.write_bytes(packed[: 2 * len(packed) // 3])
        store = opened(path, tmp_path / f"store-{count}")
        assert count / 3 < len(rows_of(store, "gx").time) < count
        assert f"{path.name} is damaged or was cut: Truncated compressed stream." in damage_of(store)


def test_what_a_zip_has_beside_a_bag_is_reported(tmp_path: Path) -> None:
    """It was forgotten when the bag was read."""
    bag = ros1_bag(tmp_path / "a.bag").read_bytes()
    store = opened(zipped(tmp_path / "log.zip", {"a.bag": bag, "README.txt": b"hello"}), tmp_path)
    assert "Of log.zip these are left out: README.txt." in damage_of(store)


@each_row(
    ("data", "words"),
    [
        (bytes(1000), "All its bytes are 0, as after a copy that failed"),
        (b"Dear all,\nplease find the log attached.\n\xc3\xa4", "It is a text without rows of numbers"),
        (bytes(range(256)) * 3, "It is binary, without a mark that is known"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12\n", "Fetch the file with git lfs pull"),
        (b"#ROSBAG V1.2\n" + bytes(200), "Migrate it with rosbag fix"),
    ],
    ids=["zeros", "text", "binary", "lfs", "old bag"],
)
def test_an_unknown_file_is_answered_with_what_it_seems_to_be(data: bytes, words: str, tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(data)
    with pytest.raises(RecordingError) as caught:
        open_file(path)
    assert words in f"{caught.value.message} {caught.value.hint}"


def test_a_table_of_a_heading_alone_is_reported_to_have_no_rows(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,gx,gy\n")
    with pytest.raises(RecordingError, match="has a heading, but no rows"):
        open_file(path)
