"""Panels and plots of one's own in a real browser: shown, read, dragged, kept by a reload, undone; and on a phone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, PHONE, drag, fits, opened, reload, serious, show, small_targets
from tests.chromium import until
from tests.server_process import ServerProcess

PANELS = ("XY plot", "Histogram", "Track")
XY, HISTOGRAM, TRACK = (f"document.querySelector('[data-panel={name}]')" for name in ("xy", "histogram", "track"))
ABOUT = f"{XY}?.querySelector('.xy-foot')?.innerText"
READING = f"{XY}?.querySelector('.xy-reading')?.innerText"
INK = f"""(() => {{
  const canvas = {XY}.querySelector('canvas');
  const {{ data }} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let coloured = 0;
  for (let k = 0; k < data.length; k += 4)
    if (Math.abs(data[k] - data[k + 2]) > 60 && data[k + 3] > 120) coloured += 1;
  return coloured;
}})()"""
OUTLINES = f"{HISTOGRAM}?.querySelectorAll('path.bins').length"
FIGURES = f"{HISTOGRAM}?.querySelector('tbody')?.innerText ?? ''"
PLACE = f"/\\d+\\.\\d+.*°.*°/.test({TRACK}?.querySelector('.track-summary')?.innerText ?? '')"
TREE = "document.querySelector('.signals-panel')"
OWN = "[...document.querySelectorAll('.stack .remove-plot')].length"
SHEET = "document.querySelector('.arrange')"
KEYS = "[...document.querySelectorAll('.stack > .plot')].map(one => one.dataset.key).slice(0, 3).join(' ')"
HEIGHT = "Math.round(document.querySelector('.plot[data-key=RateOfTurn]').getBoundingClientRect().height)"
DEFAULT = "Acceleration RateOfTurn MagneticField"


@pytest.fixture(scope="module")
def device(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A device with a receiver, whose track and pressure the panels show."""
    data: Path = tmp_path_factory.mktemp("panels")
    with ServerProcess("sim:xbus?product=MTi-680G&rate=100&seed=1", data=data) as server:
        yield server


def test_panels_on_a_desktop(device: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = opened(device, open_page, DESKTOP)
    show(page, *PANELS)
    until(page, f"/[1-9].* samples? · same sample times/.test({ABOUT})")
    until(page, f"{INK} > 20")
    page.get_by_label("y", exact=True).select_option(label="Acceleration z")
    page.get_by_label("x", exact=True).select_option(label="Pressure (Pa)")
    until(page, f"/at the times of .* interpolated/.test({ABOUT})")
    page.get_by_role("button", name="Nearest").click()
    until(page, f"/nearest sample/.test({ABOUT})")

    histogram = page.locator("[data-panel=histogram]")
    until(page, f"{OUTLINES} === 3")
    page.get_by_label("Quantity", exact=True).select_option(label="Acceleration (m/s²)")
    histogram.get_by_role("button", name="x", exact=True).click()
    histogram.get_by_role("button", name="y", exact=True).click()
    until(page, f"{OUTLINES} === 1 && /9\\.\\d+ ± /.test({FIGURES})")
    page.get_by_label("Bins", exact=True).select_option("50")
    page.get_by_role("combobox", name="Values").select_option("3")
    histogram.get_by_role("button", name="Density", exact=True).click()
    until(page, f"{HISTOGRAM}.innerText.includes('Density, 1/(m/s²)')")

    until(page, PLACE)
    assert page.evaluate(f"{TRACK}.querySelector('canvas').clientHeight") > 100

    page.keyboard.press(" ")
    page.locator(".xy canvas").focus()
    page.keyboard.press("ArrowLeft")
    until(page, f"/^x .*Pa  y .*m.s²/.test({READING})")
    for panel in (XY, HISTOGRAM, TRACK):
        assert serious(page, panel) == []

    # what was chosen comes back with a reload, and can be undone
    reload(page)
    until(page, f"/nearest sample/.test({ABOUT})")
    until(page, f"{OUTLINES} === 1 && {HISTOGRAM}.innerText.includes('Density, 1/(m/s²)')")
    until(page, PLACE)
    page.locator("[data-panel=xy]").get_by_role("button", name="Trail").click()
    until(page, f"{XY}.querySelector('.xy-key').hidden")
    page.keyboard.press("Control+z")
    until(page, f"!{XY}.querySelector('.xy-key').hidden")


def test_panels_on_a_phone(device: ServerProcess, open_page: Callable[..., Page]) -> None:
    """Panels, a plot from the tree of signals, and another order of plots, with a thumb."""
    page = opened(device, open_page, PHONE)
    show(page, *PANELS, phone=True)
    until(page, f"/same sample times/.test({ABOUT})")
    until(page, f"{OUTLINES} === 3")
    until(page, PLACE)
    assert page.evaluate(f"{TRACK}.querySelector('canvas').clientHeight") > 200
    assert fits(page)
    for panel in (XY, HISTOGRAM, TRACK):
        assert small_targets(page, panel) == []
    page.locator(".xy").scroll_into_view_if_needed()
    until(page, f"{INK} > 20")

    page.get_by_role("button", name="All signals…").click()
    page.get_by_role("treeitem", name="Acceleration").first.click()
    page.get_by_role("button", name="New plot", exact=True).click()
    until(page, f"{OWN} === 1")
    assert fits(page)
    assert small_targets(page, TREE) == []
    page.get_by_role("button", name="Close", exact=True).click()
    until(page, f"{TREE} === null")
    page.locator(".stack .remove-plot").first.click()
    until(page, f"{OWN} === 0")

    page.locator(".arrange-phone").tap()
    until(page, f"{SHEET} !== null")
    page.get_by_role("button", name="Move Acceleration down").tap()
    until(page, f"{KEYS} === 'RateOfTurn Acceleration MagneticField'")
    assert fits(page)
    assert small_targets(page, SHEET) == []
    page.get_by_label("Place of Values").select_option("hidden")
    until(page, "document.querySelector('[data-panel=values]') === null")
    page.get_by_label("Maximize Plots").tap()
    until(page, f"document.querySelector('.maximised')?.clientWidth === {PHONE[0]}")
    page.get_by_role("button", name="Restore panel").tap()
    until(page, "document.querySelector('.maximised') === null")


def test_plots_of_ones_own(device: ServerProcess, open_page: Callable[..., Page]) -> None:
    """A signal is plotted in two actions, an expression in three; both are dragged, kept by a reload and removed."""
    page = opened(device, open_page, DESKTOP)
    page.keyboard.press("s")  # 1
    page.get_by_role("button", name="Plot Acceleration on a new plot").click()  # 2
    until(page, f"{OWN} === 1")
    assert serious(page, TREE) == []
    page.get_by_role("treeitem", name="Rate of turn").drag_to(page.locator(".stack .more-quantities"))
    until(page, f"{OWN} === 2")
    page.get_by_role("treeitem", name="Rate of turn").drag_to(page.locator(".stack .plot").first)
    gutter = "document.querySelector('.y-gutter.right')"
    fixed = f"{gutter}?.getAttribute('aria-label') ?? ''"
    zoom = f"{gutter}?.dispatchEvent(new KeyboardEvent('keydown', {{key: '+', bubbles: true, cancelable: true}}))"
    until(page, f"({zoom}, /^y axis of Acceleration, right, fixed from .* °.s$/.test({fixed}))")  # once it is drawn
    assert page.get_by_role("button", name="y axis of Acceleration, automatic").count() > 0  # the left one as before
    page.get_by_role("treeitem", name="Magnetic field").drag_to(page.locator(".stack .plot").first)
    until(page, f"{TREE}.querySelector('[role=status]').innerText.includes('Put it on a new plot')")
    until(page, "location.hash.split('plot=').length === 4")
    reload(page)
    until(page, f"{OWN} === 2 && /right, fixed/.test({fixed})")
    until(page, "[...document.querySelectorAll('.stack .series-value')].at(-1).innerText.trim() !== '—'")

    page.keyboard.press("s")  # 1
    page.get_by_role("button", name="New signal").click()  # 2
    field = page.get_by_role("combobox", name="Expression")
    until(page, "document.activeElement.getAttribute('role') === 'combobox'")
    field.fill("norm(Acceleration) - 1 g")  # 3, with Enter
    until(page, "document.querySelector('.signal-preview path')?.getAttribute('d').length > 50")
    assert serious(page, "document.querySelector('dialog[open]')") == []
    field.press("Enter")
    until(page, f"{OWN} === 3")
    until(page, "/\\d/.test([...document.querySelectorAll('.stack .series-value')].at(-1).innerText)")
    page.get_by_role("treeitem", name="norm(Acceleration)").click()
    page.locator(".signal-targets").get_by_role("button", name="Remove").click()
    until(page, f"{OWN} === 2")


def test_plots_are_moved_and_sized(device: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = opened(device, open_page, DESKTOP)
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
    reload(page)
    until(page, f"{KEYS} === '{DEFAULT}' && {HEIGHT} === {sized + 24}")
    page.keyboard.press("w")
    page.get_by_role("button", name="Automatic height of Rate of turn").click()
    until(page, f"Math.abs({HEIGHT} - {height}) < 4")
    page.get_by_role("button", name="Undo").click()
    until(page, f"{HEIGHT} === {sized + 24}")
    page.get_by_role("button", name="Default layout").click()
    until(page, f"Math.abs({HEIGHT} - {height}) < 4")
