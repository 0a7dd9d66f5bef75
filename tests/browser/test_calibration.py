"""The calibration coach in a real browser, on a phone beside a simulated sensor that really turns."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import yaml
from playwright.sync_api import Page

from protocols.simulator.setups import GYRO_BIAS, HARD_IRON, SensorSetup
from tests.browser.page_checks import DESKTOP, PHONE, TARGETS, opened, serious
from tests.chromium import until
from tests.server_process import ServerProcess

PLACE = "document.querySelector('dialog[open]')"
WORDS = f"{PLACE}?.innerText"
SEEN = "document.querySelectorAll('.calibration-halves .seen').length"
TUMBLING = "sim:xbus?rate=100&seed=1&motion=tumble&hard_iron=0.3&soft_iron=0.1"
FOUND = "document.querySelector('.calibration-result') !== null"


def coach(page: Page, kind: str, *, phone: bool) -> None:
    """Open the coach, and start a calibration: three presses on a phone, two on a desktop."""
    if phone:
        page.locator(".bar .device-name").click()
    page.get_by_role("button", name="Calibrate", exact=True).click()
    page.get_by_role("button", name=kind).click()


def test_a_magnetometer_is_begun_on_a_phone(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    page = opened(serve(TUMBLING), open_page, PHONE)
    coach(page, "Magnetometer", phone=True)
    until(page, f"{SEEN} > 3")
    assert page.get_by_role("button", name="Finish now").is_disabled()
    assert "Not yet: Only" in page.evaluate(WORDS)
    assert page.evaluate("document.querySelectorAll('.calibration-halves circle').length") == 1
    assert serious(page, PLACE) == []
    assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE[0]
    small = page.evaluate(TARGETS.replace("document.querySelectorAll", f"{PLACE}.querySelectorAll"))
    assert not small, small
    seen = page.evaluate(SEEN)
    page.reload()  # it goes on, and another page sees the same
    page.locator(".bar .device-name").click()
    page.get_by_role("button", name="Calibrate", exact=True).click()
    until(page, f"{SEEN} >= {seen}")


@pytest.mark.slow
def test_a_magnetometer_on_a_phone(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = opened(serve(TUMBLING), open_page, PHONE)
    coach(page, "Magnetometer", phone=True)
    until(page, FOUND)
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
    coach(page, "Accelerometer", phone=True)
    until(page, "document.querySelectorAll('.calibration-positions .is-done').length >= 2")
    assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE[0]
    assert serious(page, PLACE) == []
    until(page, FOUND)
    assert "Rests used" in page.evaluate(WORDS)


SELECT = "id => { window.imuscope.view.value = {...window.imuscope.view.value, device: id}; }"


def test_at_rest_turned_and_mounted_on_a_desktop(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    """A bias is found at rest, a turn about one axis gives no result, and a mounting rotation goes to the device."""
    rest = "sim:xbus?rate=100&seed=1&motion=rest&gyro_bias=0.5"
    turn = "sim:isb?rate=100&seed=1&motion=turn"
    drive = "sim:xbus?rate=100&seed=1&motion=straight&mount=30"
    page = opened(serve(rest, turn, drive), open_page, DESKTOP)
    page.evaluate(SELECT, "1")
    coach(page, "Gyroscope bias", phone=False)
    until(page, f"{WORDS}.includes('At rest')")
    until(page, f"!{PLACE}.querySelector('.btn.main').disabled")
    page.get_by_role("button", name="Finish now").click()
    until(page, FOUND)
    rows = page.locator(".calibration-numbers tr").all_inner_texts()
    bias = [float(row.split()[1].replace("−", "-")) for row in rows]
    assert bias == pytest.approx(0.5 * np.array(GYRO_BIAS), abs=0.05)
    page.keyboard.press("Escape")
    until(page, f"{PLACE} === null")

    page.evaluate(SELECT, "2")
    coach(page, "Magnetometer", phone=False)
    until(page, f"{WORDS}.includes('empty fields around')")
    until(page, f"{SEEN} >= 9")
    assert page.get_by_role("button", name="Finish now").is_disabled()
    page.get_by_role("button", name="Stop").click()
    until(page, "document.querySelector('.calibration-kinds') !== null")
    page.keyboard.press("Escape")
    until(page, f"{PLACE} === null")

    page.evaluate(SELECT, "3")
    coach(page, "Mounting rotation", phone=False)
    until(page, FOUND)
    write = page.locator(".calibration-write")
    write.get_by_role("button", name="Read the settings").click()
    until(
        page, f"[...{PLACE}.querySelectorAll('.calibration-write button')].some(b => /^(Write|Cont)/.test(b.innerText))"
    )
    if write.get_by_role("button", name="Continue").count():
        write.get_by_role("button", name="Continue").click()
    write.get_by_role("button", name="Write to the device").click()
    write.get_by_role("button", name="Continue").click()  # every consumer of the data must be adapted
    until(page, f"{PLACE}.querySelector('.calibration-write')?.innerText.includes('snapshots in Configure')")
    values = page.evaluate("fetch('/api/devices/3/values').then(answer => answer.json())")["values"]
    stored = values["AlignmentRotation.RotSensor"]
    wanted = SensorSetup(mount=30).q_vehicle_from_sensor
    assert [stored[name] for name in ("q0", "q1", "q2", "q3")] == pytest.approx(wanted, abs=0.02)
