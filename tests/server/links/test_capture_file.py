"""A capture played by the device's own clock: pace, messages, end."""

from __future__ import annotations

import asyncio
import io
import time
from pathlib import Path

import numpy as np
import pytest

from imuscope.protocols.events import batches
from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.recordings.capture_timing import (
    BLIND_RATE,
    BLOCK_BYTES,
    LONGEST_PAUSE_NS,
    CaptureTiming,
    TimedBytes,
    play,
)
from imuscope.server.links.capture_file import FileLink
from imuscope.server.links.source_url import open_link
from tests.server.links.link_fixtures import dies, fails, frame, gather, joined, left_behind, opened, settings
from tests.support.each_row import each_row
from tests.support.timeouts import PATIENCE_S


def pieces_of(data: bytes) -> list[TimedBytes]:
    return list(CaptureTiming(io.BytesIO(data), PROTOCOLS["xbus"].decoding.decoder()))


def stream(seconds: float, rate: float = 100.0, start_s: float = 1000.0) -> bytes:
    """Frames with a SampleTimeFine in ticks of 0.1 ms."""
    count = round(seconds * rate)
    return b"".join(frame(i, round((start_s + i / rate) * 10_000)) for i in range(count))


def test_every_frame_is_due_at_its_device_time() -> None:
    data = stream(3.0)
    pieces = pieces_of(data)
    assert b"".join(piece.data for piece in pieces) == data
    assert len(pieces) == 300
    assert [piece.due_ns for piece in pieces] == [i * 10_000_000 for i in range(300)]
    assert not any(piece.blind for piece in pieces)


def test_a_real_capture_takes_as_long_as_its_clock_states(captures: Path) -> None:
    path = captures / "xbus/mti_100hz_49s.bin"
    data = path.read_bytes()
    pieces = pieces_of(data)
    assert b"".join(piece.data for piece in pieces) == data
    due = np.array([piece.due_ns for piece in pieces])
    assert (np.diff(due) >= 0).all()

    decoder = PROTOCOLS["xbus"].decoding.decoder()
    decoder.feed(data, 0)
    results = [batch for batch in batches(decoder.drain(stalled=True)) if "Quaternion" in batch.columns]
    times = np.concatenate([batch.time_ns for batch in results if batch.time_ns is not None])
    starts = np.concatenate([batch.offset for batch in results])
    assert due[-1] == times[-1] - times[0] == 47_450_000_000  # 4746 samples, 100 a second
    # Where each sample begins in the file, and when the piece that holds it was due:
    ends = np.cumsum([len(piece.data) for piece in pieces])
    came = due[np.searchsorted(ends, starts, side="right")]
    np.testing.assert_array_equal(came, times - times[0])


def test_memory_is_bounded_by_blocks_not_by_the_file() -> None:
    """The pieces of a long capture come while it is read, never after."""

    class Counting(io.BytesIO):
        reads = 0

        def read(self, size: int | None = -1, /) -> bytes:
            data = super().read(size)
            Counting.reads += len(data)
            return data

    data = stream(120.0)
    assert len(data) > 3 * BLOCK_BYTES
    count = 0
    for piece in CaptureTiming(Counting(data), PROTOCOLS["xbus"].decoding.decoder()):
        count += len(piece.data)
        assert Counting.reads - count <= 2 * BLOCK_BYTES


def test_bytes_between_clocked_frames_go_with_them() -> None:
    one, two = frame(0, 0), frame(1, 100)
    between = b"$GPTXT,01,01,02,noise*00\r\n\xfa\xff\x3e"
    data = b"before" + one + between + two + b"after"
    pieces = pieces_of(data)
    assert b"".join(piece.data for piece in pieces) == data
    assert pieces[0] == TimedBytes(b"before" + one + between, 0) or pieces[0].due_ns == 0
    assert pieces[-1].due_ns == 10_000_000


def test_a_clock_that_jumps_back_holds_the_pace_and_a_long_pause_is_skipped() -> None:
    data = stream(1.0, start_s=5000) + stream(1.0, start_s=100) + stream(1.0, start_s=4000)
    pace = CaptureTiming(io.BytesIO(data), PROTOCOLS["xbus"].decoding.decoder(), LONGEST_PAUSE_NS)
    due = [piece.due_ns for piece in pace]
    assert due == sorted(due)
    assert due[-1] == 2_990_000_000  # the first frame after a step is due a usual interval later
    assert pace.skipped_ns > 1000e9


@each_row("decoder", [None, "xbus"])
def test_without_a_clock_the_rate_of_a_full_line_is_used(decoder: str | None) -> None:
    data = bytes(range(200)) * 1000
    pieces = list(CaptureTiming(io.BytesIO(data), PROTOCOLS[decoder].decoding.decoder() if decoder else None))
    assert b"".join(piece.data for piece in pieces) == data
    assert all(piece.blind for piece in pieces)
    assert pieces[-1].due_ns == pytest.approx(len(data) / BLIND_RATE * 1e9, rel=1e-6)


@each_row("speed", [0.5, 1.0, 8.0])
def test_play_waits_until_each_piece_is_due(speed: float) -> None:
    now = 77

    def wait(seconds: float) -> bool:
        nonlocal now
        now += round(seconds * 1e9)
        return False

    came = [(piece.due_ns, now - 77) for piece in play(iter(pieces_of(stream(2.0))), lambda: now, wait, speed)]
    assert len(came) == 200
    for due_ns, at_ns in came:
        assert at_ns == pytest.approx(due_ns / speed, abs=100)


def test_play_stops_on_request() -> None:
    waited: list[float] = []

    def wait(seconds: float) -> bool:
        waited.append(seconds)
        return len(waited) == 3

    assert len(list(play(iter(pieces_of(stream(2.0))), lambda: 0, wait))) == 3


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    path = tmp_path / "drive.bin"
    path.write_bytes(stream(2.0))
    return path


async def test_a_file_plays_to_its_end_at_the_requested_speed(capture: Path) -> None:
    attempts: list[str] = []
    link = open_link(f"{capture}?speed=10", settings())
    start = time.monotonic()
    await link.open(lambda one: attempts.append(f"{one.what}: {one.outcome}"))
    chunks = await gather(link, capture.stat().st_size)
    took = time.monotonic() - start
    assert joined(chunks) == capture.read_bytes()
    assert took > 0.18  # how much longer is the machine's: `test_play_waits_until_each_piece_is_due` counts it
    stamps = np.array([chunk.arrival_ns for chunk in chunks])
    assert (np.diff(stamps) >= 0).all()
    error = await dies(link)
    assert error.kind == "ended"
    assert "drive.bin" in error.message
    assert "Xbus" in attempts[0]
    assert link.notices == []
    assert (await fails(link.write(b"x"))).kind == "refused"
    await link.close()


async def test_loop_begins_again(capture: Path) -> None:
    size = capture.stat().st_size
    async with opened(open_link(f"{capture}?speed=100&loop=1", settings())) as link:
        chunks = await gather(link, 3 * size)
        assert joined(chunks)[: 2 * size] == 2 * capture.read_bytes()
        sizes = np.array([len(chunk.data) for chunk in chunks])
        turns = (np.cumsum(sizes) - sizes)[[chunk.restart for chunk in chunks]]
        assert turns.tolist()[:2] == [size, 2 * size], "each turn but the first says that it begins again"


@each_row("at_once", [True, False])
async def test_a_short_stretch_of_another_protocol_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at_once: bool
) -> None:
    """Regression: in a fast replay the other protocol passed unnoticed between two checks."""
    if not at_once:
        monkeypatch.setattr("imuscope.server.links.capture_file.AT_ONCE_BYTES", 0)
    path = tmp_path / "mixed.bin"
    path.write_bytes(stream(5.0) + IdtpSimulator().advance(50_000_000) + stream(5.0))

    link = open_link(f"{path}?speed=2", settings())
    async with opened(link):
        async with asyncio.timeout(PATIENCE_S):
            while not link.notices:
                await asyncio.sleep(0.01)
        (notice,) = link.notices
        assert "mixed.bin holds messages of IDTP 2.1 too; it is read as Xsens MTi (Xbus)." in notice
    path.write_bytes(stream(5.0))
    async with opened(link):
        await asyncio.sleep(0 if at_once else 0.3)
        assert link.notices == []


async def test_a_slow_session_slows_the_file_down_and_uses_no_more_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("imuscope.server.links.capture_file.FULL_BYTES", 5000)
    path = tmp_path / "long.bin"
    path.write_bytes(stream(20.0))

    link = open_link(f"{path}?speed=1000", settings())
    assert isinstance(link, FileLink)
    async with opened(link):
        await asyncio.sleep(0.3)
        assert link.backlog < 5000 + BLOCK_BYTES
        assert joined(await gather(link, path.stat().st_size)) == path.read_bytes()


async def test_a_file_of_unknown_bytes_reports_its_playback_rate(tmp_path: Path) -> None:
    path = tmp_path / "noise.bin"
    path.write_bytes(b"nothing known " * 100)

    async with opened(open_link(f"{path}?speed=100", settings())) as link:
        assert f"{BLIND_RATE} B/s" in link.notices[0]
        assert joined(await gather(link, 1400)) == path.read_bytes()


def test_files_that_cannot_be_played(tmp_path: Path) -> None:
    (tmp_path / "empty.bin").touch()
    for name, kind in (("absent.bin", "not-found"), (".", "not-found"), ("empty.bin", "ended")):
        error = asyncio.run(fails(open_link(f"file://{tmp_path}/{name}", settings()).open()))
        assert error.kind == kind


def test_a_file_without_permission(capture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    error = asyncio.run(fails(open_link(str(capture), settings()).open()))
    assert error.kind == "denied"
    assert "chmod" in error.hint


async def test_no_threads_or_descriptors_are_left(capture: Path) -> None:
    before = left_behind()
    link = open_link(f"{capture}?loop=1", settings())
    for _ in range(3):
        async with opened(link):
            await link.read()
    assert left_behind() == before
