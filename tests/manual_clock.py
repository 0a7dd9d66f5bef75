"""Clock that only a test moves."""

from __future__ import annotations

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
