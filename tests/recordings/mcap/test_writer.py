"""A recording is a plain MCAP file, loses no written data, and has the same messages after compaction."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.mcap import compaction as packing
from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.reader import DATA, LENGTH, TIME, McapReader
from imuscope.recordings.mcap.writer import McapWriter
from tests.recordings.mcap_files import ABOUT, Message, json_messages, messages, read, theirs
from tests.support.each_row import each_row


def written(path: Path, chunks: int = 300, size: int = 40) -> list[Message]:
    """A small recording of everything there can be; what is in it, in order."""
    rng = np.random.default_rng(1)
    out: list[Message] = []
    writer = McapWriter(path, ABOUT)
    writer.device("1", {"source": "/dev/ttyUSB0", "protocol": "xbus", "baud": None})
    for n in range(chunks):
        time = 1_760_000_000_000_000_000 + n * 2_500_000
        way = "tx" if n % 50 == 49 else "rx"
        data = rng.integers(0, 256, int(rng.integers(1, size)), np.uint8).tobytes()
        writer.chunk("1" if n % 3 else "2", way, data, time)  # type: ignore[arg-type]
        out.append((f"{way}/{'1' if n % 3 else '2'}", time, data))
        if n % 100 == 7:
            event = {"kind": "gap", "level": "warning", "text": f"lost {n}"}
            writer.event(event, time)
            out.append(("events", time, json.dumps(event, separators=(",", ":")).encode()))
    writer.device("1", {"source": "/dev/ttyUSB0", "protocol": "xbus", "product": "MTi-630", "baud": 115200})
    writer.write_note("marker", "bump", 1_760_000_001_000_000_000, "1")
    out.append(("notes", 1_760_000_001_000_000_000, b'{"kind":"marker","text":"bump","device":"1"}'))
    writer.sync()
    writer.close()
    return out


def test_written_data_is_read_by_us_and_by_the_standard_reader(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    expected = written(path)
    assert read(path) == expected
    assert theirs(path) == expected


def test_a_packed_recording_is_the_same_messages_in_order(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    expected = written(path, chunks=6000, size=1000)  # several chunks of a megabyte
    before = path.stat()
    compact(path, edit={"title": "Another drive"})
    assert read(path) == expected
    assert theirs(path) == expected
    with McapReader(path) as recording:
        assert len(recording.chunks) >= 3
        assert not recording.damage
        assert recording.meta("recording") == {**ABOUT, "format": "1"}
        assert recording.meta("device/1")["product"] == "MTi-630"  # the last reported value
        assert recording.meta("edit") == {"title": "Another drive"}
    assert path.stat().st_mtime_ns == before.st_mtime_ns
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.mcap"]


def test_the_summary_of_a_packed_recording_is_right_for_the_standard_reader(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    expected = written(path, chunks=6000, size=1000)
    compact(path)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(expected)
        assert {record.name for record in reader.iter_metadata()} == {"recording", "device/1"}
        middle = expected[len(expected) // 2][1]
        later = list(reader.iter_messages(topics=["rx/1"], starting_at=middle))
    assert [message.data for *_, message in later] == [
        data for name, time, data in expected if name == "rx/1" and time >= middle
    ]


def test_a_short_recording_that_is_cut_keeps_what_stands_before(tmp_path: Path) -> None:
    """It was mostly one chunk: cut at three quarters, 9 messages of 1,618 were left."""
    path = tmp_path / "a.mcap"
    stored = written(path, chunks=1600, size=200)
    compact(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 3 // 4])
    left = read(path)
    assert left == stored[: len(left)]
    assert len(left) > len(stored) * 2 // 3


def test_blocks_outside_a_span_are_not_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    expected = written(path, chunks=6000, size=1000)
    compact(path)
    last = expected[-2][1]
    with McapReader(path) as recording:
        blocks = list(recording.blocks(last - 1_000_000, last))
        assert 1 <= len(blocks) < len(recording.chunks)
        assert last in np.concatenate([block.table[TIME] for block in blocks])


@given(cut=st.floats(0, 1), packing=st.booleans())
def test_a_recording_cut_at_any_byte_yields_a_prefix_and_reports_it(
    tmp_path_factory: pytest.TempPathFactory, cut: float, packing: bool
) -> None:
    path = tmp_path_factory.mktemp("cut") / "a.mcap"
    expected = written(path)
    if packing:
        compact(path)
    size = path.stat().st_size
    keep = 8 + int(cut * (size - 8))
    os.truncate(path, keep)
    with McapReader(path) as recording:
        results = messages(recording)
        assert results == expected[: len(results)]
        assert keep == size or not recording.whole
        if not packing:
            assert len(results) >= len(expected) * (keep / size) * 0.8 - 12  # the summary is the rest of the file
            assert len(results) == len(expected) or recording.damage or not recording.whole


@given(st.data())
def test_flipped_bytes_never_raise(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    path = tmp_path_factory.mktemp("hurt") / "a.mcap"
    written(path, chunks=60)
    if data.draw(st.booleans()):
        compact(path)
    raw = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(8, len(raw) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(raw)
    with McapReader(path) as recording:
        for block in recording.blocks():
            assert (block.table[DATA] + block.table[LENGTH] <= len(block.data)).all()


def test_a_damaged_chunk_is_reported_and_the_others_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    expected = written(path, chunks=6000, size=1000)
    compact(path)
    with McapReader(path) as recording:
        second = recording.chunks[1]
    raw = bytearray(path.read_bytes())
    raw[second.chunk_start_offset + second.chunk_length // 2] ^= 0xFF
    path.write_bytes(raw)
    with McapReader(path) as recording:
        results = messages(recording)
        assert len(recording.damage) == 1
        assert "chunk" in recording.damage[0].words
    assert results[0] == expected[0]
    assert results[-1] == expected[-1]
    assert 0 < len(expected) - len(results) < len(expected)


def damaged(path: Path, at: int, size: int) -> list[Message]:
    """A recording of which these bytes are garbage; what it held."""
    expected = written(path, chunks=4000, size=200)
    raw = bytearray(path.read_bytes())
    raw[at : at + size] = np.random.default_rng(2).integers(0, 256, size, np.uint8).tobytes()
    path.write_bytes(raw)
    return expected


def test_packing_keeps_a_recording_with_good_data_behind_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    expected = damaged(path, 1000, 20_000)
    before = path.read_bytes()
    with pytest.raises(RecordingError, match="damaged and stays"):
        compact(path)
    assert path.read_bytes() == before
    with McapReader(path) as recording:
        results = messages(recording)
        assert any("left out" in damage.words for damage in recording.damage)
    assert len([one for one in results if one not in expected]) <= 2, (
        "but for the ends of the damage, nothing is made up"
    )
    assert results[-1] == expected[-1]
    assert len(expected) - len(results) < 20_000 // 100 + 20, "all that stands behind the damage is read"


@each_row("opcode", [2, 15])  # of the footer, of the end of the data
def test_garbage_that_resembles_the_footer_hides_no_data(tmp_path: Path, opcode: int) -> None:
    path = tmp_path / "a.mcap"
    expected = written(path, chunks=500)
    raw = path.read_bytes()
    at = raw.index(expected[100][2]) - 31
    path.write_bytes(raw[:at] + bytes([opcode]) + raw[at + 1 :])
    with McapReader(path) as recording:
        assert messages(recording) == expected[:100] + expected[101:]
        assert len(recording.damage) == 1


def test_a_recording_that_ends_in_zeros_is_torn_and_packed(tmp_path: Path) -> None:
    """As a power cut leaves it on some file systems."""
    path = tmp_path / "a.mcap"
    expected = written(path, chunks=500)
    raw = path.read_bytes()
    at = raw.index(expected[300][2]) - 31
    path.write_bytes(raw[:at] + bytes(100_000))
    compact(path)
    assert read(path) == expected[:300]


def test_packing_compares_before_it_replaces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.mcap"
    expected = written(path, chunks=500)

    def less(source: McapReader, out: BinaryIO, **options: Any) -> None:
        shorter = tmp_path / "shorter.mcap"
        shorter.unlink(missing_ok=True)
        written(shorter, chunks=499)
        with McapReader(shorter) as other:
            real(other, out, **options)
        list(source.blocks())

    real = packing.write_compacted
    monkeypatch.setattr(packing, "write_compacted", less)
    with pytest.raises(RecordingError, match="does not hold the same"):
        compact(path)
    assert read(path) == expected


def test_a_recording_that_claims_to_hold_more_is_not_packed(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    expected = written(path, chunks=500)
    raw = path.read_bytes()
    at = raw.index(expected[200][2]) - 31
    size = 31 + len(expected[200][2])
    path.write_bytes(raw[:at] + bytes([0x80]) + raw[at + 1 : at + size] + raw[at + size :])  # an unknown kind
    with pytest.raises(RecordingError, match="stays as it is"):
        compact(path)
    assert len(read(path)) == len(expected) - 1


CHILD = """
import sys, time
from pathlib import Path
from imuscope.recordings.mcap.writer import McapWriter
writer = McapWriter(Path(sys.argv[1]), {})
n = 0
while True:
    writer.chunk("1", "rx", n.to_bytes(4, "little") * 25, time.time_ns())
    n += 1
    print(n, flush=True)
"""


def test_kill_9_loses_nothing_that_was_handed_over(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(path)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    report = 0
    while report < 500:
        report = int(child.stdout.readline())
    child.send_signal(signal.SIGKILL)
    rest = child.stdout.read().splitlines()
    child.wait()
    child.stdout.close()
    report = max([report, *(int(line) for line in rest if line.isdigit())][:-1] or [report])
    with McapReader(path) as recording:
        results = messages(recording)
    assert len(results) >= report
    assert [int.from_bytes(data[:4], "little") for _, _, data in results] == list(range(len(results)))
    with path.open("rb") as file:  # and the standard reader that does not look for an end agrees up to the tear
        count = 0
        with contextlib.suppress(McapError):  # it reports that the end is missing
            for _ in NonSeekingReader(file).iter_messages(log_time_order=False):
                count += 1
        assert count == len(results)


def test_a_full_disk_is_one_sentence_and_what_is_written_stays(tmp_path: Path) -> None:
    """A limit of the file's size stands for the disk: both fail in the middle of a record."""
    path = tmp_path / "a.mcap"
    writer = McapWriter(path, ABOUT)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, hard))
    failed: RecordingError | None = None
    n = 0
    try:
        for n in range(100):
            try:
                writer.chunk("1", "rx", bytes(1000), n)
            except RecordingError as error:
                failed = error
                break
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    assert failed is not None
    assert failed.message.endswith(": a.mcap.")
    with McapReader(path) as recording:
        assert len(messages(recording)) == n
        assert not recording.damage  # cut back to the last whole record
    with pytest.raises(RecordingError, match="closed"):
        writer.chunk("1", "rx", b"more", 0)
    writer.close()  # closing twice is harmless


def test_a_disk_that_is_full_from_the_start_leaves_no_empty_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(handle: int, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(RecordingError, match="disk is full"):
        McapWriter(tmp_path / "a.mcap", ABOUT)
    assert list(tmp_path.iterdir()) == []


def test_notes_are_found_by_topic(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    written(path)
    with McapReader(path) as recording:
        notes: list[Any] = [body for _, body in json_messages(recording, "notes")]
    assert notes == [{"kind": "marker", "text": "bump", "device": "1"}]


@each_row("content", [b"", b"no MCAP at all", b"\x89MCAP0\r\n"])
def test_invalid_mcap_files_are_reported_or_empty(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    if content[:1] == b"\x89":
        assert read(path) == []
    else:
        with pytest.raises(RecordingError):
            McapReader(path)


def test_a_name_that_is_taken_is_not_written_over(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"precious")
    with pytest.raises(RecordingError, match="already"):
        McapWriter(tmp_path / "a.mcap", {})
    assert (tmp_path / "a.mcap").read_bytes() == b"precious"
