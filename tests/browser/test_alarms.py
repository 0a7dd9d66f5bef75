"""Alarms in a real browser, from recorded answers: the colours of the list and of the form, and the form on a phone.

What the form sends, marks and deletes, and what the list says, is tested without a browser, in
web/src/extensions/alarms/dialog.test.tsx and panel.test.tsx; that a condition raises an alarm, in
tests/server/extensions/alarms/test_alarms.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from playwright.sync_api import Page

from tests.browser.page_checks import PHONE, fits, serious, small_targets
from tests.browser.recorded.stories import Story
from tests.support.chromium import until

PLACE = "document.querySelector('dialog[open]')"
LIST = "(document.querySelector('.alarm-list')?.innerText ?? '')"
ROW = "document.querySelector('.device-list').innerText"
CONDITION = "norm(Speed) > 0.5 g"
MISTAKE = {"valid": False, "message": "There is no signal Speed. (character 6)", "hint": "Did you mean Acceleration?"}


def alarm(name: str, **state: Any) -> dict[str, Any]:
    usual = {
        **{"device": "1", "status": "raised", "raised": True, "since": 1.76e9, "value": 9.81, "raised_value": 31.4},
        **{"worst": 33.0, "limit": 29.4, "subject": "norm(Acceleration)", "unit": "m/s²", "count": 1, "intervals": []},
        **{"acknowledged_by": "", "acknowledged": None, "problem": "", "signals": ["Acceleration.x"]},
    }
    condition = {"kind": "expression", "expression": "norm(Acceleration) > 3 g", "clear": ""}
    definition = {"name": name, "condition": condition, "level": "warning"}
    return {"id": name, "definition": definition, "states": [usual | state]}


def test_the_list_and_the_form(open_page: Callable[..., Page]) -> None:
    """Nothing serious from axe; on a phone the form has room, and a finger hits all of it."""
    observed = alarm("Seen", status="acknowledged", acknowledged=1.76e9, acknowledged_by="Ada")
    answers = {
        "GET /api/alarms": [alarm("Hard"), observed],
        "POST /api/alarms/check": {**MISTAKE, "begin": 5, "end": 10, "devices": [], "notes": []},
    }
    with Story("xbus", answers=answers) as story:
        page = story.open(open_page)
        until(page, f"{LIST}.includes('Raised') && {LIST}.includes('by Ada')")
        until(page, f"{ROW}.includes('1 alarm raised') && {ROW}.includes('1 acknowledged')")
        page.get_by_role("button", name="Acknowledge Hard").click()
        page.get_by_label("Your name").fill("Ada")
        assert serious(page, "document.querySelector('.side')") == []
        page.keyboard.press("Escape")
        page.get_by_role("button", name="Add alarm").click()
        page.get_by_label("Condition", exact=True).fill(CONDITION)
        until(page, f"{PLACE}.querySelector('mark')?.textContent === 'Speed'")
        assert page.get_by_role("button", name="Save", exact=True).is_disabled()
        assert serious(page, PLACE) == []

        page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
        for kind in ("Flag", "Link figure", "Signals"):
            page.get_by_role("button", name=kind, exact=True).click()
            assert fits(page, place=PLACE)
            assert small_targets(page, PLACE) == []
