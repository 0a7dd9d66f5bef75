"""Benchmark of latency from the port to the page. From the write on a pseudo-terminal to typed arrays in the page's
worker.

    feed ── write, stamp ──> pty ──> server ──> WebSocket ──> worker: postMessage(typed arrays), stamp

The page is the real one, drawing all it draws, in headless Chromium with software rendering; its worker is asked to
note when it hands samples over, and the packet counter says which write they were. Further clients stand for browsers
on other machines: they read the same bytes and draw nothing here (`--pages N` opens N pages instead, which on a small
machine measures how many pages it can draw). The yardstick beside it: the same bytes read back from a pseudo-terminal
by a bare loop, i.e. what the kernel and this machine's scheduling alone cost.

Budget: p99 at most 20 ms at 2 kHz, for one to four clients.
"""

from __future__ import annotations

import contextlib
import os
import pty
import select
import subprocess
import sys
import tempfile
import threading
import time
import tty
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Worker, sync_playwright

from tests.bench.support import serial_device as feeding
from tests.bench.support.report import options_of, percentile, report
from tests.support import chromium
from tests.support.server_process import ROOT, ServerProcess, tied

SETTLE_S = 4.0

# In the worker: note the wall clock (ms) and the packet counter of every live sample handed to the page.
NOTE = """() => {
  const ids = new Set(), hand = self.postMessage.bind(self);
  self.noted = [];
  self.postMessage = (message, options) => {
    const now = performance.timeOrigin + performance.now();
    if (message.kind === "text" && message.text.op === "channels")
      for (const channel of message.text.channels) if (channel.name === "PacketCounter") ids.add(channel.id);
    if (message.kind === "frames")
      for (const frame of message.frames)
        if (ids.has(frame.channel) && !frame.history)
          for (const count of frame.columns[0]) self.noted.push([now, count]);
    hand(message, options);
  };
}"""
CLOCK = "() => performance.timeOrigin + performance.now()"


def clock_offset_s(worker: Worker) -> float:
    """Offset of the worker's clock from the local one, from the fastest of some round trips."""
    trips = []
    for _ in range(20):
        before = time.time()
        theirs = worker.evaluate(CLOCK) / 1000
        after = time.time()
        trips.append((after - before, theirs - (before + after) / 2))
    return float(min(trips)[1])


def delays_ms(noted: list[tuple[float, int]], written: list[float], offset: float) -> list[float]:
    """Milliseconds from write to worker, the settling time left out."""
    start, result, turn, last = written[0] + SETTLE_S, [], 0, 0
    for at, count in noted:
        if count < last - 30_000:
            turn += 1
        last = count
        index = count + 65_536 * turn
        if index < len(written) and written[index] >= start:
            result.append(1000 * (at / 1000 - offset - written[index]))
    return result


def product(browser: Browser, pages: int, readers: int, rate: float, seconds: float) -> dict[str, Any]:
    """The whole way, with so many pages here and readers that stand for pages elsewhere."""
    with (
        tempfile.TemporaryDirectory() as data,
        feeding.Feed(rate, SETTLE_S + seconds) as feed,
        contextlib.ExitStack() as contexts,
    ):
        server = contexts.enter_context(ServerProcess(f"serial://{feed.terminal}?baud=2000000", data=Path(data)))
        workers = []
        if readers:
            reading = tied(
                [sys.executable, str(ROOT / "tests/bench/support/remote_browsers.py"), server.url, str(readers)]
            )
            others = contexts.enter_context(subprocess.Popen(reading))
            contexts.callback(others.terminate)
        for _ in range(pages):
            context = contexts.enter_context(browser.new_context(viewport={"width": 1440, "height": 900}))
            page = context.new_page()
            page.goto(server.url)
            chromium.until(page, "window.imuscope?.store.connection.value === 'open'")
            workers.append(page.workers[0])
        for worker in workers:
            worker.evaluate(NOTE)
        offsets = [clock_offset_s(worker) for worker in workers]
        feed.begin()
        time.sleep(SETTLE_S / 2)
        feeding.must_be_live(server.url)
        written = feed.written()
        time.sleep(0.5)
        noted = [worker.evaluate("() => self.noted") for worker in workers]
    each = [delays_ms(rows, written, offset) for rows, offset in zip(noted, offsets, strict=True)]
    expected = sum(at >= written[0] + SETTLE_S for at in written)
    every = [delay for delays in each for delay in delays]
    return {
        "clients": pages + readers,
        "pages": pages,
        "samples": len(every),
        "missing": max(0, pages * expected - len(every)),
        "p50_ms": percentile(every, 0.5),
        "p99_ms": percentile(every, 0.99),
        "worst_client_p99_ms": max(percentile(delays, 0.99) for delays in each),
    }


def bare(rate: float, seconds: float) -> dict[str, float]:
    """The yardstick: the same frames through a pseudo-terminal into a loop that only reads."""
    frames = [feeding.frame(index, rate) for index in range(round(rate * seconds))]
    size = len(frames[0])
    master, slave = pty.openpty()
    tty.setraw(slave)
    written: list[float] = []
    arrived: list[float] = []

    def read() -> None:
        count = 0
        while count < size * len(frames):
            select.select([slave], [], [])
            count += len(os.read(slave, 65_536))
            now = time.time()
            arrived.extend([now] * (count // size - len(arrived)))

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    began = time.monotonic()
    for index, data in enumerate(frames):
        time.sleep(max(0.0, began + index / rate - time.monotonic()))
        written.append(time.time())
        os.write(master, data)
    reader.join(5)
    os.close(master)
    os.close(slave)
    delays = [1000 * (after - before) for before, after in zip(written, arrived, strict=False)]
    return {"p50_ms": percentile(delays, 0.5), "p99_ms": percentile(delays, 0.99)}


def main() -> None:
    """The command line."""
    parser = options_of("Latency from a pseudo-terminal to the page's worker.")
    parser.add_argument("--clients", type=int, nargs="*", default=[1, 2, 4])
    parser.add_argument("--pages", type=int, default=1, help="so many of the clients are pages on this machine")
    parser.add_argument("--rate", type=float, default=2000)
    parser.add_argument("--seconds", type=float, default=10)
    options = parser.parse_args()
    path = chromium.required()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=chromium.ARGUMENTS)
        rows = []
        for clients in options.clients:
            pages = min(clients, options.pages)
            rows.append(product(browser, pages, clients - pages, options.rate, options.seconds))
        browser.close()
    yardstick = bare(options.rate, min(5.0, options.seconds))
    figures = {"rate_hz": options.rate, "runs": rows, "yardstick": yardstick, "budget": {"p99_ms": 20}}
    figures["ratio"] = max(row["p99_ms"] for row in rows) / yardstick["p99_ms"]
    report("latency", figures, extra_versions={"chromium": chromium.version(path)})


if __name__ == "__main__":
    main()
