"""The analysis dialog in a real browser: a spectrum in two actions, an Allan deviation in two, and on a phone."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, PHONE, TARGETS, opened, serious
from tests.chromium import until
from tests.server_process import ServerProcess

PLACE = "document.querySelector('dialog[open]')"
DIALOG = f"{PLACE}?.innerText"
CURVES = "document.querySelectorAll('dialog[open] path.trace').length"
PICTURES = "document.querySelectorAll('dialog[open] .spectrogram > canvas').length"


def test_a_spectrum_and_an_allan_deviation(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    """And on a phone, where the dialog has room and a finger hits all of it."""
    server = serve("sim:xbus?product=MTi-630&rate=100&seed=1")
    page = opened(server, open_page, DESKTOP)
    page.keyboard.press("a")
    until(page, f"{CURVES} === 3")
    until(page, f"{DIALOG}.includes('at 100 Hz')")
    assert serious(page, PLACE) == []
    box = page.locator(".analysis-chart > svg").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    until(page, "/\\d Hz/.test(document.querySelector('.analysis-reading').innerText)")
    page.get_by_label("Signals or expressions").fill("norm(Acceleration) - 1 g")
    until(page, f"{CURVES} === 1")
    page.keyboard.press("Escape")
    until(page, f"{PLACE} === null")
    page.get_by_role("button", name="Analysis").click()
    page.get_by_role("button", name="Allan deviation").click()
    until(page, f"{CURVES} === 6 && {DIALOG}.includes('Random walk N')")  # accelerometers and gyroscopes
    until(page, f"{DIALOG}.includes('of the MTi-630-8A1G6 data sheet')")
    for verdict in ("met", "above", "open"):  # whichever the noise of these seconds gives
        page.evaluate(f"document.querySelectorAll('.analysis-verdicts li').forEach(li => li.className = '{verdict}')")
        assert serious(page, PLACE) == []
    page.get_by_role("button", name="Spectrogram").click()
    until(page, f"{PICTURES} > 0")
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 100)
    page.get_by_role("button", name="Statistics").click()
    until(page, f"{DIALOG}.includes('Peak to peak')")
    page.context.close()

    page = opened(server, open_page, PHONE)
    page.get_by_role("button", name="Analysis").click()
    until(page, f"{CURVES} === 3")
    assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE[0]
    assert page.evaluate(f"{PLACE}.scrollWidth") <= PHONE[0]
    small = page.evaluate(TARGETS.replace("document.querySelectorAll", f"{PLACE}.querySelectorAll"))
    assert not small, small
