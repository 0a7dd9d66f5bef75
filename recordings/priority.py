"""Lower priority of processes that work in the background: live devices come first."""

from __future__ import annotations

import contextlib
import os

SAME = "IMUSCOPE_SAME_PRIORITY"
"""Variable that keeps it as it is, for tests: a busy machine gives a process of low priority no time at all."""


def lower_priority(by: int) -> None:
    """Let others go first, where the system knows of priorities."""
    if SAME not in os.environ:
        with contextlib.suppress(OSError):
            os.nice(by)
