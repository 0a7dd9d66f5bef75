"""Benchmark of the fleet page: a thousand robots that change each second, while a person scrolls, sorts and filters.

    python tests/bench/fleet_page.py [--robots 1000] [--seconds 10] [--save]

The robots are those of tests/server/extensions/fleet/synthetic_fleet.py, through a real server and its route; nearly
all of them change each second. In headless Chromium with software rendering, at 1440 × 900, each of

    still       nothing but figures that change
    scroll      the list scrolled by half a row with each frame
    sort        another column each half second
    filter      another filter, grouping or search each half second
    details     scrolled with the details of a robot open
    phone       scrolled at 390 × 844
    map         the map of all robots

is measured for some seconds:

    fps         frames a second
    p95_ms      95 % of frames follow the one before within this time
    longest_ms  the longest time without a frame
    cpu_ms      processor time of the page and its painter for each frame
    load        how many processes wanted a processor

Budget: 60 frames/s, the most that the browser asks for, on a machine that does nothing else. `empty_page_fps` is what
it gives to a page that shows nothing, at the same time.
"""

from __future__ import annotations

import os
import subprocess
import sys

from playwright.sync_api import Browser, Page, sync_playwright

from tests.bench.support.report import options_of, report
from tests.bench.ten_panels import processor_time
from tests.support import chromium
from tests.support.server_process import ROOT, tied

WIDE, PHONE = (1440, 900), (390, 844)
FRAMES = """async seconds => {
  const took = [];
  const began = performance.now();
  let last = began;
  while (last - began < 1000 * seconds) {
    await new Promise(done => requestAnimationFrame(done));
    const now = performance.now();
    took.push(now - last);
    last = now;
    window.onBenchFrame?.(took.length);
  }
  const all = (last - began) / 1000, sorted = took.toSorted((a, b) => a - b);
  return {frames: took.length, fps: took.length / all, p95_ms: sorted[Math.floor(0.95 * sorted.length)],
    longest_ms: sorted.at(-1)};
}"""
SCROLL = """(() => {
  const list = document.querySelector('.fleet-list');
  let step = 16;
  window.onBenchFrame = () => {
    const before = list.scrollTop;
    list.scrollTop += step;
    if (list.scrollTop === before) step = -step;
  };
})()"""
SORT = """window.onBenchFrame = n => {
  if (n % 30 === 0) {
    const heads = document.querySelectorAll('.fleet-head button');
    heads[(n / 30) % heads.length].click();
  }
}"""
FILTER = """window.onBenchFrame = n => {
  if (n % 30 !== 0) return;
  const turn = (n / 30) % 3;
  if (turn === 0) {
    const filters = document.querySelectorAll('.fleet-summary button');
    filters[(n / 90) % filters.length].click();
    return;
  }
  const field = document.querySelector(turn === 1 ? '.fleet-tools select' : '.fleet-tools input');
  field.value = turn === 1 ? ['none', 'group', 'firmware'][(n / 90) % 3] : field.value === '' ? 'amr-1' : '';
  field.dispatchEvent(new Event(turn === 1 ? 'change' : 'input', {bubbles: true}));
}"""
NOTHING = "window.onBenchFrame = undefined"


def opened(browser: Browser, url: str, size: tuple[int, int], at: str = "") -> Page:
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, has_touch=size == PHONE)
    page = context.new_page()
    page.goto(url + at)
    page.wait_for_selector(".fleet-row, .map-cell", timeout=60_000)
    page.wait_for_timeout(3000)
    return page


def measured(page: Page, seconds: float, script: str) -> dict[str, float]:
    """Frames and their cost over some seconds while a script acts with each frame."""
    page.evaluate(script)
    before = processor_time(page)
    result: dict[str, float] = page.evaluate(FRAMES, seconds)
    frames = result.pop("frames")
    result["cpu_ms"] = 1000 * (processor_time(page) - before) / frames
    result["load"] = os.getloadavg()[0]
    return result


def main() -> None:
    """The command line."""
    parser = options_of("Frames of the fleet page.")
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=10.0, help="length of each measurement")
    options = parser.parse_args()
    path = chromium.required()
    command = tied(
        [sys.executable, "-m", "tests.server.extensions.fleet.synthetic_fleet", "--robots", str(options.robots)]
    )
    results: dict[str, dict[str, float]] = {}
    with (
        subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as server,
        sync_playwright() as playwright,
    ):
        assert server.stdout is not None
        url = server.stdout.readline().strip()
        browser = playwright.chromium.launch(executable_path=path, args=chromium.ARGUMENTS)
        page = opened(browser, url, WIDE)
        rows = page.evaluate("document.querySelectorAll('.fleet-row').length")
        for name, script in (("still", NOTHING), ("scroll", SCROLL), ("sort", SORT), ("filter", FILTER)):
            results[name] = measured(page, options.seconds, script)
        heap = page.evaluate("performance.memory.usedJSHeapSize") / 1e6
        page.context.close()
        for name, size, at in (
            ("details", WIDE, "#/fleet?robot=amr-005"),
            ("phone", PHONE, ""),
            ("map", WIDE, "#/fleet?view=map"),
        ):
            page = opened(browser, url, size, at)
            results[name] = measured(page, options.seconds, NOTHING if name == "map" else SCROLL)
            page.context.close()
        page = browser.new_context(viewport={"width": WIDE[0], "height": WIDE[1]}).new_page()
        empty = measured(page, options.seconds, NOTHING)["fps"]
        browser.close()
        server.terminate()
    report(
        "fleet-page",
        {
            "robots": options.robots,
            **results,
            "rows_in_document": rows,
            "heap_mb": heap,
            "empty_page_fps": empty,
            "budget": {"fps": 60},
        },
        extra_versions={"chromium": chromium.version(path)},
    )


if __name__ == "__main__":
    main()
