"""Waiting for a condition with a generous time limit and a report of its last value."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any

from tests.timeouts import PATIENCE_S

CHECK_INTERVAL_S = 0.01


async def until(condition: Callable[[], object], what: str) -> None:
    """Wait in an event loop.

    Raises:
        AssertionError: it did not come true.
    """
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, f"after {PATIENCE_S:g} s still not: {what}"
        await asyncio.sleep(CHECK_INTERVAL_S)


def block_until(condition: Callable[[], Any], what: str | Callable[[], object], *, seconds: float = PATIENCE_S) -> Any:
    """Wait without an event loop.

    Args:
        what: is waited for, or a function that gives what there is instead.

    Returns:
        the last value of the condition.

    Raises:
        AssertionError: it did not become true.
    """
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, f"after {seconds:g} s still not: {what if isinstance(what, str) else what()}"
        time.sleep(CHECK_INTERVAL_S)
    return found
