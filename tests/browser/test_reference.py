"""The reference pages in a browser: styled, readable on a phone, and found from the page."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Page

from tests.chromium import until
from tests.conftest import READY
from tests.server_process import ServerProcess

PLAIN = "getComputedStyle(document.body).backgroundColor === 'rgba(0, 0, 0, 0)'"
SIDEWAYS = "document.documentElement.scrollWidth > document.documentElement.clientWidth"


def test_the_reference_is_found_and_fits_a_phone(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = open_page(server.url)
    until(page, READY)
    page.keyboard.press("?")
    link = page.get_by_role("dialog").get_by_role("link", name="API reference")
    assert link.get_attribute("href") == "/docs"
    for name in ("", "/http-api", "/websocket", "/supported-devices"):
        small = open_page(f"{server.url.rstrip('/')}/docs{name}", width=390, height=844)
        assert small.locator("h1").count() == 1
        assert not small.evaluate(PLAIN)
        assert not small.evaluate(SIDEWAYS)
