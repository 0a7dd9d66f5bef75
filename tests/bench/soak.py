"""Benchmark of memory growth: a day of 2 kHz in minutes, for the server or a page.

    python tests/bench/soak.py server               24 h as fast as the server takes them, at most --minutes 10
    python tests/bench/soak.py page --speed 144     24 h in 10 minutes, into one page in Chromium
    … --hours 1 to try it · --save to keep the curves (soak-server.json, soak-page.json)

The server is the real one, in a process of its own, with one thing exchanged: its link makes the frames itself, and the
server's clock is theirs. So an hour has passed for every part of it (history, recordings that are split every hour and
culled by a quota, the clock's mapping, the event log) when an hour of frames has, however soon that is. `--speed`
bounds how soon. A client reads along; for it, as for the page, samples may be dropped, which is told.

    frames of a second ──> Link.read ──> session ─> telemetry ─> browser
         └─> clock of the server  └─> tape ─> files, an hour each ─> packer ─> quota

Kept: memory (RSS of the server; of the page that of its renderers, its JavaScript heap after a collection and its DOM
nodes) over hours of the devices' time, with the slope over the second half. Flat is at most `FLAT_MB_PER_H`.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import re
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from imuscope.server.links.base import Chunk, Link, LinkError, LinkSettings, Progress
from imuscope.server.settings.config import Config
from tests.bench.support.memory import curve
from tests.bench.support.report import options_of, report, status_of
from tests.bench.support.serial_devices import frames, numbered
from tests.checking.machine import descendants
from tests.support import load_clients
from tests.support.processes import resident_mb, seconds_of
from tests.support.server_process import ROOT, tied

RATE = 2000
CHUNKS_PER_S = 50  # 20 ms each: what a USB adapter with its timer as delivered makes of a stream
BEGAN_NS = 1_767_225_600 * 10**9
POINTS = 120  # points of a curve, at most
# 12 MB a day: the allocator of a healthy process wanders by that. A renderer's memory moves by tens of MB whenever its
# collector feels like it; what the page itself holds on to is its heap after a collection, and that must be as flat.
FLAT_MB_PER_H = {"server": 0.5, "page": 2.0, "heap": 0.1}
QUOTA_GB = 1.0


class Time:
    """The server's clock: as far as the frames have come."""

    def __init__(self) -> None:
        self.ns = BEGAN_NS

    def __call__(self) -> int:
        return self.ns


class Quick(Link):
    """A device that sends a second of frames per request, at most `speed` times faster than real time."""

    kind = "tcp"

    def __init__(self, source: str, settings: LinkSettings, clock: Time, speed: float, hours: float) -> None:
        super().__init__(source, settings)
        self._clock, self._speed, self._seconds = clock, speed, hours * 3600
        self._template = frames(0, RATE, RATE)
        self._done = 0  # seconds
        self._began = 0.0

    async def open(self, progress: Progress | None = None) -> None:
        self._began = time.monotonic()

    async def read(self) -> list[Chunk]:
        if self._done >= self._seconds:
            raise LinkError("ended", "The day is over.", "")
        early = self._began + self._done / self._speed - time.monotonic() if self._speed else 0.0
        await asyncio.sleep(max(0.0, early))
        data = numbered(self._template, self._done * RATE, RATE).tobytes()
        size = len(data) // CHUNKS_PER_S
        base = BEGAN_NS + self._done * 10**9
        step = 10**9 // CHUNKS_PER_S
        self._done += 1
        self._clock.ns = base + 10**9
        chunks = [Chunk(data[n * size : (n + 1) * size], base + (n + 1) * step) for n in range(CHUNKS_PER_S)]
        for chunk in chunks:
            self.flow.arrivals.call((chunk,))
        return chunks

    async def write(self, data: bytes) -> None:
        return

    async def close(self) -> None:
        return


def serve(options: argparse.Namespace) -> None:
    """The server, in this process, until it is ended."""
    from imuscope.server.access.auth import Access
    from imuscope.server.app.build import create_app
    from imuscope.server.devices.link import sessions
    from imuscope.server.http import server as http_server
    from imuscope.server.settings import logging_setup

    logging_setup.install("text", "error")  # a client is expected not to keep up with a day in minutes
    sessions.WALL_STEP_S = float("inf")  # its wall clock goes at another pace, all the time
    clock = Time()
    config = Config(
        data=options.data,
        sources=("tcp://192.0.2.1:1",),  # never opened: `open_link` below
        protocol="xbus",
        record=options.what == "server",
        record_head=False,
        split_min=60.0,
        recordings_quota_gb=QUOTA_GB,
        memory_mb=options.memory_mb,
    )

    def open_link(source: str, settings: LinkSettings) -> Link:
        return Quick(source, settings, clock, options.speed, options.hours)

    listener = http_server.listen("127.0.0.1", 0)
    app = create_app(config, Access(config), open_link=open_link, now_ns=clock)
    url = f"http://127.0.0.1:{listener.getsockname()[1]}"
    http_server.run(app, listener, lambda: print(url, flush=True))


class Soaked:
    """The server as a process, and how far it has come."""

    def __init__(self, options: argparse.Namespace, data: Path) -> None:
        messages = ["--hours", str(options.hours), "--speed", str(options.speed), "--memory-mb", str(options.memory_mb)]
        command = [sys.executable, str(Path(__file__).resolve()), options.what, "--serve", str(data), *messages]
        self.process = subprocess.Popen(tied(command), stdout=subprocess.PIPE, text=True, cwd=ROOT)
        assert self.process.stdout
        self.url = self.process.stdout.readline().strip()
        if not self.url:
            raise RuntimeError("the server did not come up; see above")
        self._size = int(frames(0, 1, RATE).shape[1])

    def metrics(self) -> dict[str, float]:
        """Families that have one sample, by name."""
        import httpx

        text = httpx.get(f"{self.url}/metrics", timeout=60).raise_for_status().text
        return {match[1]: float(match[2]) for match in re.finditer(r"^(\w+)(?:\{[^}]*\})? (\S+)$", text, re.MULTILINE)}

    def hours(self, notice: dict[str, float]) -> float:
        return notice.get("imuscope_link_received_bytes_total", 0.0) / self._size / RATE / 3600

    def stop(self) -> None:
        self.process.terminate()
        try:
            self.process.wait(30)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        assert self.process.stdout
        self.process.stdout.close()


async def watched(soaked: Soaked, options: argparse.Namespace, check: Any) -> dict[str, Any]:
    """Sample every few seconds until the day or the time is over; returns the server's final state."""
    began, notice = time.monotonic(), {}
    every = max(0.5, options.minutes * 60 / POINTS)
    while time.monotonic() - began < options.minutes * 60:
        notice = await asyncio.to_thread(soaked.metrics)
        hours = soaked.hours(notice)
        check(hours)
        if sys.stderr.isatty():
            print(f"\r{hours:6.2f} h", end="", file=sys.stderr, flush=True)
        if hours >= options.hours - 0.01:
            break
        await asyncio.sleep(every)
    minutes = (time.monotonic() - began) / 60
    return {
        "hours": soaked.hours(notice),
        "minutes": minutes,
        "speed": soaked.hours(notice) * 60 / minutes,
        "lost_samples": notice.get("imuscope_link_lost_samples_total"),
        "server_core_share": seconds_of(soaked.process.pid) / minutes / 60,
        "open_files": notice.get("process_open_fds"),
        "dropped": notice.get("imuscope_dropped_samples_total"),
    }


async def server_soak(soaked: Soaked, options: argparse.Namespace, data: Path) -> dict[str, Any]:
    points: list[tuple[float, float]] = []
    good = load_clients.Good()
    reading = asyncio.create_task(good.run(soaked.url))
    try:
        out = await watched(soaked, options, lambda hours: points.append((hours, resident_mb(soaked.process.pid))))
    finally:
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)
    entries = list((data / "recordings").glob("*.mcap"))
    recordings = {"files": len(entries), "gb": sum(path.stat().st_size for path in entries) / 1e9, "quota_gb": QUOTA_GB}
    return {**out, "recordings": recordings, "client_messages": good.messages, "memory": curve(points, "h")}


async def page_soak(soaked: Soaked, options: argparse.Namespace, data: Path) -> dict[str, Any]:
    from playwright.async_api import async_playwright

    from tests.support import chromium

    path = chromium.required()
    rss: list[tuple[float, float]] = []
    heap: list[tuple[float, float]] = []
    nodes: list[int] = []
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=path, args=chromium.ARGUMENTS)
        page = await (await browser.new_context(viewport={"width": 1440, "height": 900})).new_page()
        faults: list[str] = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        await page.goto(soaked.url)
        devtools = await page.context.new_cdp_session(page)
        await devtools.send("Performance.enable")

        async def watch() -> None:
            while True:
                await devtools.send("HeapProfiler.collectGarbage")
                notice = await devtools.send("Performance.getMetrics")
                figures = {one["name"]: one["value"] for one in notice["metrics"]}
                heap.append((places[-1] if places else 0.0, figures["JSHeapUsedSize"] / 1e6))
                nodes.append(int(figures["Nodes"]))
                rss.append((places[-1] if places else 0.0, sum(map(resident_mb, renderers()))))
                await asyncio.sleep(max(1.0, options.minutes * 60 / POINTS))

        places: list[float] = []
        viewers = asyncio.create_task(watch())
        try:
            out = await watched(soaked, options, places.append)
            if viewers.done():
                viewers.result()
        finally:
            viewers.cancel()
            await asyncio.gather(viewers, return_exceptions=True)
        observed = await page.evaluate(
            "window.imuscope?.store.channels.value.reduce((sum, channel) => sum + channel.ring.length, 0) ?? -1"
        )
        await browser.close()
    figures = {"memory": curve(rss, "h"), "heap": curve(heap, "h"), "nodes": [nodes[0], max(nodes), nodes[-1]]}
    return {**out, **figures, "samples_in_page": observed, "page_errors": faults[:5]}


def renderers() -> list[int]:
    """Renderer processes of Chromium that this process started."""
    results = []
    for pid in descendants(os.getpid()):
        with suppress(OSError):
            if b"--type=renderer" in Path(f"/proc/{pid}/cmdline").read_bytes():
                results.append(pid)
    return results


def main() -> int:
    """The command line."""
    parser = options_of("A day of 2 kHz, in minutes.")
    parser.add_argument("what", choices=("server", "page"))
    parser.add_argument("--hours", type=float, default=24)
    parser.add_argument("--minutes", type=float, default=10, help="at most, of our time")
    parser.add_argument(
        "--speed", type=float, default=0, help="at most so many times faster than our time; 0: no bound"
    )
    parser.add_argument("--memory-mb", type=int, default=64, help="of history")
    parser.add_argument("--serve", dest="data", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.data is not None:
        serve(options)
        return 0
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder)
        soaked = Soaked(options, data)
        try:
            soak = server_soak if options.what == "server" else page_soak
            out = asyncio.run(soak(soaked, options, data))
        finally:
            soaked.stop()
    flat = out["memory"]["mb_per_h"] <= FLAT_MB_PER_H[options.what]
    flat = flat and out.get("heap", {}).get("mb_per_h", 0.0) <= FLAT_MB_PER_H["heap"]
    entries = {"flat": flat, "nothing_lost": out["lost_samples"] == 0, "no_page_errors": not out.get("page_errors")}
    report(f"soak-{options.what}", {"rate_hz": RATE, **out, "budget": {"mb_per_h": FLAT_MB_PER_H}, "verdict": entries})
    return status_of(entries)


if __name__ == "__main__":
    raise SystemExit(main())
