"""Tiles of the middle: the room that plots have, and panels and plots put beside each other with the mouse.

The player's plots are measured in test_recordings.py; keys are tested in web/src/workspace/tile-grip.test.tsx.
"""

from collections.abc import Callable

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, PHONE, drawn, first_five_plots, press, serious
from tests.browser.recorded.stories import Story
from tests.support.chromium import until

#: The second one is a desktop's page at 200 %.
SIZES = {"desktop": DESKTOP, "zoomed": (720, 450), "phone": PHONE}
TILES = """[...document.querySelectorAll('.tile')].map(one => {
  const {x, y, width, height} = one.getBoundingClientRect();
  return [one.dataset.tile, ...[x, y, width, height].map(Math.round)];
})"""
ORDER = f"{TILES}.map(([name]) => name).join(' ')"


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("family", ["xbus", "isb", "idtp"])
def test_plots_have_room(open_page: Callable[..., Page], family: str, size: str) -> None:
    width, height = SIZES[size]
    with Story(family) as story:
        page = story.open(open_page, width=width, height=height, touch=size == "phone")
        plots = first_five_plots(page)
        assert min(bottom - top for top, bottom in plots) >= 96
        assert plots[0][1] <= height, "one whole plot is in the first view"
        if size == "desktop":
            assert sum(bottom - top for top, bottom in plots) >= 520


def test_panels_and_plots_are_put_beside_each_other(open_page: Callable[..., Page]) -> None:
    with Story("xbus") as story:
        page = story.open(open_page)
        first_five_plots(page)
        _, left, top, width, height = page.evaluate(f"{TILES}.at(-1)")
        dropped(page, "[data-grip=health]", left + width - 60, top + height / 2)
        until(page, f"{ORDER} === 'attitude plots health'")
        until(page, "document.querySelector('#plots .stack.narrow') !== null")  # their legends go over them
        health = page.evaluate(f"{TILES}.at(-1)")
        assert abs(health[3] - width / 2) < 3
        assert health[4] == page.evaluate(f"{TILES}[1][4]")
        dropped(page, ".plot[data-key=RateOfTurn] .plot-title", health[1] + health[3] / 2, top + height - 40)
        until(page, f"{ORDER} === 'attitude plots health plots/2'")
        until(page, "document.querySelector('#plots-2 .plot')?.dataset.key === 'RateOfTurn'")
        assert page.evaluate("document.querySelector('#plots .plot[data-key=RateOfTurn]')") is None
        line = page.get_by_role("separator", name="Width of Plots")
        line.focus()
        page.keyboard.press("Shift+ArrowRight")
        until(page, f"Math.abs({TILES}[1][3] - {width / 2 + 50}) < 3")
        assert serious(page, "document.querySelector('.centre')", colours=False) == []
        for _ in range(3):
            page.keyboard.press("Control+z")
        until(page, f"{ORDER} === 'attitude plots'")
        press(page, "Control+Shift+z", f"{ORDER} === 'attitude plots health'")
        dropped(page, "[data-grip=health]", 1300, 300)
        until(page, f"{ORDER} === 'attitude plots'")


def dropped(page: Page, grip: str, x: float, y: float) -> None:
    """Drag by mouse to a place, over which the drop is drawn."""
    for _ in range(4):  # a tile has its size in the frame after it asked for it
        drawn(page)
    page.locator(grip).hover()
    page.mouse.down()
    page.mouse.move(x - 20, y - 20)
    page.mouse.move(x, y, steps=3)
    until(page, "document.querySelector('.drop-zone') !== null")
    page.mouse.up()
    until(page, "document.querySelector('.drop-zone') === null")
