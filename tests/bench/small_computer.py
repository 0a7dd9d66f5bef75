"""Benchmark of a robot's own computer: what the server costs on one core, beside a busy loop and on a free core.

    beside   everything on one core beside one busy loop: about what a small board has left for us
    free     the server alone on a core; devices and clients on another

    python tests/bench/small_computer.py                                   all parts, both ways; under four minutes
    python tests/bench/small_computer.py --parts recorded idle --ways free
    … --seconds 10 of each measurement · --save to keep the result (small-computer.json)

    idle       a server without sources
    recorded   one device, 400 Hz, recorded, nobody looks
    watched    three devices, 400 Hz, one page open
    memory     the same three with ten minutes of history, with a page and without; sent faster, but all decoded
    holder     the holder of a shared port at 2 kHz, with a driver and a server on it
    start      the first start ever, with one device of 400 Hz: until the page is served, until its first samples
    overload   three devices, 400 Hz, and a fourth at 2 kHz that is too much, recorded, with a page (only "beside")

Figures are shares of a core (processor time by wall time, all processes of the server) and wake-ups per second
(context switches of all their threads). A device is a process of its own (serial_devices.py); a page is this process.

The yardsticks, in the same run: `cat` from a device to a file (bytes; a read and a write for each arrival, which is
what socat does without its poll; socat itself where it is installed, for the holder), a bare WebSocket relay for pages
(relay_kernel.py; each message received and sent once), and a Python process that imports the same foundations (start).
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.bench import small_computer_parts as parts  # noqa: E402
from tests.bench.support.report import options_of, report  # noqa: E402

PARTS: dict[str, Callable[[parts.Place, float], dict[str, Any]]] = {
    "idle": parts.idle,
    "recorded": parts.recorded,
    "watched": parts.watched,
    "memory": parts.memory,
    "holder": parts.holder,
    "start": parts.start,
    "overload": parts.overload,
}
ONLY = {"memory": "free", "overload": "beside"}  # ways in which it says something
GOALS: dict[str, dict[str, float]] = {
    "idle": {"core_share": 0.001, "wakeups_per_s": 5},
    "recorded": {"core_share": 0.02},
    "watched": {"core_share": 0.12},
    "memory": {"unwatched_mb": 90, "watched_mb": 180, "whole": 1.0},
    "holder": {"ratio": 1.5, "memory_mb": 12},
    "start": {"page_s": 3, "samples_s": 4},
    "overload": {"whole": 1.0, "told": 1.0},
}


@contextlib.contextmanager
def place(way: str) -> Iterator[parts.Place]:
    """The cores of one way, with the busy loop if it has one."""
    cores = sorted(os.sched_getaffinity(0))
    ours, others = {cores[0]}, set(cores[1:]) or {cores[0]}
    if way == "beside":
        others = ours
    with contextlib.ExitStack() as ending:
        ending.callback(os.sched_setaffinity, 0, cores)
        os.sched_setaffinity(0, others)
        if way == "beside":
            loop = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            ending.callback(loop.wait)
            ending.callback(loop.kill)
        yield parts.Place(ours, others)


def table(figures: dict[str, Any]) -> str:
    """The figures that have a goal, a line each."""
    lines = [f"{'part':10}{'figure':16}{'goal':>8}{'beside':>10}{'free':>10}"]
    for part, goals in GOALS.items():
        for name, goal in goals.items():
            values = [figures.get(way, {}).get(part, {}).get(name) for way in ("beside", "free")]
            if any(value is not None for value in values):
                shown = "".join(f"{'-':>10}" if value is None else f"{value:10.4g}" for value in values)
                lines.append(f"{part:10}{name:16}{goal:8g}{shown}")
    return "\n".join(lines)


def main() -> None:
    """The command line."""
    parser = options_of(__doc__.partition("\n")[0])
    parser.add_argument("--parts", nargs="+", choices=[*PARTS], default=[*PARTS])
    parser.add_argument("--ways", nargs="+", choices=["beside", "free"], default=["beside", "free"])
    parser.add_argument("--seconds", type=float, default=4.0)
    options = parser.parse_args()
    figures: dict[str, Any] = {way: {} for way in options.ways}
    for part in options.parts:
        for way in options.ways:
            if ONLY.get(part, way) == way:
                with place(way) as where, tempfile.TemporaryDirectory() as folder:
                    where.folder = Path(folder)
                    figures[way][part] = PARTS[part](where, options.seconds)
    print(table(figures), file=sys.stderr)
    report("small-computer", {"seconds": options.seconds, "goals": GOALS, **figures})


if __name__ == "__main__":
    main()
