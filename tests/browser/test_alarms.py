"""Alarms in a real browser: added in a form that marks mistakes, seen on the device, acknowledged by name."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, PHONE, TARGETS, opened, serious
from tests.chromium import until
from tests.server_process import ServerProcess

PLACE = "document.querySelector('dialog[open]')"
LIST = "(document.querySelector('.alarm-list')?.innerText ?? '')"
ROW = "document.querySelector('.device-list').innerText"
SIMULATOR = "sim:xbus?product=MTi-630&rate=100&seed=1"


def test_an_alarm_is_added_raised_and_acknowledged(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    """On a phone its form has room, and a finger hits all of it."""
    server = serve(SIMULATOR)
    page = opened(server, open_page, PHONE)
    page.evaluate("document.querySelector('.alarm-add').click()")
    until(page, f"{PLACE} !== null")
    for kind in ("Flag", "Link figure", "Signals"):
        page.get_by_role("button", name=kind, exact=True).click()
        assert page.evaluate(f"{PLACE}.scrollWidth") <= PHONE[0]
        small = page.evaluate(TARGETS.replace("document.querySelectorAll", f"{PLACE}.querySelectorAll"))
        assert not small, small
    page.context.close()

    page = opened(server, open_page, DESKTOP)
    page.get_by_role("button", name="Add alarm").click()
    page.get_by_label("Condition", exact=True).fill("norm(Speed) > 0.5 g")
    until(page, f"{PLACE}.querySelector('mark')?.textContent === 'Speed'")
    assert page.get_by_role("button", name="Save", exact=True).is_disabled()
    assert serious(page, PLACE) == []
    page.get_by_label("Condition", exact=True).fill("norm(Acceleration) > 0.5 g")
    until(page, f"{PLACE}.querySelector('mark') === null")
    page.get_by_label("Name", exact=True).fill("Under gravity")
    page.get_by_role("button", name="Save", exact=True).click()
    until(page, f"{PLACE} === null")
    until(page, f"{LIST}.includes('Raised') && {LIST}.includes('Under gravity')")
    until(page, f"{ROW}.includes('1 alarm raised')")
    page.get_by_role("button", name="Acknowledge Under gravity").click()
    page.get_by_label("Your name").fill("Ada")
    page.keyboard.press("Enter")
    until(page, f"{LIST}.includes('Acknowledged') && {LIST}.includes('by Ada')")
    until(page, f"{ROW}.includes('1 acknowledged')")
    assert serious(page, "document.querySelector('.side')") == []
    page.reload()
    until(page, f"{LIST}.includes('by Ada')")
    page.get_by_role("button", name="Edit Under gravity").click()
    page.get_by_role("button", name="Delete", exact=True).click()
    page.get_by_role("button", name="Delete this alarm?").click()
    until(page, f"{PLACE} === null && {LIST} === ''")
