"""Dialogs of a device on a phone, with answers of the server's own code: colours, targets, and room.

The calibration coach at each of its states, and the shares of a port. What they say and send is tested in
web/src/extensions/calibration/dialog.test.tsx and web/src/extensions/shares/dialog.test.tsx; what the server does, in
tests/server/extensions/calibration/test_calibration_api.py and test_port_shares.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from playwright.sync_api import Page

from imuscope.protocols.simulator.setups import SensorSetup
from imuscope.server.extensions.analysis.signals.triads import Samples
from imuscope.server.extensions.calibration.accelerometer import six_positions
from imuscope.server.extensions.calibration.kinds import METHODS
from imuscope.server.extensions.calibration.magnetometer import magnetometer_iron
from imuscope.server.extensions.calibration.report import CalibrationReport
from imuscope.server.extensions.calibration.routes import AvailableCalibration, CalibrationState
from tests.browser.page_checks import PHONE, click, fits, press, serious, small_targets
from tests.browser.recorded.stories import Story
from tests.support.chromium import until

DIALOG = "document.querySelector('dialog[open]')"
SEEN_HALVES = "document.querySelectorAll('.calibration-halves .seen').length"
START = 1_760_000_000.0
CLIENT = {
    **{"number": 3, "peer": "127.0.0.1:50312", "name": "127.0.0.1:50312", "limited": False, "may_write": True},
    **{"waits": False, "sent": 1500, "received": 12, "refused": 0, "dropped_bytes": 0, "dropped_frames": 0},
}
SHARES: dict[str, Any] = {
    **{"why_not": "", "folder": "/run/imuscope", "holder": 0, "speaker": "", "configuring": False, "changes": []},
    "shares": [{"name": "tcp://127.0.0.1:4001", "kind": "tcp", "read_only": False, "clients": [CLIENT]}],
}


def turned(seconds: float) -> CalibrationReport:
    """Of a magnetometer that was turned for so long."""
    setup = SensorSetup(motion="tumble", hard_iron=0.3, soft_iron=0.1)
    t = np.arange(0, seconds, 0.02)
    return magnetometer_iron(Samples(START + t, 48.0 * setup.field(setup.motion_at(t).field)), "µT", 48.0)


def laid_down(seconds: float) -> CalibrationReport:
    """Of an accelerometer that was laid on its sides one after the other."""
    t = np.arange(0, seconds, 0.02)
    motion = SensorSetup(motion="positions").motion_at(t)
    return six_positions(Samples(START + t, motion.force), Samples(START + t, np.degrees(motion.rate)))


def state(report: CalibrationReport | None, is_running: bool) -> Any:
    kinds = [AvailableCalibration(kind=one.kind, title=one.title, problem="", hint="") for one in METHODS.values()]
    result = CalibrationState(available=kinds, is_running=is_running, report=report, write=None)
    return result.model_dump(mode="json")


def usable(page: Page, *, colours: bool = True) -> None:
    """Nothing serious from axe in the dialog, nothing beside the screen, and a finger hits every control."""
    assert serious(page, DIALOG, colours=colours) == []
    assert page.evaluate(f"{DIALOG}.scrollWidth") <= PHONE[0]
    assert fits(page)
    small = [one for one in small_targets(page, DIALOG) if 'type="checkbox"' not in one]  # its label is the target
    assert not small, "\n".join(small)


def test_dialogs_of_a_device_on_a_phone(open_page: Callable[..., Page]) -> None:
    calibration, now = "/api/devices/1/calibration", [state(None, False)]

    def begin(*_: Any) -> Any:
        now[0] = state(turned(8.0), True)
        return now[0]

    answers = {
        f"GET {calibration}": lambda *_: now[0],
        f"POST {calibration}": begin,
        "GET /api/devices/1/shares": SHARES,
    }
    with Story("xbus", answers=answers) as story:
        for one in next(text for text in story.texts if text["op"] == "devices")["devices"]:
            one |= {"link": "serial", "source": "/dev/ttyUSB0"}
        page = story.open(open_page, width=PHONE[0], height=PHONE[1], touch=True)
        page.locator(".bar .device-name").click()
        click(page, "button", "Calibrate", "document.querySelector('.calibration-kinds') !== null", exact=True)
        usable(page, colours=False)
        click(page, "button", "Magnetometer", f"{SEEN_HALVES} > 3")
        assert page.get_by_role("button", name="Finish now").is_disabled()
        assert "Not yet: Only" in page.evaluate(f"{DIALOG}.innerText")
        assert page.evaluate("document.querySelectorAll('.calibration-halves circle').length") == 1
        usable(page)
        now[0] = state(laid_down(25.5), True)
        until(page, "document.querySelectorAll('.calibration-positions .is-done').length >= 2")
        usable(page, colours=False)
        now[0] = state(turned(60.0), False)
        until(page, "document.querySelector('.calibration-result') !== null")
        assert "Residual after" in page.evaluate(f"{DIALOG}.innerText")
        usable(page)
        press(page, "Escape", f"{DIALOG} === null")

        if page.get_by_role("button", name="Share port").count() == 0:
            page.locator("[aria-controls=rail]:visible").first.click()
        click(page, "button", "Share port", f"{DIALOG}?.innerText.includes('1.5 kB')")
        assert page.get_by_role("button", name=f"Disconnect {CLIENT['peer']}").is_visible()
        click(page, "button", "TCP", f"{DIALOG}.querySelector('input[type=checkbox]') !== null", exact=True)
        usable(page)
