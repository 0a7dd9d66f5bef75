"""Many clients at once: no client's behaviour costs another one a sample.

The same at length, with its figures, is tests/bench/load.py.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
import urllib.request
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from imuscope.server.api.websocket import REQUESTS_AT_ONCE, REQUESTS_PER_S
from imuscope.server.concurrency.limiters import TokenBucket
from imuscope.server.settings.config import Config
from imuscope.server.wire import SUBPROTOCOL
from tests.bench.support.serial_devices import Speakers, received_in
from tests.support import load_clients
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, connect
from tests.support.waiting import until

PROTOCOL = Subprotocol(SUBPROTOCOL)
RATE, SECONDS, DEVICES = 500.0, 3.0, 2


async def crowded(server: ServerProcess, speakers: Speakers) -> tuple[load_clients.Good, dict[str, Any]]:
    """One client that keeps up, beside a stalled, a slow and a flooding one."""
    good, flood = load_clients.Good(), [0]
    tasks = [
        asyncio.create_task(good.run(server.url)),
        asyncio.create_task(load_clients.stalled(server.url, [])),
        asyncio.create_task(load_clients.slow(server.url, 20_000)),
        asyncio.create_task(load_clients.flooding(server.url, flood)),
    ]
    began = time.monotonic()
    try:
        await asyncio.wait_for(good.subscribed.wait(), 60)
        await asyncio.to_thread(speakers.go)
        sent = await asyncio.to_thread(speakers.sent)
        frames = sent["devices"][0]["frames"]
        await until(lambda: sum(n == frames for n in good.samples.values()) >= 3 * DEVICES, f"{good.samples} {frames}")
        await until(lambda: flood[0] > 0, "the flood is served, too")
        most = REQUESTS_AT_ONCE + REQUESTS_PER_S * (time.monotonic() - began)
        assert flood[0] < most, "at its pace, and no faster"
        return good, sent
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def test_many_clients_lose_no_sample(tmp_path: Path) -> None:
    with Speakers(DEVICES, RATE, SECONDS) as speakers:
        sources = [f"serial://{terminal}?baud=2000000&protocol=xbus" for terminal in speakers.terminals]
        with ServerProcess(*sources, data=tmp_path, arguments=("--record",)) as server:
            server.wait_until_open(DEVICES)
            good, sent = asyncio.run(crowded(server, speakers))
            assert good.lost == 0
            with urllib.request.urlopen(f"{server.url}/api/devices", timeout=PATIENCE_S) as answer:
                ids = sorted(device["id"] for device in json.load(answer))
        received = received_in(sorted((tmp_path / "recordings").glob("*.mcap")))
    for device, report in zip(ids, sent["devices"], strict=True):
        assert received[device] == {"bytes": report["bytes"], "crc32": report["crc32"]}, "all that was sent is there"


def test_too_frequent_requests_wait() -> None:
    bucket = TokenBucket(10.0, 5.0, now=100.0)

    def wait(now: float) -> float:
        needed = bucket.wait_s(now)
        bucket.acquire(now)
        return needed

    assert [wait(100.0) for _ in range(5)] == [0.0] * 5
    assert [wait(100.0) for _ in range(3)] == [pytest.approx(0.1), pytest.approx(0.2), pytest.approx(0.3)]
    assert wait(101.0) == 0.0
    assert [wait(1000.0) for _ in range(5)] == [0.0] * 5, "tokens are not saved up beyond the burst"
    assert wait(1000.0) > 0


def test_a_flood_of_protocol_pings_ends_the_connection(tmp_path: Path) -> None:
    with (
        InProcessServer(Config(sources=("/dev/one",), data=tmp_path), FakeLink) as running,
        connect(running.ws, subprotocols=[PROTOCOL]) as polite,
    ):
        assert polite.ping().wait(PATIENCE_S), "one is answered"
        with contextlib.suppress(ConnectionClosed), connect(running.ws, subprotocols=[PROTOCOL]) as rude:
            deadline = time.monotonic() + 60
            while time.monotonic() < deadline:
                rude.ping()
            pytest.fail("a flood of pings was answered for a minute")
        assert polite.ping().wait(PATIENCE_S)
