"""The reference pages in a browser: styled, and readable on a phone. The page's link to them: test_live_story.py."""

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.page_checks import PHONE, SILENT
from tests.support.server_process import ServerProcess

PLAIN = "getComputedStyle(document.body).backgroundColor === 'rgba(0, 0, 0, 0)'"
SIDEWAYS = "document.documentElement.scrollWidth > document.documentElement.clientWidth"


def test_the_reference_fits_a_phone(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    server = serve(SILENT)
    page = open_page(f"{server.url}/docs", width=PHONE[0], height=PHONE[1])
    for name in ("", "/http-api", "/websocket", "/supported-devices"):
        if name:
            page.goto(f"{server.url}/docs{name}")
        assert page.locator("h1").count() == 1
        assert not page.evaluate(PLAIN)
        assert not page.evaluate(SIDEWAYS)
