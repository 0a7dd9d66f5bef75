"""A recording as a source: unchanged bytes of each device, and errors."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.recordings.replay import ReplayClock
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.links.base import Chunk, Link, LinkError, steady_clock
from imuscope.server.links.replay import ReplayLink, split_devices
from imuscope.server.links.source_url import open_link
from imuscope.server.settings.config import Config
from tests.server.links.link_fixtures import fails, joined, left_behind, opened, settings, xbus
from tests.server.links.replayed import START, device_bytes, of, recording
from tests.support.each_row import each_row
from tests.support.in_process_server import InProcessServer
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until


async def drained(link: Link) -> tuple[list[Chunk], LinkError]:
    """Remaining bytes of a link, and its final error."""
    chunks: list[Chunk] = []
    async with asyncio.timeout(PATIENCE_S):
        while True:
            try:
                chunks += await link.read()
            except LinkError as error:
                return chunks, error


async def to_the_end(source: str) -> tuple[list[Chunk], LinkError]:
    """All that a source gives, and how it ended."""
    async with opened(open_link(source, settings())) as link:
        return await drained(link)


def test_a_recording_is_played_byte_for_byte(tmp_path: Path) -> None:
    path = recording(tmp_path, devices=1)
    asyncio.run(to_the_end(f"{path}?speed=100"))  # what forks its process in tests stays
    before = left_behind()
    chunks, error = asyncio.run(to_the_end(f"{path}?speed=10"))
    assert joined(chunks) == of(1)
    assert len(chunks) == 100  # as received, not joined
    assert error.kind == "ended"
    assert left_behind() == before


def test_the_pace_is_that_of_the_recording(tmp_path: Path) -> None:
    """Not quicker than from its opening; how much later depends on the machine, for the first piece as for the last."""
    path = recording(tmp_path, devices=1)
    opening = steady_clock()()
    chunks, _ = asyncio.run(to_the_end(f"{path}?speed=2"))
    took = (chunks[-1].arrival_ns - opening) / 1e9
    assert took >= 0.99 / 2 - 0.001


def test_each_device_of_a_recording_is_a_source(tmp_path: Path) -> None:
    path = recording(tmp_path)
    assert asyncio.run(split_devices(f"{path}?speed=10")) == [
        f"{path}?speed=10&device=1&protocol=xbus",
        f"{path}?speed=10&device=2&protocol=xbus",
    ]
    assert asyncio.run(split_devices(f"{path}?device=2")) == [f"{path}?device=2"]
    assert asyncio.run(split_devices("/dev/ttyUSB0")) == ["/dev/ttyUSB0"]
    assert asyncio.run(split_devices("sim:xbus")) == ["sim:xbus"]
    chunks, _ = asyncio.run(to_the_end(f"{path}?speed=20&device=2"))
    assert joined(chunks) == of(2)


def test_a_stretch_and_a_loop(tmp_path: Path) -> None:
    path = recording(tmp_path, devices=1)
    chunks, _ = asyncio.run(to_the_end(f"{path}?speed=10&from=0.2&to=0.3"))
    assert joined(chunks) == of(1, 20, 30)

    async def looped() -> list[Chunk]:
        chunks: list[Chunk] = []
        async with opened(open_link(f"{path}?speed=10&from=0.2&to=0.3&loop=1", settings())) as link:
            async with asyncio.timeout(PATIENCE_S):
                while len(chunks) < 25:
                    chunks += await link.read()
        return chunks

    chunks = asyncio.run(looped())
    assert joined(chunks[:20]) == of(1, 20, 30) * 2
    assert [chunk.restart for chunk in chunks[:21]] == [False] * 10 + [True] + [False] * 9 + [True]


def test_devices_that_are_opened_together_keep_step(tmp_path: Path) -> None:
    path = recording(tmp_path, frames=200)  # 2 s: longer than the process of the second takes to start

    async def both() -> list[list[Chunk]]:
        first, second = (open_link(f"{path}?device={n}", settings()) for n in (1, 2))
        async with opened(first):
            await asyncio.sleep(0.2)  # the second is late …
            async with opened(second):
                return [(await drained(link))[0] for link in (first, second)]

    one, two = asyncio.run(both())
    assert (joined(one), joined(two)) == (of(1, 0, 200), of(2, 0, 200))
    late = [b.arrival_ns - a.arrival_ns for a, b in zip(one, two, strict=True)]
    assert late[0] > 100_000_000
    assert min(late) < 50_000_000  # … and catches up


@each_row(
    ("options", "words"),
    [
        ("?device=9", "holds no device '9'"),
        ("?speed=0", "speed is '0'"),
        ("?from=3&to=2", "before it begins"),
        ("?rate=3", "has no option 'rate'"),
        ("", "holds 2 devices"),
    ],
)
def test_unplayable_sources_are_reported(tmp_path: Path, options: str, words: str) -> None:
    path = recording(tmp_path)

    async def check() -> None:
        await open_link(f"{path}{options}", settings()).open()

    error = asyncio.run(fails(check()))
    assert words in error.message
    assert error.kind == "bad-source"


def test_a_recording_without_bytes_has_ended(tmp_path: Path) -> None:
    path = tmp_path / "nothing.mcap"
    McapWriter(path, {}).close()
    error = asyncio.run(fails(open_link(str(path), settings()).open()))
    assert error.kind == "ended"
    gone = open_link(f"{path}?from=1", settings())
    path.unlink()
    assert asyncio.run(fails(gone.open())).kind == "not-found"


def test_a_recording_that_cannot_be_read_any_more_gives_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a bag whose next turn finds another file: the thread ended without a word, and the device stayed live."""

    def due_chunks(replay: ReplayClock, most: int = 0) -> NoReturn:
        raise RecordingError("drive.db3 is damaged.", "Copy it again.")

    monkeypatch.setattr(ReplayClock, "due_chunks", due_chunks)
    chunks, error = asyncio.run(to_the_end(f"{recording(tmp_path, devices=1)}?loop=1"))
    assert (chunks, error.kind, error.message, error.hint) == ([], "gone", "drive.db3 is damaged.", "Copy it again.")


def test_a_capture_can_be_played_from_somewhere_too(tmp_path: Path) -> None:
    path = tmp_path / "capture.bin"
    path.write_bytes(of(1))
    link = open_link(f"{path}?speed=10&from=0.5", settings())
    assert isinstance(link, ReplayLink)
    chunks, _ = asyncio.run(to_the_end(f"{path}?speed=10&from=0.5"))
    assert of(1).endswith(joined(chunks))
    assert 45 <= len(chunks) <= 51


# ── over HTTP ────────────────────────────────────────────────────────────────────────────────────────────────────────


@pytest.fixture
def running(tmp_path: Path) -> Iterator[InProcessServer]:
    (tmp_path / "recordings").mkdir()
    recording(tmp_path / "recordings")
    config = Config(sources=("/dev/none",), data=tmp_path)
    with InProcessServer(config, open_link, all_protocols()) as running:
        yield running


def test_playing_a_recording_makes_its_devices_appear(running: InProcessServer) -> None:
    client = running.client
    appeared = client.post("/api/recordings/drive/play", json={"loop": True})
    assert appeared.status_code == 201, appeared.text
    assert [device["protocol"] for device in appeared.json()] == ["xbus", "xbus"]
    ids = {device["id"] for device in appeared.json()}

    def live() -> set[str]:
        return {device["id"] for device in client.get("/api/devices").json() if device["status"] == "live"}

    block_until(lambda: ids <= live(), "both are live")
    assert client.post("/api/recordings/drive/play", json={"loop": True}).json()["kind"] == "busy"
    stretch = client.post("/api/recordings/drive/play", json={"t0": START / 1e9 + 0.2, "t1": START / 1e9 + 0.4})
    assert "from=0.2" in stretch.json()[0]["source"]


@each_row(
    ("name", "body", "status"),
    [
        ("none", {}, 404),
        (".drive", {}, 404),
        ("drive", {"speed": 0}, 422),
        ("drive", {"t0": START / 1e9 + 2, "t1": START / 1e9 + 1}, 422),
        ("drive", {"speed": "fast"}, 422),
    ],
)
def test_unplayable_sources_over_http(running: InProcessServer, name: str, body: dict[str, Any], status: int) -> None:
    answer = running.client.post(f"/api/recordings/{name}/play", json=body)
    assert answer.status_code == status
    assert set(answer.json()) == {"kind", "message", "hint"}


def test_the_test_frames_are_valid() -> None:
    assert xbus(0x36, device_bytes(1, 0)[4:-1]) == device_bytes(1, 0)
