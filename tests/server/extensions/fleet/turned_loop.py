"""An event loop in real time whose clock a test turns: what is due within the hour is due now."""

import asyncio
from concurrent.futures import Future

from tests.support.timeouts import PATIENCE_S


class TurnedLoop(asyncio.SelectorEventLoop):
    """For a server in a thread of its own; its links and processes live in real time."""

    ahead = 0.0

    def time(self) -> float:
        return super().time() + self.ahead

    def turn(self, seconds: float) -> None:
        """Move the clock on, from another thread."""
        done: Future[None] = Future()

        def move() -> None:
            self.ahead += seconds
            done.set_result(None)

        self.call_soon_threadsafe(move)
        done.result(PATIENCE_S)
