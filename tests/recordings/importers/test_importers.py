"""Files of other programs: every record of the vendor's logs has its listed values, and damage never raises."""

from __future__ import annotations

import functools
import json
import math
import shutil
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.protocols.isb.logs import HEADER, MARKER
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.readers.vendor_logs import log_name, parts_of
from imuscope.recordings.sources import Source
from tests.protocols.isb.isb_vectors import leaves
from tests.recordings.readers.vendor_logs import LOGS, NAME, needs_logs
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

CAPTURES = ROOT.parent / "shared" / "captures" / "xbus"

needs_captures = pytest.mark.skipif(not CAPTURES.exists(), reason="the device captures are not beside this project")


def lines_of(source: Source) -> list[dict[str, Any]]:
    """Every ISB packet of a file as plain values, in order."""
    listing = PROTOCOLS["isb"].frames.listing()
    results: list[dict[str, Any]] = []
    for part in source.parts():
        listing.feed(part.data)
        results += listing.drain()
    results += listing.drain(stalled=True)
    return [line for line in results if line.get("protocol") == "isb"]


@functools.cache
def lines_of_log(suffix: str) -> list[dict[str, Any]]:
    """Records of the vendor's log, which take seconds to read; tests must not modify them."""
    return lines_of(open_file(LOGS / f"{NAME}.{suffix}"))


def listed(name: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (LOGS / name).read_text().splitlines()]


@needs_logs
@each_row("suffix", ["raw", "dat"])
def test_the_vendors_logs_have_their_listed_values(suffix: str) -> None:
    source = open_file(LOGS / f"{NAME}.{suffix}")
    expected = [line for line in listed(f"{suffix}.values.jsonl") if "did" in line]
    results = lines_of_log(suffix)
    assert len(results) == len(expected) > 1000
    for got, line in zip(results, expected, strict=True):
        assert got["id"] == line["did"]
        have, want = leaves(got["fields"]), leaves(line["fields"])
        for name in want.keys() & have.keys():
            for a, b in zip(have[name], want[name], strict=False):
                assert a == b or math.isclose(a, b, rel_tol=1e-7, abs_tol=1e-12), (line["n"], name)
        assert want.keys() & have.keys()
    assert not source.damage
    assert source.devices["1"].identity["serial_number"] == "60339"


@needs_logs
def test_the_index_gives_the_arrival_times(tmp_path: Path) -> None:
    shutil.copy(LOGS / f"{NAME}.raw", tmp_path)
    by_clock = list(open_file(tmp_path / f"{NAME}.raw").parts())
    lasts_ms = int(by_clock[-1].times[-1] - by_clock[0].times[0]) // 1_000_000
    size = (tmp_path / f"{NAME}.raw").stat().st_size
    rows = [(lasts_ms * n // 100, size * n // 100, n, 0) for n in range(100)]
    rows.insert(50, (rows[50][0], rows[48][1], 50, 0))  # as the vendor's writer does at times
    (tmp_path / f"{NAME}.idx").write_bytes(np.array(rows, "<u4").tobytes())
    source = open_file(tmp_path / f"{NAME}.raw")
    assert source.timed
    (part,) = source.parts()
    name = log_name(source.path)
    assert name is not None
    assert part.times[0] == name.started_ns + rows[1][0] * 1_000_000
    assert part.ends[0] == rows[1][1]
    assert part.ends[-1] == len(part.data) == size
    assert (np.diff(part.times) >= 0).all()


@needs_logs
def test_an_index_that_contradicts_the_device_clock_is_ignored() -> None:
    """The logs beside this project were written in 47 ms."""
    source = open_file(LOGS / f"{NAME}.raw")
    assert not source.timed
    parts = list(source.parts())
    assert parts[-1].times[-1] - parts[0].times[0] > 1e9


@needs_logs
def test_a_log_without_an_index_goes_by_its_own_clock(tmp_path: Path) -> None:
    shutil.copy(LOGS / f"{NAME}.raw", tmp_path)
    source = open_file(tmp_path / f"{NAME}.raw")
    assert not source.timed
    times = np.concatenate([part.times for part in source.parts()])
    assert (np.diff(times) >= 0).all()
    assert times[-1] > times[0]


@needs_logs
@each_row("suffix", ["raw", "dat"])
def test_a_split_log_is_one(suffix: str, tmp_path: Path) -> None:
    """Cut where it may be: a raw log anywhere, a .dat between its chunks."""
    whole = (LOGS / f"{NAME}.{suffix}").read_bytes()
    at = len(whole) // 2 if suffix == "raw" else HEADER.size + int.from_bytes(whole[16:20], "little")
    for number, data in enumerate((whole[:at], whole[at:]), start=1):
        (tmp_path / f"{NAME[:-4]}{number:04}.{suffix}").write_bytes(data)
    files = parts_of(tmp_path / f"{NAME[:-4]}0002.{suffix}")
    assert [file.stem[-4:] for file in files] == ["0001", "0002"]
    again = lines_of(open_file(files[0]))
    assert [line["fields"] for line in again] == [line["fields"] for line in lines_of_log(suffix)]


@needs_logs
def test_old_headers_are_read(tmp_path: Path) -> None:
    """Version 1 has a classification where version 2 has an offset; data follow its 40 bytes."""
    data = bytearray((LOGS / f"{NAME}.dat").read_bytes())
    at = 0
    while at < len(data):
        size = int.from_bytes(data[at + 16 : at + 20], "little")
        data[at + 4 : at + 8] = b"\x01\x00U "
        at += HEADER.size + size
    (tmp_path / "a.dat").write_bytes(data)
    assert len(lines_of(open_file(tmp_path / "a.dat"))) == len(lines_of_log("dat"))


@functools.cache
def a_few_records() -> bytes:
    """The first records of the vendor's log, a hundred in a chunk."""
    records, at = (LOGS / f"{NAME}.dat").read_bytes(), HEADER.size
    chunks = []
    for _ in range(5):
        begin = at
        for _ in range(100):
            at += 5 + int.from_bytes(records[at + 1 : at + 3], "little")  # number, size, offset, data
        chunks.append(dat(records[begin:at]))
    return b"".join(chunks)


@needs_logs
@each_row("seed", range(20))
def test_a_damaged_log_is_read_around_its_damage(seed: int, tmp_path: Path) -> None:
    data = bytearray(a_few_records())
    rng = np.random.default_rng(seed)
    for at in rng.integers(4, len(data), 3):
        data[at] ^= int(rng.integers(1, 256))
    cut = int(rng.integers(len(data) // 2, len(data)))
    (tmp_path / "a.dat").write_bytes(data[:cut])
    source = open_file(tmp_path / "a.dat")
    assert len(lines_of(source)) > 0
    if cut < len(data) - 5:
        assert source.damage


def dat(records: bytes) -> bytes:
    """A log of one chunk."""
    name, size = b"PDAT", len(records)
    inverse = bytes(byte ^ 0xFF for byte in name)
    return (
        HEADER.pack(MARKER, 2, 34, 2, 0, name, inverse, size, size ^ 0xFFFFFFFF, 0, 60339, 0, 0, 2, 0, 0, 0) + records
    )


def test_bad_bytes_in_a_log_cost_the_records_they_are_in(tmp_path: Path) -> None:
    """Fifty bytes in the first records of a chunk: all others are read."""
    imu = b"".join(b"\x3a\x24\x00\x00\x00" + struct.pack("<d6fI", 10 + i / 100, *6 * (0.5,), 0) for i in range(1000))
    data = bytearray(dat(imu))
    for at in range(HEADER.size + 90, HEADER.size + 140):
        data[at] = at * 37 % 256
    (tmp_path / "log.dat").write_bytes(data)
    (tmp_path / "renamed.bin").write_bytes(data)
    for name in ("log.dat", "renamed.bin"):
        source = open_file(tmp_path / name)
        assert (source.format, source.devices["1"].protocol) == ("dat", "isb")
        assert len(lines_of(source)) >= 995
        assert source.damage


@needs_captures
def test_a_headerless_capture_is_recognised_and_timed_by_its_clock() -> None:
    source = open_file(CAPTURES / "mti_100hz_49s.bin")
    assert source.devices["1"].protocol == "xbus"
    assert not source.timed
    parts = list(source.parts())
    assert b"".join(part.data for part in parts) == source.path.read_bytes()
    times = np.concatenate([part.times for part in parts])
    assert (np.diff(times) >= 0).all()
    assert 45e9 < times[-1] - times[0] < 55e9
    assert parts[-1].done == 1.0


def test_an_mtb_file_is_xbus_whatever_it_begins_with(tmp_path: Path) -> None:
    (tmp_path / "a.mtb").write_bytes(bytes.fromhex("FAFF3E00C3"))
    assert open_file(tmp_path / "a.mtb").devices["1"].protocol == "xbus"


@each_row(("name", "content"), [("a.bin", b""), ("a.bin", b"\x55" * 5000), ("a.txt", b"hello\n" * 50)])
def test_unknown_files_are_reported(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError) as failed:
        open_file(tmp_path / name)
    assert failed.value.message.endswith(".")
    assert failed.value.hint
