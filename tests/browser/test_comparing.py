"""Comparing in a real browser: a recording with itself, computed by a real server; the page's colours, and a phone.

Two live devices, moving B, and what is asked of the server are tested without a browser, in
web/src/extensions/analysis/compare/page.test.tsx.
"""

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.page_checks import PHONE, click, fits, serious, small_targets
from tests.browser.test_recordings import opened, recorded
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

__all__ = ["recorded"]  # a fixture

MAIN = "document.querySelector('main')"
TEXT = f"({MAIN}?.innerText ?? '')"
PAIRS = "document.querySelectorAll('.overlay-chart .side-a path[d^=M]').length"
SECOND = "document.querySelectorAll('.overlay-chart .side-b path[d^=M]').length"
DIFFERENCES = "document.querySelectorAll('.overlay-chart .difference path[d^=M]').length"
LABELS = "[...document.querySelector('.overlay-chart .grid').querySelectorAll('text[y]')].map(one => one.textContent)"


def test_a_recording_and_its_range(recorded: ServerProcess, open_page: Callable[..., Page]) -> None:
    """From a recording one click; against itself, the alignment is exact and states its uncertainty. A link restores
    what was compared.
    """
    page = opened(recorded, open_page)
    click(page, "button", "Compare", f"{PAIRS} === 3 && {SECOND} === 3 && {DIFFERENCES} === 3", exact=True)
    page.get_by_label("B: recording or device").select_option("yard")
    until(page, f"{TEXT}.includes('0 … 0 m/s²')")
    click(page, "button", "Align by cross-correlation", f"/0 s ± [0-9.·⁻¹²³⁴⁵⁶⁷⁸⁹−]+ s/.test({TEXT})")
    assert serious(page, MAIN) == []

    whole = page.evaluate(LABELS)
    chart = page.locator(".overlay-chart").first
    chart.hover()
    page.mouse.wheel(0, -600)
    until(page, f"{LABELS}.join() !== {','.join(whole)!r}")  # another part of the time
    chart.dblclick()
    until(page, f"{LABELS}.join() === {','.join(whole)!r}")
    chart.press("+")
    until(page, f"{LABELS}.join() !== {','.join(whole)!r}")
    assert page.locator(".overlay-chart").nth(1).locator(".grid text[x]").count() >= 4  # the difference
    page.get_by_text("Spectra of both").click()
    until(page, "document.querySelectorAll('path.interval').length >= 6")

    chart.press("Shift+ArrowRight")
    until(page, "/offset=0\\.[0-9]*[1-9]/.test(location.hash)")
    moved = page.evaluate("location.hash")
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    page.reload()
    until(page, f"{PAIRS} === 3 && location.hash === {moved!r}")
    assert fits(page)
    until(page, "document.querySelector('.overlay-chart').getBoundingClientRect().top < innerHeight / 2")
    page.locator(".compare-fold").click()
    assert fits(page, place=MAIN)
    assert small_targets(page, MAIN) == []
