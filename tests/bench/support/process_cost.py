"""Cost of a program on the machine: processor time, wake-ups and memory of all its processes, from /proc.

    with measured(server.pid) as cost:
        …
    cost.core_share       processor time by wall time: 0.02 is 2 % of a core
    cost.wakeups_per_s    times a thread was put on a core: voluntary and involuntary context switches

The processes are those of the given one and all its descendants, at the beginning and at the end. Processor time is
that of the clocks of the processes, to the ns (clock_getcpuclockid(3)), and so includes threads that have ended; of
processes that have ended, what their parent was told of them.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tests.checking.machine import descendants, memory_of
from tests.support.processes import TICKS_PER_S, stat_of

PROC = Path("/proc")


def seconds_of(pid: int) -> float:
    """Processor time of one process and of its children that have ended, s; 0 if there is none."""
    try:
        fields = stat_of(pid)
        own = time.clock_gettime((~pid << 3) | 2)  # CPUCLOCK_SCHED of that process
    except OSError:
        return 0.0
    return own + (int(fields[13]) + int(fields[14])) / TICKS_PER_S


def switches_of(pid: int) -> dict[tuple[int, int], int]:
    """Context switches so far of each (process, thread)."""
    results = {}
    for status in (PROC / str(pid) / "task").glob("*/status"):
        with contextlib.suppress(OSError):
            lines = [line for line in status.read_text().splitlines() if "ctxt_switches" in line]
            results[pid, int(status.parent.name)] = sum(int(line.split()[1]) for line in lines)
    return results


def memory_mb(pid: int) -> float:
    """Memory of a process and its descendants, 10⁶ bytes; a page that several share counts once."""
    return sum(map(memory_of, (pid, *descendants(pid)))) / 1e6


@dataclass(slots=True)
class ProcessCost:
    """Cost of a program over some time.

    Attributes:
        by_thread: wake-ups/s by the thread's name, the most frequent first.
    """

    core_share: float = 0.0
    wakeups_per_s: float = 0.0
    processes: int = 0
    by_thread: dict[str, float] = field(default_factory=dict)


@contextlib.contextmanager
def measured(pid: int) -> Iterator[ProcessCost]:
    """Measure a program during a block; the figures are there when it ends."""
    cost = ProcessCost()
    before = [pid, *descendants(pid)]
    spent = sum(map(seconds_of, before))
    switched = {key: count for one in before for key, count in switches_of(one).items()}
    began = time.monotonic()
    yield cost
    elapsed = time.monotonic() - began
    after = [pid, *descendants(pid)]
    cost.core_share = (sum(map(seconds_of, after)) - spent) / elapsed
    cost.processes = len(after)
    for one in after:
        for key, count in switches_of(one).items():
            rate = (count - switched.get(key, 0)) / elapsed
            cost.wakeups_per_s += rate
            if rate >= 0.1:
                with contextlib.suppress(OSError):
                    name = (PROC / str(key[0]) / "task" / str(key[1]) / "comm").read_text().strip()
                    cost.by_thread[name] = round(cost.by_thread.get(name, 0.0) + rate, 1)
    cost.by_thread = dict(sorted(cost.by_thread.items(), key=lambda item: -item[1]))
