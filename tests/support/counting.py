"""Work counted in calls instead of seconds: the same on every machine, however busy it is."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


class Calls:
    """Number of calls so far, of Python functions and of those of C."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, _: FrameType, event: str, __: Any) -> None:
        if event in ("call", "c_call"):
            self.count += 1


@contextmanager
def counted_calls() -> Iterator[Calls]:
    """Count the calls of this thread within the block. Work inside one call (a search, a copy) counts as one.

    No garbage is collected within the block: the finalizers of what earlier tests left behind would count, too.
    """
    calls = Calls()
    before = sys.getprofile()
    collects = gc.isenabled()
    gc.disable()
    sys.setprofile(calls)
    try:
        yield calls
    finally:
        sys.setprofile(before)
        if collects:
            gc.enable()
