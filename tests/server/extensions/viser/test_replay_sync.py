"""A 3D scene that follows the player of a recording: it pauses, moves and ends with its page."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import InvalidStatus

from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.writer import McapWriter
from tests.server.extensions.viser.viser_client import turns, viewing
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, connecting

STARTED = 1.76e9  # unix s


@pytest.fixture
def recorded(tmp_path: Path) -> Iterator[ServerProcess]:
    """A server whose library has a recording of four seconds of a turning device."""
    (tmp_path / "recordings").mkdir()
    writer, device = McapWriter(tmp_path / "recordings" / "turn.mcap", {"title": "a turn"}), IsbSimulator(start_ns=0)
    writer.device("1", {"source": "/dev/ttyUSB0", "link": "serial", "baud": 921_600, "protocol": "isb"})
    for step in range(1, 400):
        if data := device.advance(step * 10_000_000):
            writer.chunk("1", "rx", data, round(STARTED * 1e9) + step * 10_000_000)
    writer.close()
    compact(tmp_path / "recordings" / "turn.mcap")
    with ServerProcess("udp://127.0.0.1:0", data=tmp_path) as server:
        yield server


async def other_turn(socket: ClientConnection, before: list[float]) -> list[float]:
    """The next orientation that differs from `before`."""
    while True:
        for turn in turns(await socket.recv()):
            if turn != before:
                return turn


def test_a_scene_follows_the_player(recorded: ServerProcess) -> None:
    asyncio.run(play(recorded.url))


async def play(url: str) -> None:
    page = f"{url.replace('http', 'ws', 1)}/ws/scene/turn"
    async with asyncio.timeout(3 * PATIENCE_S):  # which goes by when it does not stand while it is paused
        async with connecting(page) as player:
            address = json.loads(await player.recv())["address"]

            async def at(t: float) -> None:
                await player.send(json.dumps({"t": t, "rate": 0.0}))

            async with viewing(url, address.rstrip("/")) as viewer:
                records: list[list[float]] = [[]]
                # What comes first may be of the place before: a second round has seen every place. Beyond its end is
                # its last row.
                for place in 3 * [STARTED + 1.5, STARTED + 2.5, 1e11]:
                    await at(place)
                    records.append(await other_turn(viewer, records[-1]))
                assert records[-3:] == records[-6:-3], "the same place is the same picture"
        with pytest.raises(InvalidStatus):
            async with viewing(url, address.rstrip("/")):
                pass


def test_a_missing_recording_has_no_scene(server: ServerProcess) -> None:
    async def attempt() -> None:
        async with connecting(server.url.replace("http", "ws", 1) + "/ws/scene/nothing"):
            pass

    with pytest.raises(InvalidStatus) as refused:
        asyncio.run(attempt())
    assert refused.value.response.status_code == 404
