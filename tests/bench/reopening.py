"""Benchmark of reopening, zooming and querying a long recording.

    python tests/bench/reopening.py [--minutes 60] [--times 7] [--save]

The recording of tests/bench/opening.py lies in the library of a server of its own, which has one simulator. Headless
Chromium, 1440 × 900, plays the person; all times are the page's own clock, from the input to the frame that shows what
was wanted:

    first      from a press on its name in the library, never opened before, to the first plot (what is decoded by then)
    started    the same, opened once, with a server and a page that have just been started
    again      the same, once more: back to the library, and a press on its name
    pointed    the same, by a pointer that rested on the name for 150 ms, as one that is led by a hand does
    zoom       a key; from the whole length down to a second and back
    seek       a press on the strip of the whole recording, while a minute is on screen

Beside each: `server_cpu`, what the server's process took for it, and `page_cpu`, what the page's main thread did. On a
busy machine these say what a quiet one would need. The yardstick: how long the same page takes for a frame in which
nothing happens, and for a request of a file that is in the server's memory.

Budgets (design, section 9): first ≤ 4 s, started, again and pointed ≤ 0.3 s, zoom and seek ≤ 100 ms.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from playwright.sync_api import CDPSession, Page, sync_playwright

from tests.bench.opening import make
from tests.bench.support.report import options_of, percentile, report
from tests.support import chromium
from tests.support.processes import seconds_of
from tests.support.server_process import ServerProcess

NAME = "hour"

# Does something, and tells after how many ms a frame was painted in which all marks held; and when each of them did.
# A message that is posted in a frame comes when that has been painted. `hasPlot`: lines were drawn between the plots'
# first samples and now, so that an empty plot is none.
WATCH = """
window.watch = (act, marks) => new Promise((done, failed) => {
  const found = {}, names = Object.keys(marks), began = performance.now(), channel = new MessageChannel();
  performance.clearResourceTimings();
  channel.port1.onmessage = () => {
    found.painted = performance.now() - began;
    found.requests = performance.getEntriesByType("resource").map(
      one => [one.name.replace(/^.*?\\/\\/[^/]+/, "").replace(/\\?.*/, ""),
        one.startTime - began, one.responseStart - began, one.responseEnd - began].map(
          x => typeof x === "number" ? Math.round(x) : x));
    done(found);
  };
  const look = () => {
    for (const name of names) if (!(name in found) && marks[name]()) found[name] = performance.now() - began;
    if (performance.now() - began > 60_000) return failed(new Error("never: " + names.filter(n => !(n in found))));
    if (names.some(name => !(name in found))) return requestAnimationFrame(look);
    channel.port2.postMessage(0);
  };
  act();
  requestAnimationFrame(look);
});
let lines = 0;
const lineTo = CanvasRenderingContext2D.prototype.lineTo;
CanvasRenderingContext2D.prototype.lineTo = function (x, y) {
  lines += 1;
  return lineTo.call(this, x, y);
};
window.hasSamples = () => {
  const has = window.imuscopeReplay?.drawn.channels.value.some(({ring}) => ring.length > 20) === true;
  if (!has) lines = 0;
  return has;
};
window.hasPlot = () => window.hasSamples() && lines > 400;
window.press = (selector, x = 0.5) => {
  const target = document.querySelector(selector), box = target.getBoundingClientRect();
  const [clientX, clientY] = [box.left + x * box.width, box.top + box.height / 2];
  const at = {clientX, clientY, bubbles: true, button: 0, pointerId: 1};
  try { target.dispatchEvent(new PointerEvent("pointerdown", at)); } catch { }
  target.dispatchEvent(new PointerEvent("pointerup", at));
};
"""
LINK = "document.querySelector('.recording-list tbody tr b a')"
OPEN = f"""watch(() => {LINK}.click(), {{
  page: () => window.imuscopeReplay !== undefined, samples: window.hasSamples, plot: window.hasPlot}})"""
POINT = f"""async () => {{
  {LINK}.dispatchEvent(new PointerEvent("pointerenter"));
  await new Promise(done => setTimeout(done, 150));
  return ({OPEN});
}}"""
KEY = """key => watch(() => dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true})), {
  shown: () => window.imuscopeReplay.isShown})"""
SEEK = """x => watch(() => press(".overview canvas", x), {shown: () => window.imuscopeReplay.isShown})"""
FRAME = "watch(() => {}, {shown: () => true})"
REQUEST = """async () => {
  const began = performance.now();
  await (await fetch("/healthz")).arrayBuffer();
  return performance.now() - began;
}"""


class ReopenedScene:
    """One page on one server, and what both have used so far."""

    def __init__(self, page: Page, server: ServerProcess) -> None:
        self.page = page
        self.server = server
        self._cdp: CDPSession = page.context.new_cdp_session(page)
        self._cdp.send("Performance.enable", {"timeDomain": "threadTicks"})

    def _used(self) -> tuple[float, float]:
        """CPU of the server's process and of the page's main thread, s."""
        details = {one["name"]: one["value"] for one in self._cdp.send("Performance.getMetrics")["metrics"]}
        return seconds_of(self.server.process.pid), details["TaskDuration"]

    def did(self, script: str, argument: Any = None) -> dict[str, Any]:
        """Run one of the scripts; with what it took of both."""
        server, page = self._used()
        results: dict[str, Any] = self.page.evaluate(script, argument)
        after = self._used()
        return {**results, "server_cpu": 1000 * (after[0] - server), "page_cpu": 1000 * (after[1] - page)}

    def library(self) -> None:
        """Open the library and wait until it is idle."""
        self.page.evaluate("location.hash = '#/recordings'")
        chromium.until(self.page, f"{LINK} !== null")
        time.sleep(1.0)


def summary(results: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Median and 95th percentile of the wait, medians of what was used; ms."""
    waits = [one["painted"] for one in results]
    middle = {name: percentile([one[name] for one in results], 0.5) for name in ("server_cpu", "page_cpu")}
    return {"median": percentile(waits, 0.5), "p95": percentile(waits, 0.95), **middle}


def measure(data: Path, times: int, open_page: Callable[[ServerProcess], Page]) -> dict[str, Any]:
    """All figures, ms."""
    out: dict[str, Any] = {}
    with ServerProcess("sim:xbus", data=data) as server:
        scene = ReopenedScene(open_page(server), server)
        scene.library()
        out["first"] = scene.did(OPEN)["painted"]
        chromium.until(scene.page, "window.imuscopeReplay.progress.value === 1", timeout_s=120)
        scene.page.close()
    started = []
    for _ in range(times):
        with ServerProcess("sim:xbus", data=data) as server:
            scene = ReopenedScene(open_page(server), server)
            scene.library()
            started.append(scene.did(OPEN))
            if len(started) < times:
                scene.page.close()
                continue
            again = []
            for _ in range(times):
                scene.library()
                again.append(scene.did(OPEN))
            pointed = []
            for _ in range(times):
                scene.library()
                pointed.append(scene.did(POINT))
            time.sleep(1.0)
            zooms = [scene.did(KEY, key) for _ in range(2) for key in [*("+" * 14), *("-" * 14)]]
            for _ in range(7):
                scene.did(KEY, "+")
            seeks = [scene.did(SEEK, (0.05 + 0.618 * n) % 0.9) for n in range(30)]
            out["frame"] = percentile([scene.did(FRAME)["painted"] for _ in range(20)], 0.5)
            out["request"] = percentile([scene.page.evaluate(REQUEST) for _ in range(20)], 0.5)
            scene.page.close()
    if "--requests" in sys.argv:
        for name, one in (("started", started[-1]), ("again", again[-1]), ("pointed", pointed[-1])):
            print(name, {key: value for key, value in one.items() if key != "requests"})
            for request in one["requests"]:
                print("   ", *request)
    results = {"started": started, "again": again, "pointed": pointed, "zoom": zooms, "seek": seeks}
    return {**out, **{name: summary(ones) for name, ones in results.items()}}


def main() -> None:
    """The command line."""
    parser = options_of("Opening a long recording again, as a person sees it.")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--times", type=int, default=7)
    parser.add_argument(
        "--data", type=Path, help="a data folder to use again, with hour.mcap in its library or without"
    )
    parser.add_argument("--requests", action="store_true", help="tell the requests of the last opening, too")
    wish = parser.parse_args()
    path = chromium.required()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        data = wish.data or Path(folder)
        file = data / "recordings" / f"{NAME}.mcap"
        if not file.exists():
            file.parent.mkdir(parents=True, exist_ok=True)
            make(file, wish.minutes)
        browser = playwright.chromium.launch(executable_path=path, args=chromium.ARGUMENTS)

        def open_page(server: ServerProcess) -> Page:
            page = browser.new_context(viewport={"width": 1440, "height": 900}).new_page()
            page.add_init_script(WATCH)
            page.goto(f"{server.url}/#/recordings")
            return page

        figures = measure(data, wish.times, open_page)
        browser.close()
        report(
            "reopening",
            {"minutes": wish.minutes, "file_mb": file.stat().st_size / 1e6, "unit": "ms", **figures},
            extra_versions={"chromium": chromium.version(path)},
        )


if __name__ == "__main__":
    main()
