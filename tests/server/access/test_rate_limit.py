"""A flood from one address is refused with a message; other addresses and the page are not affected."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

from starlette.types import Receive, Scope, Send

from imuscope.server.access.rate_limit import (
    ADMITTED_PER_PASS,
    MAX_ADDRESSES,
    MAX_READING,
    MAX_WAITING,
    REQUEST_BURST,
    REQUESTS_PER_S,
    RateLimiter,
)
from tests.support.manual_clock import ManualClock

ONE = "/api/recordings/20261121T044324Z"


async def hello(scope: Scope, receive: Receive, send: Send) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b""})


async def send_request(
    turnstile: RateLimiter, path: str = "/api/devices", client: str = "192.0.2.1", method: str = "GET"
) -> tuple[int, dict[str, Any]]:
    """Status and headers with the body."""
    texts: list[Any] = []

    async def send(message: Any) -> None:
        texts.append(message)

    async def receive() -> Any:
        return {"type": "http.request"}

    scope = {"type": "http", "method": method, "path": path, "client": (client, 1), "headers": []}
    await turnstile(scope, receive, send)
    headers = {name.decode(): value.decode() for name, value in texts[0]["headers"]}
    return texts[0]["status"], {**headers, **json.loads(texts[1]["body"] or b"{}")}


def statuses(turnstile: RateLimiter, times: int, **request: str) -> list[int]:
    async def all_of_them() -> list[int]:
        return [(await send_request(turnstile, **request))[0] for _ in range(times)]

    return asyncio.run(all_of_them())


def test_a_flood_of_requests_is_limited_with_retry_after() -> None:
    clock = ManualClock(1000.0)
    turnstile = RateLimiter(hello, clock)
    most = int(REQUEST_BURST)
    assert statuses(turnstile, most + 50) == [200] * most + [429] * 50
    status, report = asyncio.run(send_request(turnstile))
    assert (status, report["kind"], report["retry-after"]) == (429, "too-fast", "1")
    assert report["message"].endswith("address.")
    assert report["hint"]
    assert statuses(turnstile, 3, path="/healthz") == [200] * 3  # monitoring is not rejected
    assert statuses(turnstile, 3, client="192.0.2.2") == [200] * 3
    clock.now += 1.0  # to ask in vain cost nothing
    assert statuses(turnstile, int(REQUESTS_PER_S) + 50) == [200] * int(REQUESTS_PER_S) + [429] * 50


def test_memory_is_bounded() -> None:
    turnstile = RateLimiter(hello, ManualClock(1000.0))
    for n in range(2 * MAX_ADDRESSES):
        turnstile.acquire(f"10.0.{n >> 8}.{n & 255}")
    assert len(turnstile._requests) == MAX_ADDRESSES


async def test_request_bursts_do_not_delay_viewers() -> None:
    """Regression: a hundred answers of 7 ms each were computed without a turn of the event loop."""
    begun: list[str] = []

    async def noted(scope: Scope, receive: Receive, send: Send) -> None:
        begun.append(scope["path"])
        await hello(scope, receive, send)

    turnstile = RateLimiter(noted, ManualClock(1000.0))
    requests = [asyncio.create_task(send_request(turnstile)) for _ in range(100)]
    before = 0
    while len(begun) < len(requests):
        await asyncio.sleep(0)
        assert len(begun) - before <= 2 * ADMITTED_PER_PASS
        before = len(begun)
    await send_request(turnstile, "/healthz")
    await asyncio.gather(*requests)


def reading(turn: Callable[[RateLimiter, asyncio.Event, list[str]], Any]) -> None:
    async def run() -> None:
        let, reads = asyncio.Event(), list[str]()

        async def slow(scope: Scope, receive: Receive, send: Send) -> None:
            reads.append(scope["path"])
            await let.wait()
            await hello(scope, receive, send)

        await turn(RateLimiter(slow), let, reads)

    asyncio.run(run())


def test_readings_of_one_address_take_turns() -> None:
    async def turn(turnstile: RateLimiter, let: asyncio.Event, reads: list[str]) -> None:
        requests = [
            asyncio.create_task(send_request(turnstile, f"{ONE}/window")) for _ in range(MAX_READING + MAX_WAITING)
        ]
        await asyncio.sleep(0)
        assert len(reads) == MAX_READING
        for way, path in (
            *(("GET", f"{ONE}/{what}") for what in ("query", "statistics", "health", "amount")),
            ("POST", "/api/analysis/statistics"),
            ("POST", "/api/comparison"),
        ):
            status, report = await send_request(turnstile, path, method=way)
            assert (status, report["kind"]) == (429, "too-fast"), path
        others = [asyncio.create_task(send_request(turnstile, path)) for path in (f"{ONE}/download", "/api/devices")]
        others.append(asyncio.create_task(send_request(turnstile, "/api/devices/1/query", "192.0.2.2")))
        await asyncio.sleep(0)
        assert len(reads) == MAX_READING + 3  # others do not wait for them
        requests[-1].cancel()  # a disconnected browser
        let.set()
        results = await asyncio.gather(*requests, *others, return_exceptions=True)
        assert [one[0] for one in results if isinstance(one, tuple)] == [200] * (len(results) - 1)
        assert not turnstile._readers

    reading(turn)
