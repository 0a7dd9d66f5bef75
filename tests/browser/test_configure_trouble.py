"""The Configure page while something is not as it should be: a silent device, a server that is gone, stale forms."""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page

from tests.browser.test_configure import ACCELERATION, asked, configured, set_baud
from tests.chromium import until
from tests.server_process import ServerProcess
from tests.timeouts import PATIENCE_S

Serve = Callable[..., ServerProcess]
OpenPage = Callable[..., Page]

STATUS = "window.imuscope?.store.devices.value[0]?.status"
APPLIED = "/written and read back/.test(document.querySelector('.applybar')?.innerText)"


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


def test_a_device_whose_streams_were_stopped_could_not_be_switched_on_again(serve: Serve, open_page: OpenPage) -> None:
    """Silent was taken for unreachable, so that Apply stayed off; and the form still showed the streams as on."""
    server = serve("twin:isb?rate=50")
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


def test_a_device_in_the_config_state_could_not_be_configured(serve: Serve, open_page: OpenPage) -> None:
    server = serve("twin:xbus")
    page = configured(server, open_page)
    run(server, "GoToConfig")
    until(page, f"{STATUS} === 'lost'")
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    page.get_by_role("button", name="Apply", exact=True).click()
    until(page, APPLIED)
    run(server, "GoToMeasurement")  # it stays in the state that it was sent to
    until(page, f"{STATUS} === 'live'")


def test_taking_all_edits_back_left_invalid_text_and_red_marks(serve: Serve, open_page: OpenPage) -> None:
    page = configured(serve("twin:xbus"), open_page, "/LatLonAlt")
    latitude, altitude = page.get_by_label("Latitude"), page.get_by_label("Altitude")
    before = latitude.input_value(), altitude.input_value()
    altitude.fill("77")
    latitude.fill("95")
    until(page, "document.querySelector('[data-field=latitude] [role=alert]') !== null")
    page.get_by_role("button", name="Discard all").click()
    until(page, "document.querySelector('[data-field=latitude] [role=alert]') === null")
    assert (latitude.input_value(), altitude.input_value()) == before
    assert latitude.get_attribute("aria-invalid") != "true"
    until(page, "document.querySelector('.applybar') === null")


def test_a_trial_stood_at_0_s_with_live_buttons_while_the_server_was_gone(serve: Serve, open_page: OpenPage) -> None:
    server = serve("twin:xbus")
    page = configured(server, open_page, "/PortConfig")
    set_baud(page, "921 600 Bd")
    until(page, "document.querySelector('.deck[role=alertdialog]') !== null")
    assert page.get_by_role("button", name="Keep settings").is_enabled()
    server.stop()
    until(page, "window.imuscope.store.connection.value !== 'open'")
    until(page, "document.querySelector('.deck .ring b').innerText === '—'")
    assert "The server is not reached" in page.inner_text("#deck-words")
    for button in ("Keep settings", "Go back now"):
        assert page.get_by_role("button", name=button).is_disabled()


@pytest.mark.parametrize("place", ["OutputConfiguration", "Output%20configuration"])
def test_outputs_that_were_not_read_are_not_shown_as_none(serve: Serve, open_page: OpenPage, place: str) -> None:
    """After a server was killed on trial, the next one had read only what it put back: the budget said 0 B/s."""
    server = serve("twin:xbus")
    body = json.dumps({"settings": ["LocationID"], "reason": ""}).encode()
    address = f"{server.url.rstrip('/')}/api/devices/1/read"
    page = open_page(f"{server.url.rstrip('/')}/#/configure/1/{place}")
    until(page, f"{STATUS} === 'live'")
    urllib.request.urlopen(urllib.request.Request(address, body, {"Content-Type": "application/json"}))
    until(page, "document.querySelector('.unread') !== null")
    values: Any = asked(server, "values")
    assert list(values["values"]) == ["LocationID"]
    page.wait_for_function("document.querySelector('[data-setting=OutputConfiguration]') !== null")
    assert page.locator("[data-setting=OutputConfiguration] .budget").count() == 0
    assert page.locator("[data-setting=OutputConfiguration] table").count() == 0
    page.get_by_role("button", name="Read again").click()
    until(page, "document.querySelector('[data-setting=OutputConfiguration] .budget') !== null")
    assert page.locator(".unread").count() == 0


def test_restoring_communication_was_offered_only_by_the_panel_of_a_trial(serve: Serve, open_page: OpenPage) -> None:
    """After "Later" it was gone until the page was loaded again, and a device that was lost otherwise never had it."""
    page = configured(serve("twin:xbus"), open_page)
    assert page.evaluate(STATUS) == "live"
    page.get_by_role("link", name="Restore communication").click()
    page.get_by_label("Restore communication").get_by_role("button", name="Begin", exact=True).wait_for()


def test_a_data_set_of_a_setting_opened_with_zeros(serve: Serve, open_page: OpenPage) -> None:
    """Sent so, it wrote over everything that the device had kept."""
    server = serve("twin:isb?rate=50")
    page = configured(server, open_page, "/DID_FLASH_CONFIG")
    until(page, "document.querySelector('[data-setting=\"DID_FLASH_CONFIG\"] input') !== null")
    page.evaluate("location.hash = '#/configure/1/SET_DID_FLASH_CONFIG'")
    until(page, "document.querySelector('[data-command=\"SET_DID_FLASH_CONFIG\"] input') !== null")
    held = asked(server, "values")["values"]["DID_FLASH_CONFIG"]
    shown = page.locator('[data-command="SET_DID_FLASH_CONFIG"] input[id$="startupNavDtMs"]')
    assert int(shown.input_value()) == held["startupNavDtMs"] > 0


def test_a_data_set_that_was_not_read_opened_with_zeros(serve: Serve, open_page: OpenPage) -> None:
    """At the address of its form all was 0 ms and 9,600 Bd, as if the device had said so."""
    server = serve("twin:isb?rate=50")
    page = open_page(f"{server.url}#/configure/1/SET_DID_FLASH_CONFIG")
    page.get_by_role("button", name="Read the settings").click()
    period = page.locator('[data-command="SET_DID_FLASH_CONFIG"] input[id$="startupNavDtMs"]')
    period.wait_for()
    assert int(period.input_value()) == asked(server, "values")["values"]["DID_FLASH_CONFIG"]["startupNavDtMs"] > 0
