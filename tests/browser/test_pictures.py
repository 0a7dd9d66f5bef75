"""Pictures of the page in artifacts/: both widths, both themes, and states with hints.

Each is also a test: the state is there, and its words are.
"""

from __future__ import annotations

import os
import pty
import shutil
from collections.abc import Callable

import pytest
from playwright.sync_api import Page

from tests.chromium import until
from tests.conftest import ARTIFACTS, READY
from tests.server_process import ServerProcess

SIZES = {"1440": (1440, 900), "phone": (390, 844)}


def picture(page: Page, name: str) -> None:
    """Keep what the page shows as artifacts/NAME.png."""
    ARTIFACTS.mkdir(exist_ok=True)
    path = ARTIFACTS / f"{name}.png"
    page.screenshot(path=path)
    assert path.stat().st_size > 10_000


@pytest.mark.slow  # for people
@pytest.mark.parametrize("dark", [True, False], ids=["dark", "light"])
@pytest.mark.parametrize("width", SIZES)
def test_live(server: ServerProcess, open_page: Callable[..., Page], width: str, dark: bool) -> None:
    size = SIZES[width]
    page = open_page(server.url, width=size[0], height=size[1], dark=dark, touch=width == "phone")
    until(page, READY)
    page.wait_for_timeout(2500)
    picture(page, f"live-{width}-{'dark' if dark else 'light'}")


@pytest.mark.slow  # for people
def test_paused_with_a_cursor(page: Page) -> None:
    page.wait_for_timeout(2000)
    page.keyboard.press("Space")
    box = page.locator("canvas").nth(3).bounding_box()
    assert box
    page.mouse.move(box["x"] + box["width"] * 0.6, box["y"] + box["height"] / 2)
    page.wait_for_timeout(500)
    picture(page, "paused-1440")


# Root may open everything; without these two it may not.
MERE_MORTAL = ("setpriv", "--bounding-set", "-dac_override,-dac_read_search")


def test_permission_denied(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    """A port that only its group may open: the page names the group, and what to type."""
    prefix = MERE_MORTAL if os.geteuid() == 0 else ()
    if prefix and not shutil.which(prefix[0]):
        pytest.skip("nothing is denied to root, and there is no setpriv to give that up")
    master, slave = pty.openpty()
    try:
        port = os.ttyname(slave)
        if prefix:
            os.chown(port, -1, 20)  # dialout, where there is one
        os.chmod(port, 0o060)
        page = open_page(serve(port, prefix=prefix).url)
        until(page, "window.imuscope?.store.devices.value[0]?.status === 'denied'")
        for width, (wide, high) in SIZES.items():
            page.set_viewport_size({"width": wide, "height": high})
            until(page, "/No permission/.test(document.querySelector('main').innerText)")
            said = page.inner_text("main")
            assert f"No permission to open {port}: it belongs to the group" in said
            assert "sudo usermod -aG" in said
            assert "Try now" in said
            picture(page, f"denied-{width}")
        # Somebody gives access: the next try finds the port.
        os.chmod(port, 0o660)
        page.get_by_role("button", name="Try now").last.click()
        until(page, "window.imuscope.store.devices.value[0].status !== 'denied'")
    finally:
        os.close(master)
        os.close(slave)
