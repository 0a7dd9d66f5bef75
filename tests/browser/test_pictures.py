"""Pictures of the page in artifacts/, for people: both widths, both themes, and paused with a cursor."""

from collections.abc import Callable

import pytest
from playwright.sync_api import Page

from tests.conftest import ARTIFACTS, READY
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

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
