"""Bounds for a process that works aside: what a hostile file makes it do must not take the machine's memory or time.

Counted is memory of its own (RLIMIT_DATA), not what is mapped: the columns of a day are mapped files of many gigabytes,
which cost nothing that is not free to go. Beyond the bound an allocation fails, which ends this work in words.

Source: getrlimit(2), RLIMIT_DATA (since Linux 4.7 private mappings count) and RLIMIT_CPU.
"""

from __future__ import annotations

import contextlib
import sys

MEMORY = 3 << 30  # bytes; opening an hour of 2 kHz takes less than 500 MB; libraries reserve stacks for each core
CPU_S = 1800  # a day of 1 kHz takes minutes


def bounded(memory: int = MEMORY, cpu_s: int = CPU_S) -> None:
    """Bound this process from here on, where that can be had. To be called first."""
    if sys.platform != "linux":
        return
    import resource

    for what, most in ((resource.RLIMIT_DATA, memory), (resource.RLIMIT_CPU, cpu_s)):
        _, hard = resource.getrlimit(what)
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(what, (most, hard))
