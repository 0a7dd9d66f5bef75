"""The machine while tests run: its load and memory, and the processes of the check, from /proc (Linux).

Elsewhere the texts are empty and the figures 0: they explain a failure, and no test depends on them.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

TICKS = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100
MB = 1_000_000
SAMPLE_S = 15.0  # to add up the memory of all processes takes 0.1 s of a processor
MOST_SHOWN = 8  # processes in a report


@dataclass(frozen=True)
class Running:
    """A process and what it has used."""

    pid: int
    name: str
    seconds: float  # of a processor, with those of the processes it has waited for
    memory: int  # bytes; what is shared with others is divided among them


def descendants(pid: int) -> Iterator[int]:
    """Processes begun by `pid`, and by those."""
    with suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):
            for child in Path(f"/proc/{pid}/task/{task}/children").read_text().split():
                yield int(child)
                yield from descendants(int(child))


def processor_seconds(pid: int) -> float:
    """Processor time of a process and of those it has waited for; 0 if it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / TICKS


def name_of(pid: int) -> str:
    """Name of the program; "" if it has ended."""
    try:
        return Path(f"/proc/{pid}/comm").read_text().strip()
    except OSError:
        return ""


def memory_of(pid: int) -> int:
    """Bytes, with its share of what it has in common with others; 0 if it has ended or is somebody else's."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("Pss:")), 0)


def processes_below(pid: int) -> list[Running]:
    """All processes begun by `pid`, the busiest first."""
    results = [Running(one, name_of(one), processor_seconds(one), memory_of(one)) for one in descendants(pid)]
    return sorted(results, key=lambda one: -one.seconds)


def check_process() -> int:
    """The process that all of the check descends from: tests/check.py tells its own number; else this one."""
    return int(os.environ.get("IMUSCOPE_CHECK_PID", os.getpid()))


def state() -> str:
    """Load, memory, and the processes of the check, in some lines."""
    lines = []
    with suppress(OSError, AttributeError):
        load = ", ".join(f"{one:.1f}" for one in os.getloadavg())
        lines.append(f"load {load} on {os.cpu_count()} processors")
    with suppress(OSError):
        memory = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        total, free = (int(memory[name].split()[0]) / 1e6 for name in ("MemTotal", "MemAvailable"))
        lines.append(f"memory {free:.1f} GB available of {total:.1f} GB")
    results = processes_below(check_process())
    if results:
        used = sum(one.memory for one in results) / MB
        lines.append(f"{len(results)} processes of the check, {used:.0f} MB; the busiest:")
        lines += [
            f"  {one.name:16} process {one.pid:7}  {one.seconds:7.1f} s  {one.memory / MB:5.0f} MB"
            for one in results[:MOST_SHOWN]
        ]
    return "\n".join(lines)


class MemoryPeak:
    """Watches the memory of everything that this process has begun; also a context manager.

    Attributes:
        most: bytes, the largest sum seen.
    """

    def __init__(self) -> None:
        self.most = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def _watch(self) -> None:
        while not self._ended.wait(SAMPLE_S):
            self.most = max(self.most, sum(memory_of(pid) for pid in [os.getpid(), *descendants(os.getpid())]))

    def __enter__(self) -> MemoryPeak:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
