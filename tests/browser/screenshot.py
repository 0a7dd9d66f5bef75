"""Makes the picture at the top of the README: the real page, with the twin that a first start shows.

uv run python -m tests.browser.screenshot
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

from tests import chromium
from tests.conftest import READY
from tests.server_process import ROOT, ServerProcess

PICTURE = ROOT / "web" / "screenshot.png"
FILLED_S = 42  # the twin has turned by then, and the window is full


def main() -> None:
    """The command line."""
    path = chromium.find()
    if path is None:
        sys.exit("no Chromium on this machine: name one in IMUSCOPE_CHROMIUM")
    with (
        tempfile.TemporaryDirectory() as data,
        ServerProcess(data=Path(data)) as server,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=path, args=chromium.ARGUMENTS)
        page = browser.new_context(viewport={"width": 1440, "height": 900}, color_scheme="dark").new_page()
        page.goto(server.url)
        chromium.until(page, READY)
        time.sleep(FILLED_S)
        box = page.locator("#plots canvas").first.bounding_box()
        if box:
            page.mouse.move(box["x"] + 0.62 * box["width"], box["y"] + 0.5 * box["height"])
        time.sleep(0.5)
        page.screenshot(path=PICTURE)
        browser.close()
    print(PICTURE.relative_to(ROOT))


if __name__ == "__main__":
    main()
