"""The page of a fleet in a real browser: order, filters, keys, details, and a phone. Robots that join, show their pages
and are lost: test_robot_pages.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import PHONE, click, fits, press, serious, small_targets
from tests.server.extensions.fleet.synthetic_fleet import SyntheticFleet
from tests.support.chromium import until
from tests.support.waiting import block_until

ROWS = "[...document.querySelectorAll('.fleet-row')]"
NAMES = f"{ROWS}.sort((a, b) => a.ariaRowIndex - b.ariaRowIndex).map(row => row.querySelector('a')?.textContent)"
# Places of all rows and cells, and of what stands above them.
PARTS = ".fleet-row, [role=gridcell], [role=columnheader], .fleet-tools *"
BOXES = (
    f"[...document.querySelectorAll({PARTS!r})]"
    """.map(one => {
  const {x, y, width, height} = one.getBoundingClientRect();
  return [x, y, width, height].join();
})"""
)


@pytest.fixture
def fleet(tmp_path: Path) -> Iterator[SyntheticFleet]:
    with SyntheticFleet(150, tmp_path) as running:
        yield running


def go(page: Page, place: str, condition: str = f"{ROWS}.length > 5") -> None:
    page.evaluate("place => { location.hash = place; }", place)
    until(page, condition)


def test_a_fleet(fleet: SyntheticFleet, open_page: Callable[..., Page]) -> None:
    """By keys, by filters, by a link; nothing moves while figures change; and a phone."""
    page = open_page(fleet.url, height=500)  # axe looks at each row that is drawn
    until(page, f"{ROWS}.length > 5")
    assert page.evaluate("location.hash") == "#/fleet"
    lost = {one.name for one in fleet.maker.robots if one.state == "lost"}
    assert set(page.evaluate(NAMES)[: len(lost)]) == lost
    assert page.evaluate(f"{ROWS}.length") < 80
    assert serious(page) == []
    for check in (reach_by_keys, show_on_a_map, filter_and_group, hold_still_while_figures_change, use_a_phone):
        check(page, fleet, lost)


def reach_by_keys(page: Page, *others: object) -> None:
    go(page, "#/fleet?sort=name", f"{NAMES}[0] === 'amr-001'")
    page.get_by_role("grid").focus()
    press(page, "End", "document.querySelector('.fleet-row.active a')?.textContent === 'amr-150'")
    until(page, "document.querySelector('.fleet-row.active').getBoundingClientRect().bottom <= innerHeight")
    page.keyboard.press("Home")
    for _ in range(4):
        page.keyboard.press("ArrowDown")
    press(page, "ArrowRight", "document.querySelectorAll('.fleet-row.of-device').length === 2")  # it has two devices
    press(page, "Enter", "document.querySelector('.fleet-details h2')?.textContent === 'amr-005'")
    until(page, "document.querySelectorAll('.fleet-device').length === 2")
    link = page.get_by_role("link", name="Configure", exact=True).last
    assert link.get_attribute("href") == "/robots/amr-005/#/configure"
    own = page.get_by_role("link", name="Open at its own address")
    assert own.get_attribute("href") == "http://amr-005.example:8080/"
    assert serious(page, "document.querySelector('.fleet-details')") == []
    page.go_back()
    until(page, "document.querySelector('.fleet-details') === null")


def show_on_a_map(page: Page, _: SyntheticFleet, lost: set[str]) -> None:
    go(page, "#/fleet?view=list")
    page.locator(".fleet-summary").get_by_role("button", name="Lost").click()
    click(page, "button", "Map", "document.querySelectorAll('.map-cell').length === 150", exact=True)
    assert page.evaluate("document.querySelectorAll('.map-cell:not(.faint)').length") == len(lost)
    page.get_by_role("listbox").focus()
    for key in ("Home", "ArrowDown", "ArrowRight", "ArrowUp"):
        page.keyboard.press(key)
    until(page, "document.querySelector('.map-line b')?.innerText === 'amr-002'")
    press(page, "Enter", "document.querySelector('.fleet-details h2')?.textContent === 'amr-002'")
    assert page.evaluate("location.hash") == "#/fleet?show=lost&view=map&robot=amr-002"
    assert serious(page, "document.querySelector('main')") == []


def filter_and_group(page: Page, *others: object) -> None:
    go(page, "#/fleet?view=list")
    page.get_by_role("button", name="Losing samples").click()
    page.get_by_label("Group by").select_option("firmware")
    page.get_by_role("columnheader", name="Loss").get_by_role("button").click()
    page.keyboard.press("/")
    page.keyboard.type("amr")
    address = "#/fleet?sort=loss&show=loss&q=amr&by=firmware"
    until(page, f"location.hash === {address!r}")
    listed = page.evaluate(NAMES)
    page.reload()
    until(page, f"{ROWS}.length > 1")
    assert page.evaluate("location.hash") == address
    assert page.evaluate(NAMES) == listed
    assert page.get_by_role("searchbox").input_value() == "amr"


def hold_still_while_figures_change(page: Page, fleet: SyntheticFleet, _: object) -> None:
    go(page, "#/fleet?sort=temperature")
    box = page.get_by_role("grid").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 300, box["y"] + 200)  # the pointer holds the order
    until(page, "document.querySelector('.sort-now').disabled")
    names, boxes = page.evaluate(NAMES), page.evaluate(BOXES)
    shown = page.evaluate(f"{ROWS}.map(row => row.innerText).join()")

    def has_changed() -> bool:
        fleet.change()
        return bool(page.evaluate("!document.querySelector('.sort-now').disabled"))

    block_until(has_changed, "another order")
    assert page.evaluate(f"{ROWS}.map(row => row.innerText).join()") != shown
    assert page.evaluate(NAMES) == names
    assert page.evaluate(BOXES) == boxes
    click(page, "button", "Sort now", f"{NAMES}.join() !== {','.join(names)!r}")


def use_a_phone(page: Page, *others: object) -> None:
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    go(page, "#/fleet?view=list")
    assert serious(page, colours=False) == []
    small = small_targets(page)
    assert not small, "\n".join(small)
    assert fits(page, width=360)
    page.locator(".fleet-row").first.click()
    until(page, "document.querySelector('.fleet-details h2') === document.activeElement")
    assert page.evaluate("document.querySelector('.fleet-details').getBoundingClientRect().top") == 52
    small = small_targets(page)
    assert not small, "\n".join(small)
    click(page, "button", "Close the details", "document.querySelector('.fleet-details') === null")
