"""The calibration coach in a real browser, on a phone beside a simulated sensor that really turns.

Slow, as a hand is. How the coach looks is tested in test_dialogs_story.py, what it says and sends in
web/src/extensions/calibration/dialog.test.tsx, and what is found and written to a device in
tests/server/extensions/calibration/test_calibration_api.py.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest
import yaml
from playwright.sync_api import Page

from imuscope.protocols.simulator.setups import HARD_IRON
from tests.browser.page_checks import PHONE, opened, serious
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

PLACE = "document.querySelector('dialog[open]')"
WORDS = f"{PLACE}?.innerText"
TUMBLING = "sim:xbus?rate=100&seed=1&motion=tumble&hard_iron=0.3&soft_iron=0.1"
HAS_RESULT = "document.querySelector('.calibration-result') !== null"


def coach(page: Page, kind: str) -> None:
    """Open the coach, and start a calibration: three presses."""
    page.locator(".bar .device-name").click()
    page.get_by_role("button", name="Calibrate", exact=True).click()
    page.get_by_role("button", name=kind).click()


@pytest.mark.slow
def test_a_magnetometer_on_a_phone(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = opened(serve(TUMBLING), open_page, PHONE)
    coach(page, "Magnetometer")
    until(page, HAS_RESULT)
    assert "Residual after" in page.evaluate(WORDS)
    assert serious(page, PLACE) == []
    assert page.evaluate(f"{PLACE}.scrollWidth") <= PHONE[0]
    with page.expect_download() as download:
        page.get_by_role("link", name="YAML").click()
    result = yaml.safe_load(download.value.path().read_text())["magnetometer"]
    assert result["bias"]["data"] == pytest.approx(0.3 * HARD_IRON, abs=0.01)


@pytest.mark.slow
def test_six_positions_on_a_phone(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = opened(serve("sim:isb?rate=100&seed=1&motion=positions&acc_bias=0.3"), open_page, PHONE)
    coach(page, "Accelerometer")
    until(page, "document.querySelectorAll('.calibration-positions .is-done').length >= 2")
    assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE[0]
    assert serious(page, PLACE) == []
    until(page, HAS_RESULT)
    assert "Rests used" in page.evaluate(WORDS)
