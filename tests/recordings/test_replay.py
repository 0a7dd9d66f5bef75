"""A recording is replayed with the same bytes, in order and on time, at any speed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.source import McapSource
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.recordings.replay import TURN_NS, ReplayClock, ReplayedChunk, extent
from tests.support.each_row import each_row
from tests.support.manual_clock import ManualClock
from tests.support.source_files import ROOT

MS = 1_000_000
START = 1_760_000_000_000_000_000


def recording(folder: Path, chunks: int = 100, *, packed: bool = True, size: int = 20) -> Path:
    """Two devices, a chunk every 10 ms each, and answers to one of them."""
    path = folder / "drive.mcap"
    writer = McapWriter(path, {})
    for n in range(chunks):
        writer.chunk("1", "rx", bytes([n % 256]) * size, START + n * 10 * MS)
        writer.chunk("2", "rx", b"b%d" % n, START + n * 10 * MS + 3 * MS)
        if n % 10 == 0:
            writer.chunk("1", "tx", b"sent", START + n * 10 * MS + 1 * MS)
    writer.close()
    if packed:
        compact(path)
    return path


def played(replay: ReplayClock, clock: ManualClock[int], most: int = 10_000) -> list[tuple[int, ReplayedChunk]]:
    """All that it plays, with the time on the clock at which it did."""
    began = clock.now
    results: list[tuple[int, ReplayedChunk]] = []
    while (wait := replay.wait_ns()) is not None and len(results) < most:
        clock.now += wait
        batch = replay.due_chunks()
        assert batch, "what is due can be taken"
        results += [(clock.now - began, one) for one in batch]
    return results


@each_row("packed", [True, False])
def test_every_byte_is_played_when_it_is_due(tmp_path: Path, packed: bool) -> None:
    clock = ManualClock(5_000)
    source = McapSource(recording(tmp_path, packed=packed))
    results = played(ReplayClock(source, clock), clock)
    assert len(results) == 200
    assert [at for at, one in results] == [one.time_ns - START for _, one in results]
    assert b"".join(one.data for _, one in results if one.device == "1") == b"".join(
        bytes([n]) * 20 for n in range(100)
    )
    assert [one.device for _, one in results[:4]] == ["1", "2", "1", "2"]  # in step
    assert not any(one.restart for _, one in results)
    assert {one.direction for _, one in results} == {"rx"}


@each_row("speed", [0.1, 0.5, 2.0, 50.0])
def test_speed(tmp_path: Path, speed: float) -> None:
    clock = ManualClock(5_000)
    results = played(ReplayClock(McapSource(recording(tmp_path)), clock, speed=speed), clock)
    assert len(results) == 200
    for at, one in results:
        assert abs(at - (one.time_ns - START) / speed) <= 200  # ns: sums of rounded waits


def test_speed_pause_and_seek_while_it_plays(tmp_path: Path) -> None:
    clock = ManualClock(5_000)
    replay = ReplayClock(McapSource(recording(tmp_path)), clock)
    clock.now += 105 * MS
    assert len(replay.due_chunks()) == 22  # 0 … 100 and 3 … 103 ms
    replay.pause()
    clock.now += 1000 * MS
    assert replay.due_chunks() == []
    assert replay.wait_ns() is None
    assert replay.position_ns == START + 105 * MS
    replay.play()
    assert replay.wait_ns() == 5 * MS
    replay.speed = 10
    assert replay.wait_ns() == MS // 2
    replay.seek(START + 500 * MS)
    batch = replay.due_chunks()
    assert [one.time_ns for one in batch] == [START + 500 * MS]
    assert batch[0].restart
    clock.now += MS
    assert [(one.device, one.restart) for one in replay.due_chunks()] == [("2", True), ("1", False)]
    replay.seek(START)  # back, too
    assert replay.due_chunks()[0].time_ns == START


def test_seeking_to_a_moment_is_skipping_to_it(tmp_path: Path) -> None:
    source = McapSource(recording(tmp_path, chunks=3000, size=2000))  # several blocks
    clock = ManualClock(5_000)
    whole = played(ReplayClock(source, clock), clock)
    for at in (0, 7, 1234, 15_000, 29_999, 30_500):
        clock = ManualClock(5_000)
        replay = ReplayClock(source, clock)
        replay.seek(START + at * MS)
        rest = played(replay, clock)
        expected = [(one.device, one.data) for _, one in whole if one.time_ns >= START + at * MS]
        assert [(one.device, one.data) for _, one in rest] == expected


def test_a_range_and_a_loop(tmp_path: Path) -> None:
    source = McapSource(recording(tmp_path))
    clock = ManualClock(5_000)
    some = {"start_ns": START + 200 * MS, "stop_ns": START + 300 * MS}
    once = played(ReplayClock(source, clock, **some), clock)  # type: ignore[arg-type]
    assert [one.time_ns for _, one in once] == [START + (200 + 10 * n + d) * MS for n in range(10) for d in (0, 3)]
    clock = ManualClock(5_000)
    again = played(ReplayClock(source, clock, loop=True, **some), clock, 60)  # type: ignore[arg-type]
    assert [one.data for _, one in again] == [one.data for _, one in once] * 3
    assert [one.restart for _, one in again[:22]] == [False] * 20 + [True, True]
    assert again[20][0] - again[19][0] >= TURN_NS


def test_one_device_or_what_was_sent(tmp_path: Path) -> None:
    source = McapSource(recording(tmp_path))
    clock = ManualClock(5_000)
    assert {one.device for _, one in played(ReplayClock(source, clock, devices=["2"]), clock)} == {"2"}
    sent = played(ReplayClock(source, clock, ways=["tx"]), clock)
    assert b"".join(one.data for _, one in sent) == b"sent" * 10


def test_one_device_of_a_range_keeps_step_with_the_others(tmp_path: Path) -> None:
    source = McapSource(recording(tmp_path))
    clock = ManualClock(5_000)
    replay = ReplayClock(source, clock, devices=["2"], start_ns=START)
    assert replay.wait_ns() == 3 * MS


def test_after_a_stall_replay_continues_at_the_recorded_pace(tmp_path: Path) -> None:
    clock = ManualClock(5_000)
    replay = ReplayClock(McapSource(recording(tmp_path)), clock)
    replay.due_chunks()
    clock.now += 60_000 * MS  # a reader that does not read
    replay.note_stall()
    assert replay.wait_ns() == 0
    assert len(replay.due_chunks()) == 1
    assert replay.wait_ns() == 7 * MS


def test_times_that_run_backwards_count_as_those_before(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    writer = McapWriter(path, {})
    for n, at in enumerate((0, 20, 10, 30)):
        writer.chunk("1", "rx", b"%d" % n, START + at * MS)
    writer.close()
    clock = ManualClock(5_000)
    results = played(ReplayClock(McapSource(path), clock), clock)
    assert [(at // MS, one.data) for at, one in results] == [(0, b"0"), (20, b"1"), (20, b"2"), (30, b"3")]


def test_a_recording_of_nothing_has_ended(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    McapWriter(path, {}).close()
    for loop in (False, True):
        replay = ReplayClock(McapSource(path), ManualClock(5_000), loop=loop)
        assert replay.has_ended
        assert replay.due_chunks() == []
        assert replay.wait_ns() is None
        assert replay.position_ns is None


@each_row("packed", [True, False])
def test_the_extent_of_a_file(tmp_path: Path, packed: bool) -> None:
    source = McapSource(recording(tmp_path, chunks=3000, packed=packed, size=2000))
    assert extent(source) == (START, START + 29_993 * MS)


def test_in_a_loop_devices_that_are_played_apart_stay_in_step(tmp_path: Path) -> None:
    source = McapSource(recording(tmp_path, chunks=10))
    clock = ManualClock(5_000)
    span = extent(source)
    assert span is not None
    some = {"start_ns": span[0], "stop_ns": span[1] + 1, "loop": True}
    first = played(ReplayClock(source, clock, devices=["1"], **some), clock, 40)  # type: ignore[arg-type]
    clock = ManualClock(5_000)
    second = played(ReplayClock(source, clock, devices=["2"], **some), clock, 40)  # type: ignore[arg-type]
    assert [b - a for (a, _), (b, _) in zip(first, second, strict=True)] == [3 * MS] * 40


READ_WHILE_CUT = """
import os, sys
from pathlib import Path
from imuscope.recordings.mcap.reader import McapReader
with McapReader(Path(sys.argv[1])) as file:
    blocks = file.blocks()
    next(blocks)
    os.truncate(sys.argv[1], 4096)
    print(len(list(blocks)), *(damage.words for damage in file.damage))
"""


@each_row("packed", [True, False])
def test_a_file_that_is_made_shorter_while_it_is_read_ends_there(tmp_path: Path, packed: bool) -> None:
    """As `cp` over it does: the system ended the whole process, which may be a server with live devices."""
    path = recording(tmp_path, 20_000, packed=packed, size=400)
    command = [sys.executable, "-c", READ_WHILE_CUT, str(path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "0 The file was made shorter while it was read.\n"), done.stderr
