"""Waiting for a condition with a generous time limit and a report of its last value."""

import asyncio
import time
from collections.abc import Callable
from typing import Any

from tests.support.timeouts import PATIENCE_S

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.002, 0.1
WAITING_SHARE = 0.2  # of the time that conditions may take: those that ask a server take the processor from it


class _Pauses:
    """Between checks: a fifth of the time that has passed, and longer for a condition that takes long itself.

    What comes soon is seen soon, and a condition that asks a server costs little while the server works.
    """

    def __init__(self) -> None:
        self._began = self._polled = time.monotonic()

    def request(self) -> None:
        """The condition is asked now."""
        self._polled = time.monotonic()

    def next(self) -> float:
        """Seconds until it is asked again."""
        now = time.monotonic()
        pause = min(max(FIRST_PAUSE_S, (now - self._began) / 5), LONGEST_PAUSE_S)
        return max(pause, min((now - self._polled) / WAITING_SHARE, 10 * LONGEST_PAUSE_S))


async def until(condition: Callable[[], object], what: str) -> None:
    """Wait in an event loop.

    Raises:
        AssertionError: it did not come true.
    """
    end, pauses = time.monotonic() + PATIENCE_S, _Pauses()
    while not condition():
        assert time.monotonic() < end, f"after {PATIENCE_S:g} s still not: {what}"
        await asyncio.sleep(pauses.next())
        pauses.request()


def block_until(condition: Callable[[], Any], what: str | Callable[[], object], *, seconds: float = PATIENCE_S) -> Any:
    """Wait without an event loop.

    Args:
        what: is waited for, or a function that gives what there is instead.

    Returns:
        the last value of the condition.

    Raises:
        AssertionError: it did not become true.
    """
    end, pauses = time.monotonic() + seconds, _Pauses()
    while not (result := condition()):
        assert time.monotonic() < end, f"after {seconds:g} s still not: {what if isinstance(what, str) else what()}"
        time.sleep(pauses.next())
        pauses.request()
    return result
