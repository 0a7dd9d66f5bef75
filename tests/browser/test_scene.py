"""The 3D scene in a real browser: it opens beside the panels, the body turns, and no other host is contacted."""

from __future__ import annotations

import contextlib
import io
import socket
import struct
import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Browser, Page

from imuscope.protocols.rotations import of_euler
from tests import conftest
from tests.browser.page_checks import click
from tests.conftest import ARTIFACTS, READY
from tests.support import chromium
from tests.support.chromium import until
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

# A part of viser that nothing here uses (it sorts Gaussian splats) compiles text, which the policy forbids.
FORBIDDEN = "Evaluating a string as JavaScript violates"
WIDTH, HEIGHT = 640, 420  # without a graphics card each pixel is drawn by the processor that does all else
CONNECTED = "document.body.innerText.includes('Reset heading')"


@pytest.fixture
def open_scene(browser: Browser) -> Iterator[Callable[[str], Page]]:
    """Open an address; any console message other than the expected ones fails the test."""
    complaints: list[str] = []
    context = browser.new_context(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="light")
    context.add_init_script(chromium.SLOW_SCREEN)  # in viser's own page too

    def start(url: str) -> Page:
        page = context.new_page()
        page.set_default_timeout(PATIENCE_S * 1000)
        conftest.watch(page, url, complaints)
        page.goto(url)
        return page

    yield start
    context.close()
    left = [one for one in complaints if FORBIDDEN not in one]
    assert not left, "\n".join(left)


def pixels(page: Page) -> NDArray[np.int16]:
    """The drawn scene, (height, width, 3), without viser's panel."""
    drawn = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), np.int16)
    return drawn[HEIGHT * 2 // 9 :, : WIDTH * 6 // 10]


def lid(picture: NDArray[np.int16]) -> NDArray[np.bool_]:
    """Position of the lit yellow lid, which marks the front of the body; the arrows are darker."""
    red, green, blue = (picture[..., i] for i in range(3))
    return (red > 225) & (green > 205) & (blue < 190)


def centre(observed: NDArray[np.bool_]) -> NDArray[np.float64]:
    assert observed.sum() > 30, "the lid of the body is not on screen"
    return np.argwhere(observed).mean(axis=0)


def quaternions(yaw: float) -> bytes:
    """An Xbus stream of one second at rest, at this yaw: what a device would send."""
    q = of_euler(np.radians([0.0, 0.0, yaw]))
    message = bytes.fromhex("201010") + struct.pack(">4f", *q)
    frame = bytes([0xFF, 0x36, len(message)]) + message
    return (b"\xfa" + frame + bytes([-sum(frame) & 0xFF])) * 100


class PathLine:
    """A device on TCP with a yaw set by the test."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.source = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self.yaw = 0.0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        self._listener.settimeout(0.2)
        while not self._ended.is_set():
            try:
                peer, _ = self._listener.accept()
            except TimeoutError:
                continue
            with peer, contextlib.suppress(OSError):
                while not self._ended.wait(0.02):
                    one = quaternions(self.yaw)
                    peer.sendall(one[: len(one) // 50])

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._listener.close()


@pytest.fixture
def line() -> Iterator[PathLine]:
    held = PathLine()
    yield held
    held.close()


def settled(page: Page) -> NDArray[np.int16]:
    """The scene once two pictures of it, some frames apart, are the same."""
    records = [pixels(page)]

    def is_still() -> bool:
        page.evaluate("async () => { for (let n = 0; n < 4; n++) await new Promise(requestAnimationFrame); }")
        records.append(pixels(page))
        return bool(lid(records[-1]).sum() > 30 and (np.abs(records[-1] - records[-2]).max(axis=2) > 24).mean() < 1e-3)

    block_until(is_still, "a scene at rest")
    return records[-1]


@pytest.mark.slow  # tests/server/extensions/viser/test_viser.py turns a device and reads the scene's messages
def test_the_body_on_screen_turns_with_the_device(
    serve: Callable[..., ServerProcess], line: PathLine, open_scene: Callable[[str], Page]
) -> None:
    """Two attitudes, a quarter turn apart, are two pictures, and the front of the body is seen elsewhere."""
    server = serve(line.source)
    page = open_scene(server.url + "/viser/")
    until(page, CONNECTED)
    first = settled(page)
    keep(page, "scene-0")
    assert (np.abs(settled(page) - first).max(axis=2) > 24).mean() < 1e-3, "at rest it stands still"
    line.yaw = 90.0
    block_until(lambda: np.linalg.norm(centre(lid(pixels(page))) - centre(lid(first))) >= 20, "a body that has turned")
    second = settled(page)
    keep(page, "scene-90")
    assert (np.abs(second - first).max(axis=2) > 24).mean() > 0.002
    # Seen from the south, front to the east and then to the north: it goes to the left and away, which is up.
    assert (centre(lid(second)) < centre(lid(first)) - 10).all()
    line.yaw = 0.0
    block_until(lambda: np.linalg.norm(centre(lid(pixels(page))) - centre(lid(first))) <= 3, "a body that is back")


def test_the_viewer_is_shown_on_request(serve: Callable[..., ServerProcess], open_scene: Callable[[str], Page]) -> None:
    """A workspace panel: web/src/extensions/viser/scene.test.tsx. Viser's page takes ten seconds of a processor."""
    server = serve("sim:xbus?product=MTi-630&rate=20&seed=1")
    page = open_scene(server.url)
    until(page, READY)
    assert page.locator("iframe").count() == 0
    assert not any("viser" in frame.url for frame in page.frames)
    page.get_by_role("button", name="3D scene", exact=True).click()
    inner = page.locator(".viewer iframe").element_handle().content_frame()
    assert inner is not None
    until(inner, CONNECTED)
    click(page, "button", "Full screen", "document.fullscreenElement?.className === 'viewer'")
    page.evaluate("document.exitFullscreen()")
    click(page, "button", "Close the 3D scene", "!document.querySelector('iframe')")


def keep(page: Page, name: str) -> None:
    """Leave a picture among the artifacts, to be looked at."""
    ARTIFACTS.mkdir(exist_ok=True)
    page.screenshot(path=ARTIFACTS / f"{name}.png")
