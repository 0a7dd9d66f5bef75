"""Written chunks reach the disk in order; a failing disk is reported."""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path

import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.mcap import live_writer as recording_writer
from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.live_writer import GATHER_S, TURN_S, Limits, RecordingWriter
from imuscope.recordings.mcap.reader import McapReader
from imuscope.recordings.mcap.source import McapSource
from imuscope.recordings.mcap.writer import McapWriter
from tests.recordings.mcap_files import Message, json_messages, read, theirs
from tests.support.each_row import each_row
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

ABOUT = {"title": "A drive"}


def named(folder: Path) -> Callable[[int], Path]:
    return lambda part: folder / f"drive-{part}.mcap"


def put(tape: RecordingWriter, n: int, size: int = 50, start: int = 0) -> list[Message]:
    expected = []
    for i in range(start, start + n):
        data = i.to_bytes(4, "big") * (size // 4)
        way = "tx" if i % 10 == 9 else "rx"
        tape.chunk("1", way, data, i + 1)  # type: ignore[arg-type]
        expected.append((f"{way}/1", i + 1, data))
    return expected


def test_all_data_are_in_the_file_in_order(tmp_path: Path) -> None:
    tape = RecordingWriter(named(tmp_path), ABOUT, time.time_ns)
    tape.device("1", {"protocol": "xbus"})
    expected = put(tape, 5000)
    tape.note("marker", "bump", 7, "1")
    tape.event({"kind": "link", "text": "gone"}, 8)
    tape.snapshot("1", {"values": {"Baudrate": {"rate": 2}}}, 9)
    expected += put(tape, 100, start=5000)
    tape.stop()
    assert tape.error is None
    assert tape.behind_s == 0.0
    path = tmp_path / "drive-1.mcap"
    chunks = [message for message in read(path) if message[0][:2] in ("rx", "tx")]
    assert chunks == expected
    assert theirs(path) == read(path)
    with McapReader(path) as recording:
        assert recording.meta("device/1") == {"protocol": "xbus"}
        assert list(json_messages(recording, "notes")) == [(7, {"kind": "marker", "text": "bump", "device": "1"})]
        assert list(json_messages(recording, "snapshot/1")) == [(9, {"values": {"Baudrate": {"rate": 2}}})]
        assert tape.bytes == recording.size


def test_queued_data_is_written_without_a_request(tmp_path: Path) -> None:
    """A process that is killed loses what is not in the file yet."""
    tape = RecordingWriter(named(tmp_path), ABOUT, time.time_ns)
    expected = put(tape, 100)
    block_until(lambda: read(tmp_path / "drive-1.mcap") == expected, "it is in the file")
    tape.stop()
    assert GATHER_S <= TURN_S <= 0.016  # of the allowed loss


def test_parts_follow_each_other_without_a_byte_between(tmp_path: Path) -> None:
    ended: list[Path] = []
    tape = RecordingWriter(named(tmp_path), ABOUT, time.time_ns, Limits(split_bytes=20_000), ended.append)
    tape.device("1", {"protocol": "xbus"})
    tape.device("1", {"product": "MTi-630"})
    expected: list[Message] = []
    for start in range(0, 2000, 100):
        expected += put(tape, 100, start=start)
        block_until(lambda: tape.behind_s == 0.0, "it is written")
    tape.stop()
    paths = sorted(tmp_path.iterdir(), key=lambda path: int(path.stem.split("-")[1]))
    assert len(paths) > 3
    assert ended == paths
    assert [message for path in paths for message in read(path)] == expected
    for n, path in enumerate(paths):
        with McapReader(path) as recording:
            list(recording.blocks())
            assert recording.whole
            about = recording.meta("recording")
            assert about["part"] == str(n + 1)
            assert about["previous"] == (paths[n - 1].stem if n else "")
            assert recording.meta("device/1") == {"protocol": "xbus", "product": "MTi-630"}
            assert recording.size < 40_000
        compact(path)
        assert theirs(path) == read(path)


def test_a_device_that_is_gone_is_not_in_all_later_parts(tmp_path: Path) -> None:
    """The part after it may begin with its last bytes."""
    tape = RecordingWriter(named(tmp_path), ABOUT, time.time_ns)
    for device in ("1", "1.7", "11"):
        tape.device(device, {"protocol": "xbus"})
        tape.snapshot(device, {"values": {}}, 9)
    tape.forget("1")
    for _ in range(2):
        tape.set_clock(0)
    tape.stop()
    paths = [tmp_path / f"drive-{part}.mcap" for part in (1, 2, 3)]
    assert [sorted(McapSource(path).devices) for path in paths] == [["1", "1.7", "11"], ["1", "1.7", "11"], ["11"]]
    with McapReader(paths[1]) as recording:
        assert not list(json_messages(recording, "snapshot/1"))
        assert list(json_messages(recording, "snapshot/11"))


def test_a_part_ends_when_it_is_old_enough(tmp_path: Path) -> None:
    clock = count(0, 1_000_000_000)  # every look at it is a second later
    tape = RecordingWriter(named(tmp_path), ABOUT, lambda: next(clock), Limits(split_s=30))
    expected = []
    for start in range(0, 400, 10):
        expected += put(tape, 10, start=start)
        block_until(lambda: not tape._queue, "it is written")
    tape.stop()
    paths = sorted(tmp_path.iterdir(), key=lambda path: int(path.stem.split("-")[1]))
    assert len(paths) >= 2
    assert [message for path in paths for message in read(path)] == expected


def test_a_full_disk_ends_the_recording_and_keeps_written_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    room = [3000]

    def write(fd: int, data: memoryview) -> int:
        if not room[0]:
            raise OSError(28, "No space left on device")
        batch = min(room[0], len(data))
        room[0] -= batch
        return int(real(fd, data[:batch]))

    real = os.write
    tape = RecordingWriter(named(tmp_path), ABOUT, time.time_ns)
    monkeypatch.setattr(os, "write", write)
    expected = put(tape, 500)
    block_until(lambda: not tape.running, "it has ended")
    monkeypatch.undo()
    tape.stop()
    assert tape.error is not None
    assert "disk is full" in tape.error.message
    assert "kept" in tape.error.hint
    path = read(tmp_path / "drive-1.mcap")
    assert 0 < len(path) < 500
    assert path == expected[: len(path)]
    room_for_one_more = 3000 - sum(len(data) + 31 for _, _, data in path)
    assert room_for_one_more < 31 + 50 + 200  # records that fitted are there; the channels' own records are the rest


def test_a_removed_folder_ends_the_recording_and_its_data_are_restored(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    tape = RecordingWriter(named(folder), ABOUT, time.time_ns)
    expected = put(tape, 100)
    block_until(lambda: tape.behind_s == 0.0, "it is written")
    shutil.rmtree(folder)
    block_until(lambda: not tape.running, "it has noticed")
    tape.stop()
    assert tape.error is not None
    assert "removed" in tape.error.message
    assert read(folder / "drive-1.mcap")[: len(expected)] == expected


def test_a_name_that_another_file_has_taken_loses_nothing(tmp_path: Path) -> None:
    tape = RecordingWriter(named(tmp_path), ABOUT, time.time_ns)
    expected = put(tape, 100)
    block_until(lambda: tape.behind_s == 0.0, "it is written")
    other = tmp_path / "other"
    other.write_bytes(b"somebody else's")
    os.replace(other, tmp_path / "drive-1.mcap")
    block_until(lambda: not tape.running, "it has noticed")
    tape.stop()
    assert tape.error is not None
    assert "drive-1-2.mcap" in tape.error.hint
    assert (tmp_path / "drive-1.mcap").read_bytes() == b"somebody else's"
    assert read(tmp_path / "drive-1-2.mcap")[: len(expected)] == expected


def test_a_file_that_another_program_shortens_costs_only_what_it_cut(tmp_path: Path) -> None:
    notices: list[str] = []
    parts: list[Path] = []
    tape = RecordingWriter(named(tmp_path), ABOUT, time.time_ns, on_part=parts.append, on_notice=notices.append)
    expected = put(tape, 2000)
    block_until(lambda: tape.behind_s == 0.0, "it is written")
    os.truncate(tmp_path / "drive-1.mcap", 50_000)
    expected += put(tape, 2000, start=2000)
    block_until(lambda: notices, "it has noticed")
    expected += put(tape, 2000, start=4000)
    tape.stop()
    assert tape.error is None
    assert parts == [tmp_path / "drive-1.mcap", tmp_path / "drive-2.mcap"]
    first, second = read(parts[0]), read(parts[1])
    assert (first + second)[-3990:] == expected[-3990:], "the record that was cut through swallows what it still claims"
    assert len(first + second) > 3990 + 50_000 // 100
    with pytest.raises(RecordingError, match="stays as it is"):
        compact(parts[0])
    assert read(parts[0]) == first


def test_a_clock_that_is_set_while_recording_begins_a_new_part_with_the_new_time(tmp_path: Path) -> None:
    tape = RecordingWriter(named(tmp_path), ABOUT, time.time_ns)
    put(tape, 10)
    tape.set_clock(1_000_000)
    put(tape, 10)
    tape.stop()
    times = [[at for _, at, _ in read(tmp_path / f"drive-{part}.mcap")] for part in (1, 2)]
    assert times == [list(range(1, 11)), list(range(1_000_001, 1_000_011))]


def test_a_recording_that_cannot_start_reports_the_cause(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="No such file"):
        RecordingWriter(named(tmp_path / "nowhere"), ABOUT, time.time_ns)


def test_a_slow_disk_delays_no_caller_and_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tape = RecordingWriter(named(tmp_path), ABOUT, time.time_ns)
    slow = McapWriter.runs
    goes_on = threading.Event()

    def chunks(self: McapWriter, result: list[tuple[str, str, bytes, int]]) -> None:
        goes_on.wait(PATIENCE_S)
        slow(self, result)  # type: ignore[arg-type]

    monkeypatch.setattr(McapWriter, "runs", chunks)
    now = time.time_ns()
    tape.chunk("1", "rx", b"first", now - 5_000_000_000)
    for i in range(1000):
        tape.chunk("1", "rx", b"later", now + i)
    assert tape.behind_s >= 5.0
    goes_on.set()
    tape.stop()
    assert len(read(tmp_path / "drive-1.mcap")) == 1001


class SyncCounter:
    """Counts of what the sync thread does: forcing a file to disk, and looking whether it is there."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.syncs = self.checks = 0
        sync, is_there = os.fdatasync, McapWriter.is_there

        def counted_sync(handle: int) -> None:
            self.syncs += 1
            sync(handle)

        def counted_check(writer: McapWriter) -> bool:
            self.checks += 1
            return is_there(writer)

        monkeypatch.setattr(os, "fdatasync", counted_sync)
        monkeypatch.setattr(McapWriter, "is_there", counted_check)


@each_row("sync_s", [0.0, 60.0])
def test_a_recording_is_not_forced_to_disk_before_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sync_s: float
) -> None:
    """A removed file is noticed all the same, and each part that is finished is on disk."""
    monkeypatch.setattr(recording_writer, "CHECK_S", 0.01)
    counter = SyncCounter(monkeypatch)
    folder = tmp_path / f"{sync_s:g}"
    folder.mkdir()
    tape = RecordingWriter(named(folder), ABOUT, time.time_ns, Limits(split_bytes=30_000), sync_s=sync_s)
    expected = put(tape, 10)
    block_until(lambda: counter.checks >= 5, "the file is looked at")
    assert counter.syncs == 0
    expected += put(tape, 1000, start=10)
    tape.device("1", {"protocol": "xbus"})  # a part ends between two writes
    expected += put(tape, 1000, start=1010)
    tape.stop()
    parts = sorted(folder.iterdir())
    assert len(parts) > 1
    assert counter.syncs == len(parts)
    assert sorted((one for path in parts for one in read(path)), key=lambda one: one[1]) == expected


def test_a_recording_is_forced_to_disk_once_in_the_time_that_was_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording_writer, "CHECK_S", PATIENCE_S)
    counter = SyncCounter(monkeypatch)
    tape = RecordingWriter(named(tmp_path), ABOUT, time.time_ns, sync_s=0.1)
    put(tape, 10)
    block_until(lambda: counter.syncs >= 2, "it is forced to disk twice")
    tape.stop()
