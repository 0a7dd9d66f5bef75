"""The track as a panel in a real browser."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.test_page import DESKTOP, PHONE, TARGETS, opened, reload, serious
from tests.browser.test_xy import show
from tests.chromium import until
from tests.server_process import ServerProcess

SOURCE = "sim:xbus?product=MTi-680G&rate=100&seed=1"
PANEL = "document.querySelector('[data-panel=track]')"
PLACE = f"/\\d+\\.\\d+.*°.*°/.test({PANEL}?.querySelector('.track-summary')?.innerText ?? '')"


def test_the_track_stands_under_the_plots(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = opened(serve(SOURCE), open_page, DESKTOP)
    show(page, "Track")
    until(page, PLACE)
    assert page.evaluate(f"{PANEL}.querySelector('canvas').clientHeight") > 100
    assert serious(page, PANEL) == []
    reload(page)
    until(page, PLACE)


def test_on_a_phone(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = opened(serve(SOURCE), open_page, PHONE)
    page.locator(".arrange-phone").tap()
    page.get_by_role("button", name="Show Track").tap()
    page.get_by_text("Done", exact=True).tap()
    until(page, PLACE)
    assert page.evaluate(f"{PANEL}.querySelector('canvas').clientHeight") > 200
    assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE[0]
    small = page.evaluate(TARGETS.replace("document.querySelectorAll", f"{PANEL}.querySelectorAll"))
    assert not small, small
