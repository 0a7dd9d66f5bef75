"""Benchmark of start-up to the first samples, and of the weight of the page.

    imuscope ──> /healthz answers ──> page opened ──> first sample in the page

Twice: the first start ever (nothing compiled yet: an empty cache) and the next one. "Usable" is the page showing
samples of the simulator. The weight is what a browser downloads at the first load, compressed as the server sends it,
counted by the browser itself. The yardstick: a Python process that imports the same foundations and does nothing.

Budget: 2 s; the very first start 3 s until the page is served and 12 s until the first samples; 250 kB.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, sync_playwright

from tests.bench.support.report import options_of, report
from tests.support import chromium
from tests.support.server_process import ServerProcess

USABLE = "window.imuscope?.store.channels.value.some(channel => channel.ring.length > 10)"


def start(browser: Browser, data: Path) -> dict[str, Any]:
    """One start with `data` as its data folder, to the first samples on the page."""
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    page = context.new_page()
    session = context.new_cdp_session(page)
    session.send("Network.enable")
    weights: list[float] = []
    session.on("Network.loadingFinished", lambda event: weights.append(event["encodedDataLength"]))
    began = time.monotonic()
    with ServerProcess("sim:xbus", data=data) as server:
        answering = time.monotonic() - began
        page.goto(server.url)
        chromium.until(page, USABLE)
        usable = time.monotonic() - began
        requests = page.evaluate("performance.getEntriesByType('resource').length") + 1
    context.close()
    return {"answers_s": answering, "usable_s": usable, "requests": requests, "page_kb": sum(weights) / 1000}


def importing() -> float:
    """The yardstick: seconds to start Python with the same foundations."""
    began = time.monotonic()
    subprocess.run([sys.executable, "-c", "import numpy, fastapi, uvicorn"], check=True)
    return time.monotonic() - began


def main() -> None:
    """The command line."""
    parser = options_of("Start to page usable, and the page's weight.")
    parser.parse_args()
    path = chromium.required()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # as on a machine that is not set up to build images
    with tempfile.TemporaryDirectory() as data, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=chromium.ARGUMENTS)
        browser.new_context().new_page().goto("about:blank")  # the browser itself is warm
        first, later = start(browser, Path(data)), start(browser, Path(data))
        browser.close()
    figures = {
        "first_ever": first,
        "later": later,
        "yardstick": {"imports_s": importing()},
        "budget": {"first_ever_page_s": 3, "first_ever_s": 12, "later_s": 2, "page_kb": 250},
    }
    figures["ratio"] = later["usable_s"] / figures["yardstick"]["imports_s"]
    report("start", figures, extra_versions={"chromium": chromium.version(path)})


if __name__ == "__main__":
    main()
