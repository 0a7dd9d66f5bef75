"""Benchmark of a page with ten panels: an hour of 1 kHz from a recording while it is panned and played, and 1 kHz live.

    python tests/bench/ten_panels.py [--minutes 60] [--seconds 15] [--save]

The recording is that of opening.py. Shown are attitude, plots, values, health, alarms, events, XY plot, histogram,
spectrum and notes or satellites, as far as the device has them. For each of `whole` (an hour in view, which stands),
`pan` (a minute in view, moved with each frame), `play` (a minute, playing) and `live`:

    fps         frames a second, as drawn by the page's own loop, in software rendering
    cpu_ms      processor time of the page and its painter for each frame, ms; at most 22 leaves room for 45 frames/s
    heap_mb     JavaScript heap at the end

Budget: at least 45 frames/s on a machine that does nothing else. `load` says how many others wanted a processor.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any
from urllib.parse import quote

from playwright.sync_api import Page, sync_playwright

from tests.bench.opening import make
from tests.bench.support.report import options_of, report
from tests.support import chromium
from tests.support.server_process import ServerProcess

PANELS = ("xy", "histogram", "spectrum", "notes")
LAYOUT = {"layout": {"panels": {name: {"shown": True} for name in PANELS}}}
SHOWN = "document.querySelectorAll('[data-panel]').length"
FRAMES = """async seconds => {
  let frames = 0;
  const began = performance.now();
  while (performance.now() - began < 1000 * seconds) {
    await new Promise(done => requestAnimationFrame(done));
    window.onBenchFrame?.();
    frames += 1;
  }
  return [frames, (performance.now() - began) / 1000];
}"""
PAN = """window.onBenchFrame = () => {
  const {end, span} = imuscope.view.value, {first, last} = imuscopeReplay.bounds;
  imuscope.actions.panTo(end + span / 300 > last ? first + span : end + span / 300);
}"""


def processor_time(page: Page) -> float:
    """Seconds of processor time that the browser's pages and its painter have taken so far."""
    browser = page.context.browser
    assert browser is not None
    client = browser.new_browser_cdp_session()
    results = client.send("SystemInfo.getProcessInfo")["processInfo"]
    client.detach()
    return float(sum(one["cpuTime"] for one in results if one["type"] in ("renderer", "GPU")))


def wait_until(page: Page, condition: str, seconds: float = 400.0) -> None:
    """Return once the condition holds; polled rarely, because the page's decoder has the processor."""
    deadline = time.monotonic() + seconds
    while not page.evaluate(condition):
        if time.monotonic() > deadline:
            sys.exit(f"not within {seconds:.0f} s: {condition}")
        time.sleep(1)


def measured(page: Page, seconds: float) -> dict[str, float]:
    """Frames and their cost over some seconds."""
    page.wait_for_timeout(3000)  # what was begun by a change of the view is over
    before = processor_time(page)
    frames, took = page.evaluate(FRAMES, seconds)
    return {
        "fps": frames / took,
        "cpu_ms": 1000 * (processor_time(page) - before) / frames,
        "heap_mb": page.evaluate("performance.memory.usedJSHeapSize") / 1e6,
        "load": os.getloadavg()[0],
    }


def of_recording(page: Page, url: str, seconds: float) -> dict[str, Any]:
    """An hour of a recording: standing, panned and played."""
    workspace = quote(json.dumps(LAYOUT))
    page.goto(f"{url}/#/recordings/hour?workspace={workspace}")
    wait_until(page, "window.imuscopeReplay !== undefined && imuscopeReplay.progress.value === 1")
    wait_until(page, "imuscopeReplay.isShown")
    results: dict[str, Any] = {"panels": page.evaluate(SHOWN), "whole": measured(page, seconds)}
    page.evaluate("{const at = imuscopeReplay.bounds.first + 60; imuscope.actions.select(at, at + 60);}")
    page.evaluate(PAN)
    results["pan"] = measured(page, seconds)
    page.evaluate("window.onBenchFrame = undefined; imuscopeReplay.toggle()")
    results["play"] = measured(page, seconds)
    return results


def of_live(page: Page, url: str, seconds: float) -> dict[str, Any]:
    """A device at 1 kHz."""
    page.goto(f"{url}/#/?workspace={quote(json.dumps(LAYOUT))}")
    page.wait_for_selector(".plot", timeout=120_000)
    page.wait_for_timeout(25_000)  # the window is full
    return {"panels": page.evaluate(SHOWN), **measured(page, seconds)}


def main() -> None:
    """The command line."""
    parser = options_of("Frames of a page with ten panels.")
    parser.add_argument("--minutes", type=float, default=60.0, help="length of the recording")
    parser.add_argument("--seconds", type=float, default=15.0, help="length of each measurement")
    options = parser.parse_args()
    path = chromium.required()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        (Path(folder) / "recordings").mkdir()
        make(Path(folder) / "recordings" / "hour.mcap", options.minutes)
        browser = playwright.chromium.launch(executable_path=path, args=chromium.ARGUMENTS)
        with ServerProcess("sim:xbus?product=MTi-680G&rate=1000&seed=1&baud=2000000", data=Path(folder)) as server:
            page = browser.new_context(viewport={"width": 1440, "height": 900}).new_page()
            began = time.monotonic()
            recorded = of_recording(page, server.url, options.seconds)
            live = of_live(page, server.url, options.seconds)
            took = time.monotonic() - began
        browser.close()
    report(
        "ten-panels",
        {"minutes": options.minutes, "recording": recorded, "live": live, "took_s": took, "budget": {"fps": 45}},
        extra_versions={"chromium": chromium.version(path)},
    )


if __name__ == "__main__":
    main()
