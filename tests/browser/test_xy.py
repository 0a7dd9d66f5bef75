"""The XY plot in a real browser: shown from the workspace, read, put into a recording, and on a phone."""

from __future__ import annotations

import re
from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.test_page import DESKTOP, PHONE, TARGETS, opened, reload, serious
from tests.browser.test_recordings import ask, recorded
from tests.browser.test_recordings import opened as opened_recording
from tests.chromium import until
from tests.server_process import ServerProcess

__all__ = ["recorded"]  # a fixture

SOURCE = "sim:xbus?product=MTi-630&rate=100&seed=1"
PANEL = "document.querySelector('[data-panel=xy]')"
ABOUT = f"{PANEL}?.querySelector('.xy-foot')?.innerText"
READING = f"{PANEL}?.querySelector('.xy-reading')?.innerText"
INK = f"""(() => {{
  const canvas = {PANEL}.querySelector('canvas');
  const {{ data }} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let coloured = 0;
  for (let k = 0; k < data.length; k += 4)
    if (Math.abs(data[k] - data[k + 2]) > 60 && data[k + 3] > 120) coloured += 1;
  return coloured;
}})()"""


def show(page: Page, panel: str) -> None:
    page.keyboard.press("w")
    page.get_by_role("button", name=f"Show {panel}").click()
    page.keyboard.press("Escape")


def test_one_signal_over_another(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    server = serve(SOURCE)
    page = opened(server, open_page, DESKTOP)
    show(page, "XY plot")
    until(page, f"/[1-9].* samples? · same sample times/.test({ABOUT})")
    until(page, f"{INK} > 20")
    page.get_by_label("y", exact=True).select_option(label="Acceleration z")
    page.get_by_label("x", exact=True).select_option(label="Pressure (Pa)")
    until(page, f"/at the times of .* interpolated/.test({ABOUT})")
    page.get_by_role("button", name="Nearest").click()
    until(page, f"/nearest sample/.test({ABOUT})")
    page.keyboard.press(" ")
    page.locator(".xy canvas").focus()
    page.keyboard.press("ArrowLeft")
    until(page, f"/^x .*Pa  y .*m.s²/.test({READING})")
    assert serious(page, PANEL) == []

    # what was chosen comes back with a reload, and can be undone
    reload(page)
    until(page, f"/nearest sample/.test({ABOUT})")
    page.get_by_role("button", name="Trail").click()
    until(page, f"{PANEL}.querySelector('.xy-key').hidden")
    page.keyboard.press("Control+z")
    until(page, f"!{PANEL}.querySelector('.xy-key').hidden")


def test_of_a_recording_the_server_pairs_what_is_beyond_memory(
    recorded: ServerProcess, open_page: Callable[..., Page]
) -> None:
    page = opened_recording(recorded, open_page)
    show(page, "XY plot")
    until(page, f"/[1-9].* samples · same sample times/.test({ABOUT})")
    until(page, f"{INK} > 20")
    shown = int(re.sub(r"\D", "", page.evaluate(ABOUT).split("samples")[0]))
    [info] = ask(recorded, "GET", "/api/recordings")
    view = page.evaluate("imuscope.view.value")
    [x] = ask(
        recorded,
        "POST",
        "/api/analysis/statistics",
        {
            "source": info["id"],
            "signals": [f"{view['device']}/MagneticField.x"],
            "t0": view["end"] - view["span"],
            "t1": view["end"],
        },
    )
    assert shown == x["figures"]["n"]
    # half of it: no longer the same range, and again every sample of it
    page.evaluate("{const {end, span} = imuscope.view.value; imuscope.actions.select(end - span / 2, end);}")
    until(page, f"Math.abs(Number({ABOUT}.split('samples')[0].replace(/\\D/g, '')) - {shown / 2}) < 3")
    assert serious(page, PANEL) == []


def test_on_a_phone(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = opened(serve(SOURCE), open_page, PHONE)
    page.locator(".arrange-phone").tap()
    page.get_by_role("button", name="Show XY plot").tap()
    page.get_by_text("Done", exact=True).tap()
    until(page, f"/same sample times/.test({ABOUT})")
    page.locator(".xy").scroll_into_view_if_needed()
    until(page, f"{INK} > 20")
    assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE[0]
    small = page.evaluate(TARGETS.replace("document.querySelectorAll", f"{PANEL}.querySelectorAll"))
    assert not small, small
