"""Clocks that only a test moves, or what it runs."""

import threading
from typing import Generic, TypeVar

N = TypeVar("N", int, float)


class ManualClock(Generic[N]):
    """Callable clock, in whatever unit its user counts.

    Attributes:
        now: assigned by the test.
    """

    def __init__(self, now: N) -> None:
        self.now = now

    def __call__(self) -> N:
        return self.now


class SleptTime:
    """In place of the module `time` in code that waits: a sleep moves the clock, and takes no time.

    Attributes:
        slept: each pause, s.
    """

    def __init__(self) -> None:
        self.slept: list[float] = []
        self._lock = threading.Lock()

    def sleep(self, seconds: float) -> None:
        with self._lock:
            self.slept.append(seconds)

    def monotonic(self) -> float:
        with self._lock:
            return sum(self.slept)
