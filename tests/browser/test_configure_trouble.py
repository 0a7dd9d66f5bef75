"""The Configure page under faults: a silent device, a disconnected server, stale forms."""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.test_configure import ACCELERATION, configured
from tests.chromium import until
from tests.server_process import ServerProcess
from tests.timeouts import PATIENCE_S

Serve = Callable[..., ServerProcess]
OpenPage = Callable[..., Page]

STATUS = "window.imuscope?.store.devices.value[0]?.status"
APPLIED = "/written and read back/.test(document.querySelector('.apply-bar')?.innerText)"


def run(server: ServerProcess, command: str, **values: object) -> None:
    """A command, by another program than the page."""
    body = json.dumps({"command": command, "values": values, "confirmed": True}).encode()
    address = f"{server.url.rstrip('/')}/api/devices/1/run"
    wish = urllib.request.Request(address, body, {"Content-Type": "application/json"}, method="POST")
    with urllib.request.urlopen(wish, timeout=PATIENCE_S) as answer:
        assert answer.status == 202


def stop_streams(page: Page) -> None:
    """The button of the page that once made the device unreachable for it."""
    page.evaluate("location.hash = '#/configure/1/STOP_BROADCASTS_CURRENT_PORT'")
    page.get_by_role("button", name="Send", exact=True).click()
    page.get_by_role("dialog").get_by_role("button", name="Stop all streams of this port").click()


def test_stopped_streams_can_be_switched_on_again(serve: Serve, open_page: OpenPage) -> None:
    """Regression: a silent device was treated as unreachable, Apply stayed disabled, and the form
    showed streams as on.
    """
    server = serve("sim:isb?rate=50")
    page = configured(server, open_page, "/streams")
    until(page, "document.querySelector('tr[data-id=\"4\"] input')?.checked === true")
    assert page.get_by_role("link", name="Factory default").count() == 0, "no document tells them"
    stop_streams(page)
    until(page, f"{STATUS} === 'lost'")
    page.evaluate("location.hash = '#/configure/1/streams'")
    until(page, "document.querySelector('tr[data-id=\"4\"] input')?.checked === false")
    page.locator('tr[data-id="4"] input').check()
    page.get_by_role("button", name="Apply", exact=True).click()
    until(page, APPLIED)
    until(page, f"{STATUS} === 'live'")


def test_a_device_in_the_config_state_can_be_configured(serve: Serve, open_page: OpenPage) -> None:
    server = serve("sim:xbus")
    page = configured(server, open_page)
    run(server, "GoToConfig")
    until(page, f"{STATUS} === 'lost'")
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    page.get_by_role("button", name="Apply", exact=True).click()
    until(page, APPLIED)
    run(server, "GoToMeasurement")  # it stays in the state that it was sent to
    until(page, f"{STATUS} === 'live'")
