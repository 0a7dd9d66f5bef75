"""The Configure page with real servers and real twins: what a person does there, and what may never happen to them.

Rates are changed and seen in the plot; a rate that cuts the line comes back by itself, also when nobody is there any
more; profiles are compared and applied; every command and setting of every family opens as a form without an error.
"""

from __future__ import annotations

import json
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page

from tests.browser.test_page import TARGETS, serious
from tests.browser.test_pictures import picture
from tests.chromium import until
from tests.fault_injection.test_kill import until as held_until
from tests.server_process import ServerProcess
from tests.timeouts import PATIENCE_S

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
    """What the server answers to a GET."""
    with urllib.request.urlopen(f"{server.url.rstrip('/')}/api/devices/{device}/{path}", timeout=PATIENCE_S) as answer:
        return json.load(answer)


def configured(server: ServerProcess, open_page: OpenPage, place: str = "", **options: Any) -> Page:
    """The Configure page of the first device, with its settings read."""
    page = open_page(f"{server.url.rstrip('/')}/#/configure/1{place}", **options)
    until(page, "document.querySelector('.cform h1') !== null")
    if page.get_by_role("button", name="Read the settings").count():
        page.get_by_role("button", name="Read the settings").click()
    until(page, "document.querySelector('[data-setting], [data-command], .compare') !== null")
    return page


def test_a_rate_is_changed_in_five_actions_and_the_plot_follows(serve: Serve, open_page: OpenPage) -> None:
    page = open_page(serve("twin:xbus").url)
    until(page, SAMPLES)
    until(page, f"Math.abs(({RATE})('Acceleration') - 100) < 10")
    page.get_by_role("link", name="Configure").click()  # 1
    page.get_by_role("button", name="Read the settings").click()  # 2
    page.locator(f"{ACCELERATION} select").first.select_option("50")  # 3
    until(page, "document.querySelector('.was')?.innerText === 'was 100 Hz'")
    page.get_by_role("button", name="Apply", exact=True).click()  # 4
    until(page, "/1 of 1 settings written and read back/.test(document.querySelector('.applybar')?.innerText)")
    page.get_by_role("link", name="Live", exact=True).click()  # 5
    until(page, f"Math.abs(({RATE})('Acceleration') - 50) < 5")
    until(page, "document.querySelector('.plots canvas') !== null")


def test_a_row_its_bytes_and_its_share_light_together(serve: Serve, open_page: OpenPage) -> None:
    page = configured(serve("twin:xbus"), open_page)
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    until(page, "document.querySelector('.hx.ch')?.innerText.startsWith('40 20 00 32')")
    until(
        page, "document.querySelectorAll('.hx.ch').length === 1 && document.querySelectorAll('.bb i.ch').length === 1"
    )
    page.hover(f"{ACCELERATION} td:nth-child(2)")
    lit = "[...document.querySelectorAll('tr.hot, .hx.hot, .bb i.hot')].map(e => e.tagName).sort().join()"
    until(page, f"{lit} === 'I,SPAN,TR'")
    assert "40 20 00 32" in page.inner_text(".hx.hot").replace("\n", " ")
    page.locator(".hx.ch").hover()
    until(page, "document.querySelector('tr.hot')?.dataset.id === '0x4020'")


def test_more_than_the_line_carries_is_not_written_but_made_to_fit(serve: Serve, open_page: OpenPage) -> None:
    page = configured(serve("twin:xbus"), open_page)
    page.get_by_role("checkbox", name="Pressure").uncheck()
    page.locator(f"{ACCELERATION} select").first.select_option("400")
    until(page, "document.querySelector('.bb .surplus') !== null")
    assert page.get_by_role("button", name="Apply", exact=True).is_disabled()
    assert "% of the link" in page.inner_text("#apply-why")
    page.get_by_role("button", name="Make it fit").click()
    until(page, "document.querySelector('.fitwords')?.innerText.includes('→')")
    until(page, "document.querySelector('.bb .surplus') === null")
    assert page.get_by_role("button", name="Apply", exact=True).is_enabled()


def test_a_wrong_value_is_refused_where_it_is_typed(serve: Serve, open_page: OpenPage) -> None:
    page = configured(serve("twin:xbus"), open_page, "/LatLonAlt")
    latitude = page.get_by_label("Latitude")
    before = latitude.input_value()
    latitude.fill("95")
    assert "90" in page.locator("[data-field=latitude] [role=alert]").first.inner_text()
    assert latitude.get_attribute("aria-invalid") == "true"
    latitude.fill("51.5")
    until(page, "document.querySelector('[data-field=latitude] [role=alert]') === null")
    assert page.get_by_role("button", name="Apply", exact=True).is_enabled()
    page.get_by_role("button", name="Undo the last edit").click()
    until(page, "document.querySelector('.applybar') === null")
    latitude.blur()
    assert page.get_by_label("Latitude").input_value() == before


def test_a_write_that_the_device_does_not_take_is_told_field_by_field(serve: Serve, open_page: OpenPage) -> None:
    """Its power fails while it stores: what it has afterwards is the old rate, and the page must not say otherwise."""
    page = configured(serve("twin:xbus?cut=1"), open_page)
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    page.get_by_role("button", name="Apply", exact=True).click()
    until(page, "document.querySelector('.outcomes li') !== null")
    assert "Output configuration" in page.inner_text(".outcomes")
    picture(page, "rejected-1440")
    page.get_by_role("button", name="Edit again").click()
    until(page, "document.querySelector('.applybar')?.innerText.includes('1 change')")


def set_baud(page: Page, words: str) -> None:
    """Ask for another rate of the first port, on trial."""
    page.locator("[data-field=words] select").first.select_option(label=words)
    page.get_by_role("button", name="Apply", exact=True).click()
    dialog = page.get_by_role("dialog")
    until(page, "document.activeElement.innerText === 'Leave it as it is'")
    dialog.get_by_role("button", name="Write on trial").click()


def test_a_rate_that_nobody_keeps_goes_back_also_when_the_browser_is_gone(serve: Serve, open_page: OpenPage) -> None:
    server = serve("twin:xbus")
    page = configured(server, open_page, "/PortConfig")
    set_baud(page, "921 600 Bd")
    until(page, "document.querySelector('.deck[role=alertdialog]') !== null")
    until(page, "document.activeElement.innerText === 'Go back now'")
    picture(page, "trial-1440")
    assert asked(server, "control")["trial"]["state"] == "asking"
    page.context.close()
    held_until(lambda: asked(server, "control")["trial"]["state"] == "reverted", "the old settings are back")
    other = open_page(server.url)
    until(other, "window.imuscope?.store.control.value.get('1')?.trial?.state === 'reverted'")
    until(other, "window.imuscope.store.devices.value[0].baud === 115200")
    until(other, "document.querySelector('.deck')?.innerText.includes('old settings')")


# Previews that come late, as from a busy server: who is quick applies before they are there.
LATE_PREVIEWS = """() => {
  const fetch = window.fetch;
  window.fetch = async (place, ...more) => {
    if (String(place.url ?? place).endsWith("/preview")) await new Promise(done => setTimeout(done, 1500));
    return fetch(place, ...more);
  };
}"""


def test_what_is_kept_stays(serve: Serve, open_page: OpenPage) -> None:
    """The question once said nothing of a trial, and its button "Write", where the preview came after it."""
    server = serve("twin:xbus")
    page = configured(server, open_page, "/PortConfig")
    page.evaluate(LATE_PREVIEWS)
    set_baud(page, "921 600 Bd")
    until(page, "document.querySelector('.deck[role=alertdialog]') !== null")
    page.get_by_role("button", name="Keep settings").click()
    until(page, "document.querySelector('.deck h3')?.innerText.endsWith('Kept')")
    until(page, "window.imuscope.store.devices.value[0].baud === 921600")
    until(page, "/written and read back/.test(document.querySelector('.applybar')?.innerText)")


def test_two_profiles_are_compared_and_one_is_applied(serve: Serve, open_page: OpenPage) -> None:
    server = serve("twin:xbus")
    page = configured(server, open_page)
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    page.get_by_role("button", name="Apply", exact=True).click()
    until(page, "/written and read back/.test(document.querySelector('.applybar')?.innerText)")
    page.get_by_role("navigation", name="Snapshots").get_by_role("link", name="First contact").click()
    until(page, "document.querySelectorAll('.difftable tbody tr').length === 1")
    row = page.locator(".difftable tbody tr")
    assert "50 Hz" in row.locator("td").first.inner_text()
    assert "100 Hz" in row.locator("td").last.inner_text()
    picture(page, "compare-1440")
    page.get_by_role("button", name="Apply this profile").click()
    until(page, "document.querySelector('.compare')?.innerText.includes('No difference')")
    entries = asked(server, "values")["values"]["OutputConfiguration"]["outputs"]
    assert {"data_identifier": 0x4020, "output_frequency": 100} in entries


def test_a_dangerous_command_asks_once_more_in_words(serve: Serve, open_page: OpenPage) -> None:
    server = serve("twin:xbus")
    page = configured(server, open_page, "/RestoreFactoryDef")
    before = len(asked(server, "exchange"))
    page.get_by_role("button", name="Send", exact=True).click()
    dialog = page.get_by_role("dialog")
    form = next(one for one in asked(server, "forms")["commands"] if one["name"] == "RestoreFactoryDef")
    assert form["consequence"] in dialog.inner_text()
    until(page, "document.activeElement.innerText === 'Leave it as it is'")
    picture(page, "asked-1440")
    page.keyboard.press("Enter")
    until(page, "document.querySelector('dialog') === null")
    assert len(asked(server, "exchange")) == before, "nothing was sent"


SOURCES = ("twin:xbus", "twin:isb", "twin:idtp")


# Opens one form after the other; what is wrong with any. In the page, for there are hundreds.
OPENED = """async forms => {
  const wrong = [];
  for (const [kind, name, title, fields, editor] of forms) {
    const place = `[data-${kind}="${name}"]`, patience = performance.now() + 60000;
    location.hash = `#/configure/1/${encodeURIComponent(name)}`;
    const is_open = () => document.querySelector(place) && document.querySelector(".cform h1").innerText === title;
    while (!is_open() && performance.now() < patience) await new Promise(done => setTimeout(done));
    const drawn = document.querySelectorAll(`${place} > .fields > .frow`).length;
    if (!is_open()) return [...wrong, `${name} does not open`];
    if (!editor && drawn !== fields) wrong.push(`${name}: ${drawn} of ${fields} fields`);
  }
  return wrong;
}"""


@pytest.mark.parametrize("source", SOURCES)
def test_every_setting_and_command_opens_as_a_form(serve: Serve, open_page: OpenPage, source: str) -> None:
    """An error on the console, or a script that throws, fails it (see conftest)."""
    server = serve(source)
    page = open_page(f"{server.url.rstrip('/')}/#/configure/1")
    until(page, "document.querySelector('.cats a') !== null")
    forms = asked(server, "forms")
    if forms["settings"]:
        page.get_by_role("button", name="Read the settings").click()
        until(page, "document.querySelector('[data-setting]') !== null")
        until(page, "document.querySelector('.applybar [role=status]') === null")
        forms = asked(server, "forms")  # of the product, which may have become known by reading
    page.get_by_role("button", name="All", exact=True).click()
    parts = {"setting": "fields", "command": "arguments"}
    asked_for = [
        [kind, form["name"], form["title"], len(form[part]), form.get("editor")]
        for kind, part in parts.items()
        for form in forms[f"{kind}s"]
    ]
    assert page.evaluate(OPENED, asked_for) == []
    page.wait_for_timeout(500)


@pytest.mark.parametrize("width", ["1440", "phone"])
def test_the_page_is_for_everybody(serve: Serve, open_page: OpenPage, width: str) -> None:
    """No serious finding of axe-core, no sideways scrolling, targets that a finger hits, in every sort of place."""
    phone = width == "phone"
    size: dict[str, Any] = {"width": 390, "height": 844, "touch": True} if phone else {}
    page = configured(serve("twin:xbus"), open_page, **size)
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    until(page, "document.querySelector('.hx.ch') !== null")
    if not phone:
        page.hover(f"{ACCELERATION} td:nth-child(2)")
    for theme in ("light", "dark"):
        page.emulate_media(color_scheme=theme)  # type: ignore[arg-type]
        page.wait_for_timeout(200)
        picture(page, f"configure-{width}-{theme}")
    for place in (
        "Output%20configuration",
        "Frame%20and%20mounting",
        "PortConfig",
        "SetSyncSettings",
        "compare",
        "restore",
    ):
        page.evaluate("place => { location.hash = `#/configure/1/${place}`; }", place)
        page.wait_for_timeout(500)
        assert serious(page) == [], place
        if phone:
            assert page.evaluate("document.scrollingElement.scrollWidth") <= 390, place
            small = page.evaluate(TARGETS)
            assert not small, "\n".join([place, *small])


def test_360_px_do_not_scroll_sideways(serve: Serve, open_page: OpenPage) -> None:
    page = configured(serve("twin:xbus"), open_page, width=360, height=740, touch=True)
    for place in ("Output%20configuration", "Filter%20profile", "PortConfig", "compare", "corrections"):
        page.evaluate("place => { location.hash = `#/configure/1/${place}`; }", place)
        page.wait_for_timeout(400)
        assert page.evaluate("document.scrollingElement.scrollWidth") <= 360, place
    page.evaluate("scrollTo(0, 0)")
    page.get_by_role("button", name="Settings", exact=True).click()
    page.get_by_label("Search settings and commands").fill("lever")
    assert page.get_by_role("navigation", name="Found").is_visible() or "Nothing" in page.inner_text("#rail")


def chord(page: Page, *keys: str) -> None:
    """Keys a tenth of a second after each other, however long a busy page takes for each."""
    devtools, at = page.context.new_cdp_session(page), time.time()
    for key in keys:
        at += 0.1
        told = {"key": key, "code": f"Key{key.upper()}", "timestamp": at}
        devtools.send("Input.dispatchKeyEvent", {"type": "keyDown", "text": key, **told})
        devtools.send("Input.dispatchKeyEvent", {"type": "keyUp", **told})
    devtools.detach()


def test_the_keys_lead_between_the_pages_and_into_the_search(serve: Serve, open_page: OpenPage) -> None:
    page = open_page(serve("twin:xbus").url)
    until(page, SAMPLES)
    chord(page, "g", "c")
    until(page, "document.querySelector('.cats a') !== null")
    page.keyboard.press("/")
    until(page, "document.activeElement.type === 'search'")
    page.keyboard.type("baud")
    until(page, "document.querySelectorAll('.cats.found a').length > 0")
    page.keyboard.press("Enter")
    until(page, "location.hash.split('/').length >= 4")
    page.keyboard.press("Escape")
    chord(page, "g", "l")
    until(page, "document.querySelector('.plots') !== null")


def test_bytes_by_hand_are_asked_about_and_seen_in_the_log(serve: Serve, open_page: OpenPage) -> None:
    server = serve("twin:xbus")
    page = configured(server, open_page)
    page.get_by_role("button", name="Send hex").click()
    field = page.get_by_label("Bytes to send, hex")
    field.fill("FA FF 0")
    assert "Two hex digits" in page.inner_text("#byhand-why")
    field.fill("FA FF 30 00 D1")
    page.locator(".byhand button").click()
    page.get_by_role("dialog").get_by_role("button", name="Send", exact=True).click()
    until(page, "[...document.querySelectorAll('.ex.in b')].at(-1)?.innerText === 'GoToConfigAck'")
    page.get_by_role("button", name="Filter", exact=True).click()
    page.get_by_placeholder("Name, bytes or words").fill("gotoconf")
    until(page, "[...document.querySelectorAll('.ex b')].every(b => /gotoconf/i.test(b.innerText))")


def test_who_may_only_look_sees_everything_and_touches_nothing(
    serve: Serve, open_page: OpenPage, tmp_path: Path
) -> None:
    config = tmp_path / "imuscope.toml"
    config.write_text('view_token = "only-looking"\ncontrol_token = "may-command"\n')
    server = serve("twin:xbus", arguments=("--config", str(config)))
    page = configured(server, open_page)
    until(page, "document.querySelector('.bb') !== null")
    page.goto(f"{server.url.rstrip('/')}/?token=only-looking#/configure/1")
    until(page, "document.querySelector('.band')?.innerText.includes('View only')")
    until(page, "document.querySelectorAll('.hx').length > 5")  # bytes and load are for looking
    until(page, "document.querySelector('.bb') !== null")
    assert page.get_by_role("button", name="Read again").is_disabled()
    assert page.get_by_role("button", name="Send hex").is_disabled()
    picture(page, "view-only-1440")
    page.evaluate("location.hash = '#/configure/1/compare/~factory'")
    until(page, "document.querySelectorAll('.difftable tbody tr').length > 0")
    assert page.get_by_role("button", name="Apply this profile").is_disabled()


def test_what_was_typed_stays_while_the_device_is_gone(serve: Serve, open_page: OpenPage) -> None:
    """The page says why it cannot be written now, and waits."""
    server = serve("twin:xbus?unplug_s=12&away_s=6")
    page = configured(server, open_page)
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    until(page, "[...document.querySelectorAll('.band')].some(e => /^Lost/.test(e.innerText))")
    assert page.get_by_role("button", name="Apply", exact=True).is_disabled()
    picture(page, "configure-lost-1440")
    until(page, "![...document.querySelectorAll('.band')].some(e => /^Lost/.test(e.innerText))")
    assert page.locator(f"{ACCELERATION} select").first.input_value() == "50"


def test_nothing_moves_while_the_device_measures(serve: Serve, open_page: OpenPage) -> None:
    """Load and exchange go on under the eye; with less motion wanted, nothing is animated."""
    page = configured(serve("twin:xbus"), open_page, still=True)
    until(page, "document.querySelector('.bb') !== null")
    page.wait_for_timeout(1500)
    page.evaluate("""() => {
      window.shift = 0;
      new PerformanceObserver(list => { for (const entry of list.getEntries()) window.shift += entry.value; })
        .observe({type: "layout-shift"});
    }""")
    page.wait_for_timeout(3000)
    assert page.evaluate("window.shift") < 0.01
    assert page.evaluate("document.getAnimations().filter(a => a.playState === 'running').length") == 0


def test_a_profile_goes_to_two_devices_each_with_its_own_differences(serve: Serve, open_page: OpenPage) -> None:
    """It once wrote only what differed on the selected device, to any product, and told what came of that one only."""
    server = serve("twin:xbus?seed=1", "twin:xbus?seed=2", "twin:xbus?product=MTi-680G&seed=3")
    page = configured(server, open_page)
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    page.get_by_role("button", name="Apply", exact=True).click()
    until(page, "/written and read back/.test(document.querySelector('.applybar')?.innerText)")
    page.goto(f"{server.url.rstrip('/')}/#/configure/1/compare/~factory")
    until(page, "document.querySelectorAll('.rollout tbody tr').length === 3")
    for device in ("2", "3"):
        page.locator(f'.rollout tr[data-device="{device}"]').get_by_role("button", name="Read").click()
        until(page, f"document.querySelector('.rollout tr[data-device=\"{device}\"] button') === null")
    page.get_by_role("navigation", name="Snapshots").get_by_role("link", name="First contact").click()
    until(page, "document.querySelector('.rollout tr[data-device=\"3\"]')?.innerText.includes('“MTi-680G”')")
    until(page, "document.querySelector('.rollout tr[data-device=\"2\"]')?.innerText.includes('Nothing')")
    page.goto(f"{server.url.rstrip('/')}/#/configure/1/compare/device")
    until(page, "document.querySelector('.rollout tr[data-device=\"2\"] summary') !== null")
    page.locator('.rollout tr[data-device="2"] input').check()
    page.get_by_role("button", name="Apply this profile").click()
    until(page, "/settings? written and read back/.test(document.querySelector('.rollout')?.innerText)")
    entries = asked(server, "values", "2")["values"]["OutputConfiguration"]["outputs"]
    assert {"data_identifier": 0x4020, "output_frequency": 50} in entries


def test_what_somebody_else_writes_is_told_and_edits_stay_edits(serve: Serve, open_page: OpenPage) -> None:
    """One change became three, which undid the other person's without a word; Esc left the question open."""
    server = serve("twin:xbus")
    page, other = configured(server, open_page), configured(server, open_page)
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    other.locator('tr[data-id="0x2010"] select').first.select_option("20")
    other.get_by_role("button", name="Apply", exact=True).click()
    until(other, "/written and read back/.test(document.querySelector('.applybar')?.innerText)")
    until(page, "document.querySelector('.band')?.innerText.includes('Changed elsewhere')")
    assert "Quaternion: 100 Hz → 20 Hz" in page.inner_text(".band")
    assert "1 change" in page.inner_text(".applybar")
    page.goto(f"{server.url.rstrip('/')}/#/configure/1/RestoreFactoryDef")
    page.get_by_role("button", name="Send", exact=True).click()
    until(page, "document.querySelector('dialog[open]') !== null")
    chord(page, "g", "l")
    page.keyboard.press("Escape")
    until(page, "document.querySelector('dialog') === null")
    assert "#/configure" in page.url
