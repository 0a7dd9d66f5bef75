"""Cases that are too many for each run: a few of them, and all in the deep one (`tests/check.py --deep`)."""

import os
from collections.abc import Sequence
from typing import TypeVar

Case = TypeVar("Case")
IS_DEEP = os.environ.get("HYPOTHESIS_PROFILE") == "deep"


def some(cases: Sequence[Case], nth: int) -> Sequence[Case]:
    """Every `nth` case, evenly spread; all in the deep run."""
    return cases if IS_DEEP else cases[::nth]
