"""Turns at a few slots: each user gets one, whoever asks more often."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

import pytest

from imuscope.server.concurrency.fair_queue import FairQueue, QueueFullError


async def _order(queue: FairQueue, users: Sequence[str]) -> list[str]:
    """The requests in the order in which they got a slot; each holds it until all were asked."""
    served: list[str] = []
    request = asyncio.Event()

    async def one(user: str, name: str) -> None:
        async with queue.turn(user) as turn:
            await turn.granted()
            served.append(name)
            await request.wait()

    tasks = [asyncio.create_task(one(user, f"{user}{n}")) for n, user in enumerate(users)]
    while queue.running + queue.waiting < len(users):
        await asyncio.sleep(0)
    request.set()
    await asyncio.gather(*tasks)
    assert (queue.running, queue.waiting) == (0, 0)
    return served


def test_users_take_turns() -> None:
    assert asyncio.run(_order(FairQueue(1, 1, 9), "aaaab")) == ["a0", "b4", "a1", "a2", "a3"]
    assert asyncio.run(_order(FairQueue(1, 1, 9), "aaabbc")) == ["a0", "b3", "c5", "a1", "b4", "a2"]


async def test_one_user_leaves_slots_to_others() -> None:
    queue = FairQueue(3, 2, 9)
    async with queue.turn("a") as first, queue.turn("a") as second, queue.turn("a") as third:
        assert [one.is_running for one in (first, second, third)] == [True, True, False]
        async with queue.turn("b") as other:
            assert other.is_running
            assert (queue.running, queue.waiting, queue.before(third), queue.before(other)) == (3, 1, 0, 0)


async def test_how_many_come_before() -> None:
    queue = FairQueue(1, 1, 9)
    async with queue.turn("a"), queue.turn("a") as a, queue.turn("a") as again, queue.turn("b") as b:
        # b is next, because a is being served
        assert [queue.before(one) for one in (b, a, again)] == [0, 1, 2]


async def test_who_leaves_the_queue_is_not_served() -> None:
    queue = FairQueue(1, 1, 9)

    async def wait() -> None:
        async with queue.turn("b") as turn:
            await turn.granted()

    async with queue.turn("a"):
        task = asyncio.create_task(wait())
        while not queue.waiting:
            await asyncio.sleep(0)
        task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert (queue.running, queue.waiting) == (0, 0)
    async with queue.turn("c") as turn:
        assert turn.is_running


async def test_a_user_with_too_many_requests_is_refused() -> None:
    queue = FairQueue(1, 1, 2)
    async with queue.turn("a"), queue.turn("a"), queue.turn("a"):
        with pytest.raises(QueueFullError):
            async with queue.turn("a"):
                pass
        async with queue.turn("b"):
            assert queue.waiting == 3
