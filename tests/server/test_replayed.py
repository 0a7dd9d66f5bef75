"""A 3D scene that follows the player of a recording: paused it stands, moved it turns, with its page it is gone."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import Callable

import httpx
import pytest
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import InvalidStatus

from tests.looker import looking, turns
from tests.patience import PATIENCE_S, connecting
from tests.process import ServerProcess


@pytest.fixture
def recorded(serve: Callable[..., ServerProcess]) -> tuple[ServerProcess, str, float]:
    """A server, the id of a recording of some seconds, and when that began."""
    server = serve("twin:isb")
    with httpx.Client(base_url=server.url, timeout=60) as client:
        client.post("/api/recordings/start", json={"devices": None, "title": "a turn"}).raise_for_status()
        time.sleep(4)
        client.post("/api/recordings/stop", json={}).raise_for_status()
        deadline = time.monotonic() + PATIENCE_S
        while not (found := client.get("/api/recordings").json()):
            assert time.monotonic() < deadline
            time.sleep(0.1)
    return server, found[0]["id"], found[0]["started"]


async def seen(socket: ClientConnection, seconds: float) -> list[list[float]]:
    """The orientations that come meanwhile."""
    found: list[list[float]] = []
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(seconds):
            while True:
                found += turns(await socket.recv())
    return found


def test_a_scene_follows_the_player(recorded: tuple[ServerProcess, str, float]) -> None:
    server, recording, started = recorded
    asyncio.run(play(server.url, recording, started))


async def play(url: str, recording: str, started: float) -> None:
    page = f"{url.replace('http', 'ws', 1)}/ws/scene/{recording}"
    async with asyncio.timeout(120):
        async with connecting(page) as player:
            address = json.loads(await player.recv())["address"]

            async def at(t: float, rate: float) -> None:
                await player.send(json.dumps({"t": t, "rate": rate}))

            async with looking(url, address.rstrip("/")) as viewer:
                await at(started + 1.5, 0.0)
                first: list[list[float]] = []
                while not first:
                    first = await seen(viewer, 1)
                assert await seen(viewer, 1) == [], "paused it stands"
                await at(1e11, 0.0)  # beyond its end: its last row
                last: list[list[float]] = []
                while not last:
                    last = await seen(viewer, 1)
                assert last[-1] != first[-1]
                await at(started + 1.5, 0.0)
                back: list[list[float]] = []
                while not back:
                    back = await seen(viewer, 1)
                assert back[-1] == first[-1], "the same place is the same picture"
        with pytest.raises(InvalidStatus):
            async with looking(url, address.rstrip("/")):
                pass


def test_a_recording_that_is_not_there_has_no_scene(server: ServerProcess) -> None:
    async def attempt() -> None:
        async with connecting(server.url.replace("http", "ws", 1) + "/ws/scene/nothing"):
            pass

    with pytest.raises(InvalidStatus) as refused:
        asyncio.run(attempt())
    assert refused.value.response.status_code == 503
