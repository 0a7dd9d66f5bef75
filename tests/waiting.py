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


def block_until(condition: Callable[[], Any], what: str) -> Any:
    """Wait without an event loop.

    Returns:
        the last value of the condition.

    Raises:
        AssertionError: it did not become true.
    """
    end = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert time.monotonic() < end, f"after {PATIENCE_S:g} s still not: {what}"
        time.sleep(CHECK_INTERVAL_S)
    return found
