"""Benchmark of a server during each flood. How soon it answers, and how late another device's bytes are recorded.

    python tests/bench/floods.py [--seconds 20] [--only NAME …] [--save]

One server, one device of 200 frames a second that is recorded, and one flood after the other
(tests/fault_injection/floods.py). /healthz is asked twenty times a second by a process that also sends the flood, so
what it takes is an upper bound.

The yardstick, in the same time: a piece of work in a thread of that process, which takes `slowness` times as long as it
would alone. Budget: an answer within a second of a machine that nobody else uses; the recording whole.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.bench.flood_latency import WITHIN_S, FloodLatency, lateness_s
from tests.bench.support.report import options_of, report
from tests.fault_injection.beside import Watched, watched
from tests.fault_injection.floods import FLOODS
from tests.support.processes import resident_mb


def lasting(seconds: float) -> Callable[[], bool]:
    """Whether so many seconds have passed since this call."""
    ends = time.monotonic() + seconds
    return lambda: time.monotonic() >= ends


def measure(there: Watched, name: str) -> dict[str, Any]:
    """The figures of one flood."""
    with FloodLatency(there.place.url) as beside:
        FLOODS[name](there.place)
    return {
        "answers": beside.answers,
        "worst_s": beside.worst_s,
        "slowness": beside.slowness,
        "whole": there.is_whole(),
        "recorded_after_s": lateness_s(there),
        "memory_mb": resident_mb(there.pid),
        "kept": beside.worst_s <= beside.limit_s,
    }


def main() -> int:
    """The command line."""
    parser = options_of("Beside each flood: answers, and the recording of another device.")
    parser.add_argument("--seconds", type=float, default=20, help="of each flood")
    parser.add_argument("--only", nargs="*", choices=FLOODS, default=list(FLOODS), help="these floods")
    options = parser.parse_args()
    floods = {}
    with tempfile.TemporaryDirectory() as folder, watched(Path(folder)) as there:
        there.place.lasts = lambda: lasting(options.seconds)
        for name in options.only:
            floods[name] = measure(there, name)
            print(json.dumps({name: floods[name]}), file=sys.stderr, flush=True)
    report("floods", {"seconds": options.seconds, "floods": floods, "budget": {"worst_s": WITHIN_S}})
    return int(not all(one["whole"] and one["kept"] for one in floods.values()))


if __name__ == "__main__":
    raise SystemExit(main())
