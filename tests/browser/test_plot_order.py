"""The order and the heights of plots in a real browser: dragged, set in the list of the workspace, undone and kept."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.test_page import DESKTOP, PHONE, TARGETS, opened, reload, serious
from tests.browser.test_workspaces import SHEET, SOURCE, drag
from tests.chromium import until
from tests.server_process import ServerProcess

KEYS = "[...document.querySelectorAll('.stack > .plot')].map(one => one.dataset.key).slice(0, 3).join(' ')"
HEIGHT = "Math.round(document.querySelector('.plot[data-key=RateOfTurn]').getBoundingClientRect().height)"
DEFAULT = "Acceleration RateOfTurn MagneticField"


def test_plots_are_moved_and_sized(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = opened(serve(SOURCE), open_page, DESKTOP)
    assert page.evaluate(KEYS) == DEFAULT
    height = page.evaluate(HEIGHT)
    title = page.locator(".plot[data-key=RateOfTurn] .plot-title")
    drag(page, title, 0, -height)
    until(page, f"{KEYS} === 'RateOfTurn Acceleration MagneticField'")
    drag(page, page.locator(".plot[data-key=RateOfTurn] .plot-edge"), 0, 60)
    until(page, f"Math.abs({HEIGHT} - {height + 60}) < 4")
    page.evaluate("document.querySelector('.plot[data-key=RateOfTurn] canvas').focus()")
    sized = page.evaluate(HEIGHT)

    # the list of the workspace has the same for the keyboard
    page.keyboard.press("w")
    until(page, f"{SHEET} !== null")
    page.get_by_role("button", name="Move Rate of turn down").press("Enter")
    until(page, f"{KEYS} === '{DEFAULT}'")
    page.get_by_role("button", name="Make Rate of turn taller").press("Enter")
    until(page, f"{HEIGHT} === {sized + 24}")
    assert serious(page, SHEET) == []
    reload(page)
    until(page, f"{KEYS} === '{DEFAULT}' && {HEIGHT} === {sized + 24}")
    page.keyboard.press("w")
    page.get_by_role("button", name="Automatic height of Rate of turn").click()
    until(page, f"Math.abs({HEIGHT} - {height}) < 4")
    page.get_by_role("button", name="Undo").click()
    until(page, f"{HEIGHT} === {sized + 24}")
    page.get_by_role("button", name="Default layout").click()
    until(page, f"Math.abs({HEIGHT} - {height}) < 4")


def test_plots_are_moved_with_a_thumb(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = opened(serve(SOURCE), open_page, PHONE)
    page.locator(".arrange-phone").tap()
    until(page, f"{SHEET} !== null")
    page.get_by_role("button", name="Move Acceleration down").tap()
    until(page, f"{KEYS} === 'RateOfTurn Acceleration MagneticField'")
    assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE[0]
    small = page.evaluate(TARGETS.replace("document.querySelectorAll", f"{SHEET}.querySelectorAll"))
    assert not small, small
