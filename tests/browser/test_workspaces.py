"""Workspaces in a real browser: panels arranged by mouse, keyboard and finger, maximised, and undone."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Locator, Page

from tests.browser.test_page import DESKTOP, PHONE, TARGETS, opened, serious
from tests.chromium import until
from tests.server_process import ServerProcess

SOURCE = "sim:xbus?product=MTi-630&rate=100&seed=1"
PANELS = "[...document.querySelectorAll('[data-panel]')].map(one => one.dataset.panel).join(' ')"
DEFAULT = "attitude plots values health events"
WIDTH = "Math.round(document.querySelector('.side').getBoundingClientRect().width)"
SHEET = "document.querySelector('.arrange')"


def drag(page: Page, handle: Locator, dx: float, dy: float) -> None:
    box = handle.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=4)
    page.mouse.up()


def test_panels_are_arranged_by_mouse_and_keyboard_and_undone(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    page = opened(serve(SOURCE), open_page, DESKTOP)
    assert page.evaluate(PANELS) == DEFAULT
    assert page.locator("[role=separator]").count() == 0
    width = page.evaluate(WIDTH)
    page.keyboard.press("w")
    until(page, f"{SHEET} !== null")
    assert serious(page, SHEET) == []
    page.get_by_label("Place of Events").select_option("main")
    until(page, f"{PANELS} === 'attitude plots events values health'")
    drag(page, page.get_by_role("separator", name="Width of the side column"), -120, 0)
    until(page, f"Math.abs({WIDTH} - {width + 120}) < 3")
    row = page.locator("[data-row=health] .grip")
    to, at = page.locator("[data-row=values]").bounding_box(), row.bounding_box()
    assert to is not None
    assert at is not None
    drag(page, row, 0, to["y"] - at["y"] - 5)
    until(page, f"{PANELS} === 'attitude plots events health values'")
    page.keyboard.press("Escape")
    until(page, f"{SHEET} === null")
    page.locator("[data-panel=values] h2").dblclick()
    until(page, f"document.querySelector('.maximised')?.clientWidth === {DESKTOP[0]}")
    assert serious(page, "document.querySelector('.maximised')", colours=False) == []
    page.keyboard.press("Escape")
    until(page, "document.querySelector('.maximised') === null")
    for _ in range(8):  # more than there were
        page.keyboard.press("Control+z")
    until(page, f"{PANELS} === '{DEFAULT}' && {WIDTH} === {width}")
    page.keyboard.press("Control+Shift+z")
    until(page, f"{PANELS} === 'attitude plots events values health'")


def test_panels_are_arranged_with_a_thumb(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = opened(serve(SOURCE), open_page, PHONE)
    page.locator(".arrange-phone").tap()
    until(page, f"{SHEET} !== null")
    assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE[0]
    small = page.evaluate(TARGETS.replace("document.querySelectorAll", f"{SHEET}.querySelectorAll"))
    assert not small, small
    page.get_by_label("Place of Values").select_option("hidden")
    until(page, f"{PANELS} === 'attitude plots health events'")
    page.get_by_label("Maximize Plots").tap()
    until(page, f"document.querySelector('.maximised')?.clientWidth === {PHONE[0]}")
    page.get_by_role("button", name="Restore panel").tap()
    until(page, "document.querySelector('.maximised') === null")
