"""Priorities of processes: lower for those in the background, real time for the one that live devices wait for."""

import contextlib
import os

RAISED_NICENESS = -10
PERMIT = "LimitRTPRIO=1 in the unit, or a line `imuscope - rtprio 1` in /etc/security/limits.conf, permits it."
SAME = "IMUSCOPE_SAME_PRIORITY"
"""Variable that keeps it as it is, for tests: a busy machine gives a process of low priority no time at all."""


def raise_priority() -> bool:
    """Come before all programs without real-time priority, or at least before most; whether that is permitted."""
    if SAME in os.environ:
        return True
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(1))
        return True
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, RAISED_NICENESS)
        return True
    return False


def has_raised_priority(pid: int) -> bool:
    """Whether a process has raised priority. OSError: no such process."""
    return (
        os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK == os.SCHED_RR or os.getpriority(os.PRIO_PROCESS, pid) < 0
    )


def lower_priority(by: int) -> None:
    """Let others go first, where the system knows of priorities."""
    if SAME not in os.environ:
        with contextlib.suppress(OSError):
            os.nice(by)
