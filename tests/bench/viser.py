"""Benchmark of the 3D scene at 2 kHz with one viewer and with ten.

    python tests/bench/viser.py [--save]

    feed (2 kHz, pty) ──> server ──pipe──> viser's process ──loopback──> server ──> viewers

Shares of one core, from /proc: of viser's process, and of the server beyond what it takes with nobody looking. A viewer
here takes what a browser would and draws nothing (tests/server/extensions/viser/viser_client.py); it is another
process's time. Beside them how many orientations of the body each viewer got a second, and the yardstick: the share
that the same feed costs the server with nobody looking.

Budget (issue "Rerun and viser"): `core`, both together, at most 10 % of a core at 60 Hz with one viewer.
"""

from __future__ import annotations

import argparse
import asyncio
import tempfile
import time
from contextlib import AsyncExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx

from tests.bench.support import serial_device as feeding
from tests.bench.support.report import options_of, percentile, report
from tests.server.extensions.viser.viser_client import turns, viewing
from tests.support.forking.forked_workers import workers_of
from tests.support.processes import seconds_of
from tests.support.server_process import ServerProcess

RATE = 2000.0
SETTLE_S = 3.0
BUDGET = 0.10


class Viewer:
    """Arrival times of the body's orientations."""

    def __init__(self) -> None:
        self.at: list[float] = []

    async def watch(self, url: str) -> None:
        async with viewing(url) as socket:
            while True:
                data = await socket.recv()
                if turns(data):
                    self.at.append(time.monotonic())


async def watched(url: str, viewers: int, server: int, seconds: float) -> dict[str, Any]:
    """Shares of a core with this number of viewers."""
    async with AsyncExitStack() as stack:
        group = [Viewer() for _ in range(viewers)]
        tasks = [asyncio.create_task(viewer.watch(url)) for viewer in group]
        stack.callback(lambda: [task.cancel() for task in tasks])
        await asyncio.sleep(SETTLE_S)
        [pid] = workers_of(server, "imuscope.server.extensions.viser.worker")
        begun, before, ours = time.monotonic(), seconds_of(pid), seconds_of(server)
        await asyncio.sleep(seconds)
        ended = time.monotonic()
        span, spent, served = ended - begun, seconds_of(pid) - before, seconds_of(server) - ours
        for task in tasks:
            if task.done():
                task.result()
    each = [[at for at in viewer.at if begun <= at <= ended] for viewer in group]
    apart = [1000 * (b - a) for times in each for a, b in pairwise(times)]
    return {
        "viewers": viewers,
        "viser_core": spent / span,
        "server_core": served / span,
        "turns_per_s": min(len(times) for times in each) / span,
        "apart_p50_ms": percentile(apart, 0.5),
        "apart_p99_ms": percentile(apart, 0.99),
    }


def main() -> None:
    """Measure, print, keep."""
    options = options_of(__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--seconds", type=float, default=10.0)
    seconds = options.parse_args().seconds
    whole = 3 * (seconds + SETTLE_S) + 40
    with (
        tempfile.TemporaryDirectory() as data,
        feeding.Feed(RATE, whole) as feed,
        ServerProcess(f"serial://{feed.terminal}?baud=2000000", data=Path(data)) as server,
    ):
        pid = server.process.pid
        feed.begin()
        time.sleep(SETTLE_S)
        feeding.must_be_live(server.url)
        before = seconds_of(pid)
        time.sleep(seconds)
        alone = (seconds_of(pid) - before) / seconds
        begun = time.monotonic()
        httpx.get(server.url + "/viser/", timeout=60).raise_for_status()
        first = time.monotonic() - begun
        results = [asyncio.run(watched(server.url, viewers, pid, seconds)) for viewers in (1, 10)]
    for one in results:
        one["server_core_more"] = one["server_core"] - alone
        one["core"] = one["viser_core"] + one["server_core_more"]
        one["of_yardstick"] = one["viser_core"] / alone
    figures = {"rate": RATE, "nobody_server_core": alone, "first_look_s": first, "looked_at": results, "budget": BUDGET}
    report("viser", figures)


if __name__ == "__main__":
    main()
