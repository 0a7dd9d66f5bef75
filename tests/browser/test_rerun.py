"""Rerun's viewer in a real browser: it opens recordings and live data, contacts no other host, and the body turns.

What is drawn is compared by pixels: the 3D view is filled, and two attitudes look different.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page, Route

from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.server.extensions.rerun.rrd.size_limit import limit_for
from tests.browser.page_checks import SILENT
from tests.conftest import ARTIFACTS
from tests.recordings.recorded_drive import START, drive
from tests.support.chromium import until
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, get
from tests.support.waiting import block_until

BODY_VIEW = (0, 40, 440, 250)  # of a window of 900 × 600: left, top, right, bottom


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rerun")
    (folder / "recordings").mkdir()
    viewers = ARTIFACTS / "rerun-viewers"  # taken out of the package once for all runs
    viewers.mkdir(parents=True, exist_ok=True)
    (folder / "cache").mkdir()
    (folder / "cache" / "rerun").symlink_to(viewers)
    drive(folder / "recordings" / "drive.mcap")
    turned(folder / "recordings" / "turned.mcap")
    return folder


def turned(path: Path) -> None:
    """Three seconds of the same device twenty seconds later, when it has turned."""
    device = XbusSimulator(start_ns=0)
    device.advance(20_000_000_000)
    writer = McapWriter(path, {"title": "Turned"})
    writer.device("1", {"source": "/dev/ttyUSB0", "link": "serial", "baud": 921600, "protocol": "xbus"})
    for n in range(2001, 2300):
        if data := device.advance(n * 10_000_000):
            writer.chunk("1", "rx", data, START + n * 10_000_000)
    writer.close()


def picture(page: Page) -> NDArray[Any]:
    """The screen, (height, width, 3). Without a GPU, the viewer's first frames take seconds."""
    return np.asarray(Image.open(io.BytesIO(page.screenshot(timeout=1000 * PATIENCE_S))).convert("RGB"), np.int16)


def nose(pixels: NDArray[Any]) -> NDArray[np.bool_]:
    """Position of the body's orange nose in any lighting."""
    left, top, right, bottom = BODY_VIEW
    r, g, b = np.moveaxis(pixels[top:bottom, left:right], 2, 0)
    return np.asarray((r > 110) & (r - b > 70) & (r > g) & (g > b))


def pixels_of(page: Page) -> NDArray[Any]:
    """The first picture with a body in it. A busy machine opens the recording first, which takes its time."""
    pixels = [picture(page)]

    def is_filled() -> bool:
        pixels.append(picture(page))
        return bool(nose(pixels[-1]).sum() > 30)

    block_until(is_filled, "a body in the 3D view")
    return pixels[-1]


@pytest.fixture(scope="module")
def running(data: Path) -> Iterator[ServerProcess]:
    """A server that has taken the viewer out of its package, which is done once."""
    with ServerProcess(SILENT, data=data) as server:
        assert get(f"{server.url}/rerun/re_viewer.js", timeout=2 * PATIENCE_S).status_code == 200
        yield server


def test_a_recording_opens_in_the_viewer(running: ServerProcess, open_page: Callable[..., Page]) -> None:
    """`open_page` fails if another host is contacted or the console has an error."""
    page = open_page(f"{running.url}/rerun/?recording=drive&theme=light", width=900, height=600)
    chatter: list[str] = []  # of the viewer, a line or more for every frame
    page.on("console", lambda message: chatter.append(message.text) if message.type == "debug" else None)
    until(page, "document.getElementById('words').textContent === ''")
    pixels_of(page)
    page.screenshot(path=str(ARTIFACTS / "rerun-recording.png"), timeout=1000 * PATIENCE_S)
    assert page.evaluate("fetch('https://tile.openstreetmap.org/3/4/2.png').then(answer => answer.status)") == 204
    assert page.locator("#foot").is_hidden(), "all of it is shown: there is nothing to tell"
    assert chatter == []


@pytest.mark.slow  # tests/server/extensions/rerun/test_rrd.py reads the attitude from the viewer's input
def test_the_body_turns(running: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = open_page(f"{running.url}/rerun/?recording=drive&theme=light", width=900, height=600)
    first = pixels_of(page)
    page.goto(f"{running.url}/rerun/?recording=turned&theme=light")
    second = pixels_of(page)
    moved = nose(first) != nose(second)
    assert moved.sum() > 30, "both attitudes look the same"


def test_a_long_recording_reports_the_shown_part(running: ServerProcess, open_page: Callable[..., Page]) -> None:
    """An hour at 1 kHz by the server's count. The map uses the configured tile server. The viewer
    itself is not needed.
    """
    page = open_page(f"{running.url}/rerun/style.css", width=1000, height=600)
    page.route("**/re_viewer_bg.wasm", lambda route: None)

    def amount(route: Route) -> None:
        report = limit_for([3_600_000] * 7, "all=true" in route.request.url)
        route.fulfill(json={**asdict(report), "whole_s": 142.9})

    page.route("**/amount?*", amount)
    page.route("**/api/map", lambda route: route.fulfill(json={"tiles": True, "attribution": "© Someone"}))
    page.route("**/api/tiles/3/4/2", lambda route: route.fulfill(body=b"a picture", content_type="image/png"))
    page.goto(f"{running.url}/rerun/?recording=drive&theme=light")
    until(page, "document.getElementById('amount').textContent !== ''")
    words = page.locator("#amount").inner_text()
    assert words.startswith("Every 180th sample is shown")
    assert "all 25.2 million values are more than a browser holds" in words
    assert "A loop range of up to 2 min opens whole." in words
    assert "all" in str(page.get_by_role("link", name="Show every 7th").get_attribute("href"))
    download = page.get_by_role("link", name="Download all")
    assert str(download.get_attribute("href")).endswith("/api/recordings/drive/recording.rrd?")
    assert str(download.get_attribute("download")).endswith(".rrd")
    got = page.evaluate("fetch('https://tile.openstreetmap.org/3/4/2.png').then(answer => answer.text())")
    assert got == "a picture"
    assert "Map: © Someone" in page.locator("#foot").inner_text()


@pytest.mark.slow  # tests/server/extensions/rerun/test_rerun.py streams to a viewer that only reads
def test_live_data_is_shown_with_its_lag(data: Path, open_page: Callable[..., Page]) -> None:
    with ServerProcess("sim:xbus", data=data) as server:
        page = open_page(f"{server.url}/rerun/?live&theme=dark", width=900, height=600)
        pixels_of(page)
        until(page, "/\\d+ ms behind/.test(document.getElementById('lag').textContent)")
        page.screenshot(path=str(ARTIFACTS / "rerun-live.png"), timeout=1000 * PATIENCE_S)
        page.context.close()


def test_a_missing_recording_is_reported_before_the_viewer_is_there(running: ServerProcess, browser: Browser) -> None:
    page = browser.new_page()
    page.route("**/re_viewer_bg.wasm", lambda route: None)
    page.goto(f"{running.url}/rerun/?recording=none")
    until(page, "document.getElementById('words').textContent.includes('Recording none not found')")
    page.close()
