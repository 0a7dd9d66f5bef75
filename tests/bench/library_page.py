"""Benchmark of the library's page: 2,000 recordings listed, searched, sorted and scrolled.

    python -m tests.bench.library_page [--recordings 2000] [--save]

The recordings are copies of one of two seconds with notes, tags and an index, in the folder of a real server. In
headless Chromium with software rendering, at 1440 × 900:

    list_ms          the answer of the server to a request for the list, the median of five
    first_paint_ms   from the page's call for the list to the frame that shows its first rows, without that answer
    key_ms           from a key in the search to the next frame, the median and the longest of 40
    sort_ms          from a press on a head to the next frame, the longest of ten
    scroll_p95_ms    95 % of frames follow the one before within this time while the list is scrolled
    elements         in the list

The yardstick, in the same run, is the same of a key in an empty page (`empty_key_ms`), and its frames (`empty_p95_ms`).
Budget: first paint 300 ms, a key 50 ms, on a machine that does nothing else.
"""

from __future__ import annotations

import shutil
import statistics
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

import imuscope
from imuscope.recordings import sidecar
from imuscope.recordings.library.index import INDEX, summarize, write_index
from imuscope.server.library.decoder_fingerprint import decoding_mark
from tests.bench.fleet_page import FRAMES, WIDE
from tests.bench.support.report import options_of, report
from tests.support import chromium
from tests.support.server_process import ServerProcess
from tests.web.wire_scenes import yard_loop

PAINTED = "new Promise(done => requestAnimationFrame(() => setTimeout(done)))"
KEYS = f"""async selector => {{
  const field = document.querySelector(selector), took = [];
  for (const text of ["y", "ya", "yar", "yard", "yard 1", "yard 17", "yar", ""].flatMap(one => Array(5).fill(one))) {{
    const began = performance.now();
    field.value = text;
    field.dispatchEvent(new Event("input", {{bubbles: true}}));
    await {PAINTED};
    took.push(performance.now() - began);
  }}
  return took;
}}"""
SORTS = f"""async () => {{
  const took = [];
  for (let n = 0; n < 10; n++) {{
    const heads = document.querySelectorAll(".recording-list th button");
    const began = performance.now();
    heads[n % heads.length].click();
    await {PAINTED};
    took.push(performance.now() - began);
  }}
  return took;
}}"""
SCROLL = """(() => {
  const list = document.querySelector('.recording-list');
  window.onBenchFrame = () => { list.scrollTop += 120; };
})()"""
FIRST = f"""async () => {{
  const asked = window.fetch;
  let answered = 0;
  window.fetch = async (...request) => {{
    const answer = await asked(...request);
    if (!String(request[0]).endsWith("/api/recordings")) return answer;
    const body = await answer.arrayBuffer();
    answered = performance.now();
    return new Response(body, answer);
  }};
  location.hash = "#/recordings";
  while (!document.querySelector(".recording-list tbody tr")) await {PAINTED};
  await {PAINTED};
  return performance.now() - answered;
}}"""


def fill(folder: Path, count: int) -> None:
    """Recordings with notes, tags and what is known of them."""
    folder.mkdir(parents=True)
    first = folder / "20260101T000000Z-MTi-630.mcap"
    yard_loop(first, "", rate=100, seconds=2)
    summary = summarize(imuscope.open(first)._store)
    for n in range(count):
        path = folder / f"2026{1 + n // 200:02}{1 + n % 28:02}T{n % 24:02}{n % 60:02}00Z-MTi-630-{n}.mcap"
        shutil.copy(first, path)
        write_index(folder, path, {**summary, "started": 1_767_225_600.0 + 3600 * n}, decoding_mark())
        if n % 3 == 0:
            sidecar.write(path, sidecar.Edits(notes=f"Drive {n} round the yard", tags=("yard",)))
    first.unlink()
    assert len(list((folder / INDEX).iterdir())) == count


def frames(page: Page) -> float:
    return float(page.evaluate(FRAMES, 3.0)["p95_ms"])


def main() -> None:
    """The command line."""
    parser = options_of("The page of the library with many recordings.")
    parser.add_argument("--recordings", type=int, default=2000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as data:
        fill(Path(data) / "recordings", options.recordings)
        with ServerProcess("udp://:0", data=Path(data)) as server, sync_playwright() as playwright:
            lists = []
            for _ in range(6):
                began = time.perf_counter()
                server.request("GET", "/api/recordings")
                lists.append(1000 * (time.perf_counter() - began))
            browser = playwright.chromium.launch(executable_path=chromium.required(), args=chromium.ARGUMENTS)
            page = browser.new_context(viewport={"width": WIDE[0], "height": WIDE[1]}).new_page()
            page.goto(f"{server.url}/#/live")
            page.wait_for_function("window.imuscope?.store.connection.value === 'open'")
            page.wait_for_timeout(1000)
            first_paint = page.evaluate(FIRST)
            keys = page.evaluate(KEYS, "input[type=search]")
            sorts = page.evaluate(SORTS)
            elements = page.evaluate("document.querySelectorAll('.recording-list *').length")
            page.evaluate(SCROLL)
            scrolled = frames(page)
            page.goto("about:blank")
            page.set_content("<input type=search>")
            empty = page.evaluate(KEYS, "input[type=search]")
            still = frames(page)
            browser.close()
    results = {
        "recordings": options.recordings,
        "list_ms": statistics.median(lists[1:]),
        "first_paint_ms": first_paint,
        "key_ms": statistics.median(keys),
        "longest_key_ms": max(keys),
        "sort_ms": max(sorts),
        "scroll_p95_ms": scrolled,
        "elements": elements,
        "empty_key_ms": statistics.median(empty),
        "empty_longest_key_ms": max(empty),
        "empty_p95_ms": still,
    }
    report("library-page", results, extra_versions={"chromium": chromium.version(chromium.required())})


if __name__ == "__main__":
    main()
