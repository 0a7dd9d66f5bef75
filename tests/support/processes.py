"""Other processes, from /proc (Linux)."""

import os
from pathlib import Path

TICKS_PER_S = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


def stat_of(pid: int) -> list[str]:
    """Fields of proc_pid_stat(5) after the name, from the state on.

    Raises:
        OSError: it has ended.
    """
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()


def is_running(pid: int) -> bool:
    """Whether it runs; one that has ended but was not collected does not."""
    try:
        return stat_of(pid)[0] != "Z"
    except OSError:
        return False


def seconds_of(pid: int) -> float:
    """Processor time so far, all threads, user and system, without processes that it began."""
    return sum(map(int, stat_of(pid)[11:13])) / TICKS_PER_S


def resident_mb(pid: int) -> float:
    """Resident memory, 10⁶ bytes; 0 if it has ended."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except OSError:
        return 0.0
