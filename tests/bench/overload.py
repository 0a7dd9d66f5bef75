"""Benchmark of an overloaded computer: five busy loops beside three devices of 400 Hz, a recording and a page.

    python tests/bench/overload.py                       ten minutes of load on this computer
    python tests/bench/overload.py --cores 1             … with everything on one core
    … --minutes 0.5 to try it · --save to keep the result (overload.json)

Figures: how late samples were for a page (from the arrival of their bytes), before, during and after the load; for how
long they were later than a second without the page being told; bytes in the recording against bytes sent; losses and
rejects that were reported, of which there are none; how long after the load samples were on time again. The yardstick
is how late a process was that only sleeps and writes: the one of the devices.

Verdict, and the exit status: recordings whole, no loss reported, told within a second, well within 10 s.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from tests.bench.load import Api
from tests.bench.support.report import options_of, percentile, report, status_of
from tests.bench.support.serial_devices import Speakers, is_whole, received_in
from tests.support.load_clients import Good
from tests.support.server_process import ServerProcess

BEFORE_S, AFTER_S = 10.0, 20.0
REPORTED_S, LATE_S = 0.5, 1.0
WELL_S = 0.1  # ages of samples in a server that keeps up
BUDGET = {"untold_s": 1.0, "well_after_s": 10.0}


class Page(Good):
    """A page that notes how late samples are, and what it is told of that."""

    def __init__(self) -> None:
        super().__init__()
        self.noted: list[tuple[float, float]] = []  # (unix s, age of the oldest sample of a message in s)
        self.reports: list[tuple[float, float]] = []  # (unix s, s by which the server says a device is behind)
        self.events: list[dict[str, Any]] = []

    def take(self, data: bytes, now: float) -> None:
        """Note the age as well."""
        super().take(data, now)
        self.noted.append((now, self.ages[-1]))

    def receive(self, text: str, now: float) -> None:
        """Note a message of the server."""
        message = json.loads(text)
        if message["op"] == "health" and message["devices"]:
            behind = [one["behind"] for one in message["devices"]]
            self.reports.append((now, max(one["link"] + one["decoding"] for one in behind)))
        elif message["op"] == "events":
            self.events += message["events"]

    def later_than(self, limit: float, since: float) -> float:
        """The last time at which samples were later than that, s after `since`; 0 if they never were."""
        return max((at - since for at, age in self.noted if at > since and age > limit), default=0.0)

    def untold(self) -> float:
        """Longest time during which samples were later than `LATE_S` and nothing was told, s."""
        longest, began = 0.0, None
        notice = iter(self.reports)
        last_at, last = next(notice, (0.0, 0.0))
        for at, age in self.noted:
            while last_at < at - LATE_S:
                last_at, last = next(notice, (float("inf"), last))
            if age > LATE_S and last < REPORTED_S:
                began = at if began is None else began
                longest = max(longest, at - began)
            else:
                began = None
        return longest


async def watch(options: argparse.Namespace, server: ServerProcess, speakers: Speakers) -> dict[str, Any]:
    """The run: before, during and after the load."""
    page, api = Page(), Api(server.url)
    task = asyncio.create_task(page.run(server.url))
    await page.subscribed.wait()
    await asyncio.to_thread(speakers.go)
    await asyncio.sleep(BEFORE_S)
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(options.loops)]
    began = time.time()
    await asyncio.sleep(options.minutes * 60)
    for loop in loops:
        loop.kill()
        loop.wait()
    ended = time.time()
    sent = await asyncio.to_thread(speakers.sent)
    await api.received_all(sent["devices"])
    await api.post("/api/recordings/stop")
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)

    def ages(since: float, until: float) -> list[float]:
        return sorted(age for at, age in page.noted if since < at <= until)

    return {
        "before_p99_ms": 1e3 * percentile(ages(0, began), 0.99),
        "during_p99_ms": 1e3 * percentile(ages(began, ended), 0.99),
        "during_max_ms": 1e3 * max(ages(began, ended), default=float("nan")),
        "told_max_s": max((one for at, one in page.reports if at > began), default=0.0),
        "untold_s": page.untold(),
        "well_after_s": page.later_than(WELL_S, ended),
        "lost_reported": [one["text"] for one in page.events if one["kind"] in ("gap", "reject")],
        "dropped": page.lost,
        "late_p99_ms": sent["late_p99_ms"],
        "late_max_ms": sent["late_max_ms"],
    }


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Server and devices around a run; then what is in the recording."""
    if options.cores:
        os.sched_setaffinity(0, set(sorted(os.sched_getaffinity(0))[: options.cores]))
    length = BEFORE_S + options.minutes * 60 + AFTER_S
    with tempfile.TemporaryDirectory() as folder, Speakers(options.devices, options.rate, length) as speakers:
        data = Path(folder)
        sources = [f"serial://{terminal}?baud=2000000&protocol=xbus" for terminal in speakers.terminals]
        with ServerProcess(*sources, data=data, arguments=("--record",)) as server:
            out = asyncio.run(watch(options, server, speakers))
        sent = speakers.sent()["devices"]
        received = received_in(sorted((data / "recordings").glob("*.mcap")))
    out["recorded_as_sent"] = is_whole(received, sent)
    return out


def verdict(out: dict[str, Any]) -> dict[str, bool]:
    """Of each promise, whether it was kept."""
    return {
        "recordings_whole": out["recorded_as_sent"],
        "no_false_cause": not out["lost_reported"],
        "told_in_time": out["untold_s"] <= BUDGET["untold_s"],
        "well_again": out["well_after_s"] <= BUDGET["well_after_s"],
    }


def main() -> int:
    """The command line."""
    parser = options_of("Devices, a recording and a page beside busy loops.")
    parser.add_argument("--devices", type=int, default=3)
    parser.add_argument("--rate", type=float, default=400)
    parser.add_argument("--loops", type=int, default=5)
    parser.add_argument("--cores", type=int, default=0, help="everything on so many cores; 0: all")
    parser.add_argument("--minutes", type=float, default=10)
    options = parser.parse_args()
    out = measure(options)
    stored = verdict(out)
    request = {name: getattr(options, name) for name in ("devices", "rate", "loops", "cores", "minutes")}
    report("overload", {**request, **out, "budget": BUDGET, "verdict": stored})
    return status_of(stored)


if __name__ == "__main__":
    raise SystemExit(main())
