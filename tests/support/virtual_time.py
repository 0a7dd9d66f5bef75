"""An event loop with a clock that its waits advance: hours of timers pass at once, deterministically."""

import asyncio
import selectors
from collections.abc import Coroutine
from typing import Any, TypeVar

from tests.support.timeouts import PATIENCE_S

T = TypeVar("T")


class _Selector(selectors.SelectSelector):
    """Waits by moving a clock."""

    now = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None:  # for another thread, then
            ready = super().select(PATIENCE_S)
            assert ready, "nothing is due any more, and nobody ends this wait"
            return ready
        self.now += max(0.0, timeout)
        return super().select(0)


class VirtualLoop(asyncio.SelectorEventLoop):
    """For tasks and timers of one thread; calls from another thread do not interrupt a wait."""

    def __init__(self) -> None:
        self._clock = _Selector()
        super().__init__(self._clock)

    def time(self) -> float:
        return self._clock.now

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:
        """Without a limit, which would be over at once in virtual time; the limit is new in Python 3.12."""
        await super().shutdown_default_executor()


def run(main: Coroutine[Any, Any, T]) -> T:
    """As asyncio.run, in virtual time."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(main)
