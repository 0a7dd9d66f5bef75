"""The tree of signals in a real browser: plots of one's own, counted in actions; dragging; a phone."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.test_page import DESKTOP, PHONE, TARGETS, opened, reload, serious
from tests.chromium import until
from tests.server_process import ServerProcess

PANEL = "document.querySelector('.signals-panel')"
OWN = "[...document.querySelectorAll('.stack .remove-plot')].length"
SOURCE = "sim:xbus?product=MTi-630&rate=100&seed=1"


def test_a_signal_is_plotted_in_two_actions_dragged_and_kept_by_a_reload(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    page = opened(serve(SOURCE), open_page, DESKTOP)
    page.keyboard.press("s")  # 1
    page.get_by_role("button", name="Plot Acceleration on a new plot").click()  # 2
    until(page, f"{OWN} === 1")
    assert serious(page, PANEL) == []
    page.get_by_role("treeitem", name="Rate of turn").drag_to(page.locator(".stack .more-quantities"))
    until(page, f"{OWN} === 2")
    page.get_by_role("treeitem", name="Rate of turn").drag_to(page.locator(".stack .plot").first)
    gutter = "document.querySelector('.y-gutter.right')"
    fixed = f"{gutter}?.getAttribute('aria-label') ?? ''"
    zoom = f"{gutter}?.dispatchEvent(new KeyboardEvent('keydown', {{key: '+', bubbles: true, cancelable: true}}))"
    until(page, f"({zoom}, /^y axis of Acceleration, right, fixed from .* °.s$/.test({fixed}))")  # once it is drawn
    assert page.get_by_role("button", name="y axis of Acceleration, automatic").count() > 0  # the left one as before
    page.get_by_role("treeitem", name="Magnetic field").drag_to(page.locator(".stack .plot").first)
    until(page, f"{PANEL}.querySelector('[role=status]').innerText.includes('Put it on a new plot')")
    until(page, "location.hash.split('plot=').length === 4")
    reload(page)
    until(page, f"{OWN} === 2 && /right, fixed/.test({fixed})")
    until(page, "[...document.querySelectorAll('.stack .series-value')].at(-1).innerText.trim() !== '—'")


def test_on_a_phone(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = opened(serve(SOURCE), open_page, PHONE)
    page.get_by_role("button", name="All signals…").click()
    page.get_by_role("treeitem", name="Acceleration").first.click()
    page.get_by_role("button", name="New plot", exact=True).click()
    until(page, f"{OWN} === 1")
    assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE[0]
    small = page.evaluate(TARGETS.replace("document.querySelectorAll", f"{PANEL}.querySelectorAll"))
    assert not small, small
    page.get_by_role("button", name="Close", exact=True).click()
    until(page, f"{PANEL} === null")


def test_an_expression_is_plotted_in_three_actions(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    page = opened(serve(SOURCE), open_page, DESKTOP)
    page.keyboard.press("s")  # 1
    page.get_by_role("button", name="New signal").click()  # 2
    field = page.get_by_role("combobox", name="Expression")
    until(page, "document.activeElement.getAttribute('role') === 'combobox'")
    field.fill("norm(Acceleration) - 1 g")  # 3, with Enter
    until(page, "document.querySelector('.signal-preview path')?.getAttribute('d').length > 50")
    assert serious(page, "document.querySelector('dialog[open]')") == []
    field.press("Enter")
    until(page, f"{OWN} === 1")
    until(page, "/\\d/.test([...document.querySelectorAll('.stack .series-value')].at(-1).innerText)")
    page.get_by_role("treeitem", name="norm(Acceleration)").click()
    page.locator(".signal-targets").get_by_role("button", name="Remove").click()
    until(page, f"{OWN} === 0")
