"""Resource limits of a worker process: a hostile file must not take the machine's memory or time.

    memory    its own (RLIMIT_DATA), not mapped files: the columns of a day are mapped files of many gigabytes, whose
              pages the system can drop at any time. Beyond the limit an allocation fails: MemoryError
    time      of the processor (RLIMIT_CPU), by the size of the file. Beyond it: TooLong; TO_END_S later the system
              ends the process, also within a library that does not return to Python

The memory limit is a share of the memory of the machine, or of the unit it runs in; so is the history of a server.

Source: getrlimit(2), RLIMIT_DATA (since Linux 4.7 private mappings count) and RLIMIT_CPU; the documentation of cgroup
v2, "memory.max", and of v1, "memory.limit_in_bytes".
"""

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

MAX_MEMORY = 3 << 30  # bytes; opening an hour of 2 kHz takes less than 500 MB
MIN_MEMORY = 1 << 30  # on a small machine: libraries reserve stacks for each core, which count but are not used
DIVISOR = 2  # one process may use 1/SHARE of the machine's memory
SERVER_BYTES, MIN_HISTORY = 128 << 20, 8 << 20  # bytes of a server without a history, and of the least history
CPU_S = 1800  # a day of 1 kHz takes minutes
MIN_CPU_S, CPU_S_PER_MB = 60, 5  # a slow machine takes seconds to import, and one to read a megabyte of text

TO_END_S = 10  # from the end of its time to the next signal


class TooLong(BaseException):
    """The processor time is used up."""


def bounded(memory: int | None = None, cpu_s: int = CPU_S, to_end_s: int = TO_END_S) -> None:
    """Limit this process from here on, if the system supports it. Call it first.

    Args:
        to_end_s: processor time from TooLong to the end of the process.
    """
    if sys.platform != "linux":
        return
    import resource

    _limit(resource.RLIMIT_DATA, memory or memory_of_one())
    signal.signal(signal.SIGXCPU, _over)
    _limit(resource.RLIMIT_CPU, _used_s() + cpu_s, to_end_s)


def bounded_by(path: Path, *, is_last: bool = True) -> None:
    """Limit the processor time from here on, once the file to be read is known.

    Args:
        is_last: whether no other file follows: the hard limit, which cannot be raised again, is set too.
    """
    with contextlib.suppress(OSError):
        if sys.platform == "linux":
            import resource

            most = _used_s() + seconds_for(path.stat().st_size)
            _limit(resource.RLIMIT_CPU, most, TO_END_S if is_last else None)


def seconds_for(size: int) -> int:
    """CPU time allowed for a file of this size, s."""
    return min(CPU_S, MIN_CPU_S + CPU_S_PER_MB * (size >> 20))


def memory_of_one() -> int:
    """Memory allowed for one process on this machine, bytes."""
    return max(MIN_MEMORY, min(MAX_MEMORY, min(_memories(), default=MAX_MEMORY * DIVISOR) // DIVISOR))


def history_room() -> int:
    """Memory that the history of a server may take on this machine, bytes."""
    available = min(_memories(), default=MAX_MEMORY * DIVISOR)
    return max(MIN_HISTORY, (available - SERVER_BYTES) // DIVISOR, available - MAX_MEMORY // DIVISOR)


def memory_in_use() -> int:
    """Memory of this process that counts against its limit, bytes; 0 where the system does not report it."""
    with contextlib.suppress(OSError, StopIteration):
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmData:"))
    return 0


def _memories(groups: Path = Path("/proc/self/cgroup"), root: Path = Path("/sys/fs/cgroup")) -> Iterator[int]:
    """Memory of the machine, and limits of this process's control groups, of both versions.

    Args:
        groups: the list of them: "0::/system.slice/x" of version 2, "5:memory:/x" of version 1.
        root: where their files are.
    """
    with contextlib.suppress(OSError, ValueError):
        yield os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with contextlib.suppress(OSError, ValueError):
        for line in groups.read_text().splitlines():
            _, names, place = line.split(":", 2)
            if names and "memory" not in names.split(","):
                continue
            own = (root / "memory" if names else root) / place.lstrip("/")
            for folder in (own, *own.parents):
                with contextlib.suppress(OSError, ValueError):
                    file = "memory.limit_in_bytes" if names else "memory.max"
                    yield int((folder / file).read_text())  # "max", or a number beyond any memory, without a limit


def _limit(what: int, most: int, until_killed: int | None = None) -> None:
    """Set the soft limit, and the hard one that much above it; None: the hard limit stays."""
    import resource

    _, hard = resource.getrlimit(what)
    if until_killed is not None:
        hard = most + until_killed if hard == resource.RLIM_INFINITY else min(most + until_killed, hard)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _over(number: int, frame: object) -> NoReturn:
    import resource

    _limit(resource.RLIMIT_CPU, _used_s() + TO_END_S)  # else the signal comes every second
    raise TooLong


def _used_s() -> int:
    """Processor time used by this process."""
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF)
    return int(used.ru_utime + used.ru_stime)
