"""Waiting for a condition with a generous time limit and a report of its last value."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from typing import Any

from tests.timeouts import PATIENCE_S

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.002, 0.1


def _pauses() -> Iterator[float]:
    """Between checks: a fifth of the time that has passed. What comes soon is seen soon, and a condition that asks a
    server costs little while the server works.
    """
    passed = 0.0
    while True:
        pause = min(max(FIRST_PAUSE_S, passed / 5), LONGEST_PAUSE_S)
        passed += pause
        yield pause


async def until(condition: Callable[[], object], what: str) -> None:
    """Wait in an event loop.

    Raises:
        AssertionError: it did not come true.
    """
    end, pauses = time.monotonic() + PATIENCE_S, _pauses()
    while not condition():
        assert time.monotonic() < end, f"after {PATIENCE_S:g} s still not: {what}"
        await asyncio.sleep(next(pauses))


def block_until(condition: Callable[[], Any], what: str | Callable[[], object], *, seconds: float = PATIENCE_S) -> Any:
    """Wait without an event loop.

    Args:
        what: is waited for, or a function that gives what there is instead.

    Returns:
        the last value of the condition.

    Raises:
        AssertionError: it did not become true.
    """
    end, pauses = time.monotonic() + seconds, _pauses()
    while not (found := condition()):
        assert time.monotonic() < end, f"after {seconds:g} s still not: {what if isinstance(what, str) else what()}"
        time.sleep(next(pauses))
    return found
