"""Bounds for a process that works aside: what a hostile file makes it do must not take the machine's memory or time.

    memory    of its own (RLIMIT_DATA), not what is mapped: the columns of a day are mapped files of many gigabytes,
              which cost nothing that is not free to go. Beyond the bound an allocation fails: MemoryError
    time      of the processor (RLIMIT_CPU), by the size of the file. Beyond it: TooLong

The bound of memory is a share of what the machine, or the unit it runs in, has.

Source: getrlimit(2), RLIMIT_DATA (since Linux 4.7 private mappings count) and RLIMIT_CPU; the cgroup v2 documentation,
"memory.max".
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

MEMORY = 3 << 30  # bytes; opening an hour of 2 kHz takes less than 500 MB
LEAST_MEMORY = 1 << 30  # on a small machine: libraries reserve stacks for each core, which count and cost nothing
SHARE = 2  # one part in so many of the machine's memory is for one process
CPU_S = 1800  # a day of 1 kHz takes minutes
LEAST_CPU_S, CPU_S_PER_MB = 60, 5  # a slow machine imports for seconds, and reads a megabyte of text in one

TO_END_S = 10  # from the end of its time to being told again


class TooLong(BaseException):
    """The time is over."""


def bounded(memory: int | None = None, cpu_s: int = CPU_S) -> None:
    """Bound this process from here on, where that can be had. To be called first."""
    if sys.platform != "linux":
        return
    import resource

    _limit(resource.RLIMIT_DATA, memory or memory_of_one())
    signal.signal(signal.SIGXCPU, _over)
    _limit(resource.RLIMIT_CPU, cpu_s)


def bounded_by(path: Path) -> None:
    """The same of the time from here on, once it is known which file is read."""
    with contextlib.suppress(OSError):
        if sys.platform == "linux":
            import resource

            _limit(resource.RLIMIT_CPU, _used_s() + seconds_for(path.stat().st_size))


def seconds_for(size: int) -> int:
    """How much time of a processor a file of so many bytes may take."""
    return min(CPU_S, LEAST_CPU_S + CPU_S_PER_MB * (size >> 20))


def memory_of_one() -> int:
    """How much memory one process may have on this machine, bytes."""
    return max(LEAST_MEMORY, min(MEMORY, min(_memories(), default=MEMORY * SHARE) // SHARE))


def _memories() -> Iterator[int]:
    """What the machine has, and what the groups have that this process is in."""
    with contextlib.suppress(OSError, ValueError):
        yield os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with contextlib.suppress(OSError, StopIteration):
        lines = Path("/proc/self/cgroup").read_text().splitlines()
        own = Path("/sys/fs/cgroup") / next(line[4:] for line in lines if line.startswith("0::/"))
        for folder in (own, *own.parents):
            with contextlib.suppress(OSError, ValueError):
                yield int((folder / "memory.max").read_text())  # "max" where there is no bound


def _limit(what: int, most: int) -> None:
    import resource

    _, hard = resource.getrlimit(what)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _over(number: int, frame: object) -> NoReturn:
    import resource

    _limit(resource.RLIMIT_CPU, _used_s() + TO_END_S)  # else it is told every second
    raise TooLong


def _used_s() -> int:
    """The time of the processor that this process has taken."""
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF)
    return int(used.ru_utime + used.ru_stime)
