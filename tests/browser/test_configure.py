"""The Configure page with real servers and simulators: workflows, and guarantees for the user.

Rates are changed and seen in the plot; a rate that cuts the line comes back by itself, also when nobody is there any
more; profiles are compared and applied; every command and setting of every family opens as a form without an error.
"""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page

from tests.browser.test_page import WATCH, after
from tests.browser.test_pictures import SIZES, picture
from tests.chromium import until
from tests.server_process import ServerProcess
from tests.timeouts import PATIENCE_S
from tests.waiting import block_until

Serve = Callable[..., ServerProcess]
OpenPage = Callable[..., Page]

SAMPLES = "window.imuscope?.store.channels.value.some(channel => channel.ring.length > 20)"
RATE = """name => {
  const ring = window.imuscope.store.channels.value.find(channel => channel.info.name === name)?.ring;
  const last = ring ? ring.length - 1 : 0, first = Math.max(0, last - 40);
  return ring && last > 40 ? (last - first) / (ring.time(last) - ring.time(first)) : 0;
}"""
"""Samples per second of a quantity, over its newest forty."""
ACCELERATION = 'tr[data-id="0x4020"]'


def asked(server: ServerProcess, path: str, device: str = "1") -> Any:
    """Answer of the server to a GET."""
    with urllib.request.urlopen(f"{server.url.rstrip('/')}/api/devices/{device}/{path}", timeout=PATIENCE_S) as answer:
        return json.load(answer)


def configured(server: ServerProcess, open_page: OpenPage, place: str = "", **options: Any) -> Page:
    """The Configure page of the first device, with its settings read."""
    page = open_page(f"{server.url.rstrip('/')}/#/configure/1{place}", **options)
    until(page, "document.querySelector('.settings-form h1') !== null")
    if page.get_by_role("button", name="Read settings").count():
        page.get_by_role("button", name="Read settings").click()
    until(page, "document.querySelector('[data-setting], [data-command], .compare') !== null")
    return page


def test_a_rate_is_changed_in_five_actions_the_plot_follows_and_a_profile_goes_back(
    serve: Serve, open_page: OpenPage
) -> None:
    server = serve("sim:xbus")
    page = open_page(server.url)
    until(page, SAMPLES)
    until(page, f"Math.abs(({RATE})('Acceleration') - 100) < 10")
    page.get_by_role("link", name="Configure").click()  # 1
    page.get_by_role("button", name="Read settings").click()  # 2
    page.locator(f"{ACCELERATION} select").first.select_option("50")  # 3
    until(page, "document.querySelector('.previous')?.innerText === 'was 100 Hz'")
    page.get_by_role("button", name="Apply", exact=True).click()  # 4
    until(page, "/1 of 1 settings written and read back/.test(document.querySelector('.apply-bar')?.innerText)")
    page.get_by_role("link", name="Live", exact=True).click()  # 5
    until(page, f"Math.abs(({RATE})('Acceleration') - 50) < 5")
    until(page, "document.querySelector('.plots canvas') !== null")

    page.get_by_role("link", name="Configure").click()
    page.get_by_role("navigation", name="Snapshots").get_by_role("link", name="First contact").click()
    until(page, "document.querySelectorAll('.difference-table tbody tr').length === 1")
    row = page.locator(".difference-table tbody tr")
    assert "50 Hz" in row.locator("td").first.inner_text()
    assert "100 Hz" in row.locator("td").last.inner_text()
    picture(page, "compare-1440")
    page.get_by_role("button", name="Apply this profile").click()
    until(page, "document.querySelector('.compare')?.innerText.includes('No difference')")
    entries = asked(server, "values")["values"]["OutputConfiguration"]["outputs"]
    assert {"data_identifier": 0x4020, "output_frequency": 100} in entries


def test_a_refused_write_is_reported_per_field(serve: Serve, open_page: OpenPage) -> None:
    """If power fails while a rate is stored, the device keeps the old rate, and the page must show it."""
    page = configured(serve("sim:xbus?cut=1"), open_page)
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    page.get_by_role("button", name="Apply", exact=True).click()
    until(page, "document.querySelector('.outcomes li') !== null")
    assert "Output configuration" in page.inner_text(".outcomes")
    picture(page, "rejected-1440")
    page.get_by_role("button", name="Edit again").click()
    until(page, "document.querySelector('.apply-bar')?.innerText.includes('1 change')")


def set_baud(page: Page, words: str) -> None:
    """Ask for another rate of the first port, to be confirmed."""
    page.locator("[data-field=words] select").first.select_option(label=words)
    page.get_by_role("button", name="Apply", exact=True).click()
    dialog = page.get_by_role("dialog")
    until(page, "document.activeElement.innerText === 'Leave unchanged'")
    dialog.get_by_role("button", name="Write, then confirm").click()


# Late previews, as from a busy server: a quick user applies before they arrive.
LATE_PREVIEWS = """() => {
  const fetch = window.fetch;
  window.fetch = async (place, ...more) => {
    if (String(place.url ?? place).endsWith("/preview")) await new Promise(done => setTimeout(done, 1500));
    return fetch(place, ...more);
  };
}"""


def test_a_confirmed_rate_stays_and_another_is_rolled_back_even_without_the_browser(
    serve: Serve, open_page: OpenPage, tmp_path: Path
) -> None:
    """Regression: the confirmation did not mention that the change is temporary, and its button read "Write"."""
    config = tmp_path / "imuscope.toml"
    config.write_text("rollback_s = 10\n")
    server = serve("sim:xbus", arguments=("--config", str(config)))
    page = configured(server, open_page, "/PortConfig")
    page.evaluate(LATE_PREVIEWS)
    set_baud(page, "921 600 Bd")
    until(page, "document.querySelector('.pending-rollback[role=alertdialog]') !== null")
    page.get_by_role("button", name="Confirm").click()
    until(page, "document.querySelector('.pending-rollback h3')?.innerText.endsWith('Confirmed')")
    until(page, "window.imuscope.store.devices.value[0].baud === 921600")
    until(page, "/written and read back/.test(document.querySelector('.apply-bar')?.innerText)")

    page.goto(f"{server.url}/#/configure/1/PortConfig")
    page.reload()
    set_baud(page, "115 200 Bd")
    until(page, "document.querySelector('.pending-rollback[role=alertdialog]') !== null")
    until(page, "document.activeElement.innerText === 'Roll back now'")
    picture(page, "rollback-1440")
    assert asked(server, "jobs")["pending_rollback"]["state"] == "pending"
    page.context.close()
    block_until(
        lambda: asked(server, "jobs")["pending_rollback"]["state"] == "rolled-back", "the old settings are back"
    )
    other = open_page(server.url)
    until(other, "window.imuscope?.store.jobs.value.get('1')?.pending_rollback?.state === 'rolled-back'")
    until(other, "window.imuscope.store.devices.value[0].baud === 921600")
    until(other, "document.querySelector('.pending-rollback')?.innerText.includes('previous settings')")


@pytest.mark.slow  # for people
@pytest.mark.parametrize("width", SIZES)
def test_a_change_in_both_themes(server: ServerProcess, open_page: OpenPage, width: str) -> None:
    size = SIZES[width]
    page = configured(server, open_page, width=size[0], height=size[1], touch=width == "phone")
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    until(page, "document.querySelector('.hex-part.changed') !== null")
    for theme in ("light", "dark"):
        page.emulate_media(color_scheme=theme)  # type: ignore[arg-type]
        until(page, f"document.documentElement.dataset.theme === {theme!r}")
        picture(page, f"configure-{width}-{theme}")


def chord(page: Page, *keys: str) -> None:
    """Keys a tenth of a second after each other, however long a busy page takes for each."""
    devtools, at = page.context.new_cdp_session(page), page.evaluate("Date.now() / 1000")
    for key in keys:
        at += 0.1
        told = {"key": key, "code": f"Key{key.upper()}", "timestamp": at}
        devtools.send("Input.dispatchKeyEvent", {"type": "keyDown", "text": key, **told})
        devtools.send("Input.dispatchKeyEvent", {"type": "keyUp", **told})
    devtools.detach()


def test_viewers_see_everything_and_change_nothing(serve: Serve, open_page: OpenPage, tmp_path: Path) -> None:
    config = tmp_path / "imuscope.toml"
    config.write_text('view_token = "only-looking"\ncontrol_token = "may-command"\n')
    server = serve("sim:xbus", arguments=("--config", str(config)))
    page = configured(server, open_page)
    until(page, "document.querySelector('.budget-bar') !== null")
    page.goto(f"{server.url.rstrip('/')}/?token=only-looking#/configure/1")
    until(page, "document.querySelector('.band')?.innerText.includes('View only')")
    until(page, "document.querySelectorAll('.hex-part').length > 5")  # bytes and load are for looking
    until(page, "document.querySelector('.budget-bar') !== null")
    assert page.get_by_role("button", name="Read again").is_disabled()
    assert page.get_by_role("button", name="Send hex").is_disabled()
    picture(page, "view-only-1440")
    page.evaluate("location.hash = '#/configure/1/compare/~factory'")
    until(page, "document.querySelectorAll('.difference-table tbody tr').length > 0")
    assert page.get_by_role("button", name="Apply this profile").is_disabled()


def test_a_profile_goes_to_two_devices_each_with_its_own_differences(serve: Serve, open_page: OpenPage) -> None:
    """Regression: the differences of the selected device were written to all devices, and only its
    result was reported.
    """
    server = serve("sim:xbus?seed=1", "sim:xbus?seed=2", "sim:xbus?product=MTi-680G&seed=3")
    page = configured(server, open_page)
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    page.get_by_role("button", name="Apply", exact=True).click()
    until(page, "/written and read back/.test(document.querySelector('.apply-bar')?.innerText)")
    page.goto(f"{server.url.rstrip('/')}/#/configure/1/compare/~factory")
    until(page, "document.querySelectorAll('.rollout tbody tr').length === 3")
    for device in ("2", "3"):
        page.locator(f'.rollout tr[data-device="{device}"]').get_by_role("button", name="Read").click()
        until(page, f"document.querySelector('.rollout tr[data-device=\"{device}\"] button') === null")
    page.get_by_role("navigation", name="Snapshots").get_by_role("link", name="First contact").click()
    until(page, "document.querySelector('.rollout tr[data-device=\"3\"]')?.innerText.includes('“MTi-680G”')")
    until(page, "document.querySelector('.rollout tr[data-device=\"2\"]')?.innerText.includes('No change')")
    page.goto(f"{server.url.rstrip('/')}/#/configure/1/compare/device")
    until(page, "document.querySelector('.rollout tr[data-device=\"2\"] summary') !== null")
    page.locator('.rollout tr[data-device="2"] input').check()
    page.get_by_role("button", name="Apply this profile").click()
    until(page, "/settings? written and read back/.test(document.querySelector('.rollout')?.innerText)")
    entries = asked(server, "values", "2")["values"]["OutputConfiguration"]["outputs"]
    assert {"data_identifier": 0x4020, "output_frequency": 50} in entries


def test_changes_by_others_are_shown_and_edits_stay(serve: Serve, open_page: OpenPage) -> None:
    """One change became three, which undid the other person's without a word; Esc left the question open."""
    server = serve("sim:xbus")
    page, other = configured(server, open_page), configured(server, open_page)
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    other.locator('tr[data-id="0x2010"] select').first.select_option("20")
    other.get_by_role("button", name="Apply", exact=True).click()
    until(other, "/written and read back/.test(document.querySelector('.apply-bar')?.innerText)")
    until(page, "document.querySelector('.band')?.innerText.includes('Changed elsewhere')")
    assert "Quaternion: 100 Hz → 20 Hz" in page.inner_text(".band")
    assert "1 change" in page.inner_text(".apply-bar")
    page.goto(f"{server.url.rstrip('/')}/#/configure/1/RestoreFactoryDef")
    page.get_by_role("button", name="Send", exact=True).click()
    until(page, "document.querySelector('dialog[open]') !== null")
    chord(page, "g", "l")
    page.keyboard.press("Escape")
    until(page, "document.querySelector('dialog') === null")
    assert "#/configure" in page.url


def test_keys_reach_the_search_nothing_moves_and_bytes_by_hand_are_logged(serve: Serve, open_page: OpenPage) -> None:
    """Load and traffic keep updating; with reduced motion, nothing is animated."""
    server = serve("sim:xbus")
    page = open_page(server.url, still=True)
    until(page, SAMPLES)
    chord(page, "g", "c")
    until(page, "document.querySelector('.categories a') !== null")
    page.keyboard.press("/")
    until(page, "document.activeElement.type === 'search'")
    page.keyboard.type("baud")
    until(page, "document.querySelectorAll('.categories.found a').length > 0")
    page.keyboard.press("Enter")
    until(page, "location.hash.split('/').length >= 4")
    page.keyboard.press("Escape")
    chord(page, "g", "l")
    until(page, "document.querySelector('.plots') !== null")

    chord(page, "g", "c")
    until(page, "document.querySelector('.categories a') !== null")
    page.get_by_role("button", name="Read settings").click()
    until(page, "document.querySelector('.budget-bar') !== null")
    after(page, 1)
    page.evaluate(WATCH)
    after(page, 2)
    assert page.evaluate("window.shift") < 0.01
    assert page.evaluate("document.getAnimations().filter(a => a.playState === 'running').length") == 0

    page.get_by_role("button", name="Send hex").click()
    field = page.get_by_label("Bytes to send (hex)")
    field.fill("FA FF 0")
    assert "two hex digits" in page.inner_text("#byhand-why")
    field.fill("FA FF 30 00 D1")
    page.locator(".send-bytes button").click()
    page.get_by_role("dialog").get_by_role("button", name="Send", exact=True).click()
    until(page, "[...document.querySelectorAll('.log-entry.received b')].at(-1)?.innerText === 'GoToConfigAck'")
    page.get_by_role("button", name="Filter", exact=True).click()
    page.get_by_placeholder("Name, bytes or text").fill("gotoconf")
    until(page, "[...document.querySelectorAll('.log-entry b')].every(b => /gotoconf/i.test(b.innerText))")
