"""Workspaces in a real browser: panels arranged, maximised and undone; stored, shared, exported and restored."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, drag, opened, reload, serious
from tests.chromium import until
from tests.server_process import ServerProcess

SOURCE = "sim:xbus?product=MTi-630&rate=100&seed=1"
PANELS = "[...document.querySelectorAll('[data-panel]')].map(one => one.dataset.panel).join(' ')"
DEFAULT = "attitude plots values health alarms events"
WIDTH = "Math.round(document.querySelector('.side').getBoundingClientRect().width)"
SHEET = "document.querySelector('.arrange')"


def layout(page: Page) -> str:
    """Panels on screen, those of the side column apart."""
    return str(page.evaluate(f"{PANELS} + ' | ' + {WIDTH}"))


def save(page: Page, name: str) -> None:
    page.get_by_label("Name of a new workspace").fill(name)
    page.get_by_role("button", name="Save as new").click()
    until(page, f"{SHEET}.innerText.includes('{name} is saved.')")


def test_a_workspace_is_stored_chosen_and_shared(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page], tmp_path: Path
) -> None:
    server = serve(SOURCE)
    page = opened(server, open_page, DESKTOP)
    page.keyboard.press("w")
    page.get_by_label("Place of Events").select_option("main")
    page.get_by_label("Place of Values").select_option("hidden")
    page.get_by_role("separator", name="Width of the side column").press("Shift+ArrowLeft")
    until(page, f"{PANELS} === 'attitude plots events health alarms' && {WIDTH} === 346")
    wanted = layout(page)
    save(page, "Bench 3")
    page.get_by_text("Export, import, default").click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Export", exact=True).click()
    file = tmp_path / download.value.suggested_filename
    download.value.save_as(file)
    assert file.name == "Bench 3.json"
    assert serious(page, SHEET) == []
    page.get_by_label("Open devices of").click()  # it is checked once the server has it
    until(
        page, f"{SHEET}.innerText.includes('Pages without a layout') && {SHEET}.querySelector('input:checked') !== null"
    )

    # a link: time range, both cursors and the workspace, in one action
    page.keyboard.press("Escape")
    page.keyboard.press(" ")
    stack = page.locator(".stack")
    stack.click(position={"x": 300, "y": 60})
    stack.click(position={"x": 360, "y": 60}, modifiers=["Shift"])
    page.keyboard.press("c")
    link = page.evaluate("location.href")
    assert all(f"{name}=" in link for name in ("t0", "t1", "cursor", "measure", "workspace"))
    reload(page)
    until(page, f"{PANELS} + ' | ' + {WIDTH} === '{wanted}'")

    # another person: the default of the family, and an edit at the same time
    other = opened(server, open_page, DESKTOP)
    until(other, f"{PANELS} + ' | ' + {WIDTH} === '{wanted}'")
    other.goto(link)
    other.reload()
    until(other, f"{PANELS} + ' | ' + {WIDTH} === '{wanted}'")
    for one in (page, other):
        one.keyboard.press("w")
        one.get_by_label("Stored workspace").select_option("Bench 3")
        until(one, f"{SHEET}.innerText.includes('Bench 3 is open.')")
    page.get_by_label("Place of Health").select_option("hidden")
    page.get_by_role("button", name="Save", exact=True).click()
    until(page, f"{SHEET}.innerText.includes('Bench 3 is saved.')")
    other.get_by_role("button", name="Save", exact=True).click()
    until(other, f"{SHEET}.innerText.includes('was changed since it was opened')")
    other.get_by_role("button", name="Open the newer one").click()
    until(other, f"{PANELS} === 'attitude plots events alarms'")

    # a file brings back what was exported; one that is none changes nothing
    other.get_by_text("Export, import, default").click()
    other.locator(".stored input[type=file]").set_input_files(file)
    until(other, f"{PANELS} + ' | ' + {WIDTH} === '{wanted}'")
    other.locator(".stored input[type=file]").set_input_files(
        {"name": "x.json", "mimeType": "application/json", "buffer": b"{"}
    )
    until(other, f"{SHEET}.innerText.includes('This is not a workspace of imuscope')")
    assert layout(other) == wanted


EACH = ("Lanes", "Spectrum", "Spectrogram", "Allan deviation", "Bytes")
OWN_LANES = "document.querySelector('#plots .lanes').hidden"
IN_PANEL = "document.querySelectorAll('[data-panel={0}] {1}').length"


def test_every_panel_is_shown_and_fills_itself(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    page = opened(serve("sim:xbus?product=MTi-680G&rate=100&seed=1"), open_page, DESKTOP)
    page.keyboard.press("w")
    for title in EACH:
        page.get_by_role("button", name=f"Show {title}", exact=True).click()
    page.keyboard.press("Escape")
    until(page, f"{OWN_LANES} && {IN_PANEL.format('lanes', '.lane-names button')} > 3")  # in one place only
    until(page, f"{IN_PANEL.format('bytes', 'li')} > 5")
    until(page, f"{IN_PANEL.format('spectrum', 'path')} > 2 && {IN_PANEL.format('allan', 'path')} > 2")
    until(page, f"{IN_PANEL.format('spectrogram', 'canvas')} > 0")
    for panel in ("lanes", "bytes", "spectrum"):
        assert serious(page, f"document.querySelector('[data-panel={panel}]')", colours=False) == []
    page.locator("[data-panel=bytes] li button").first.click()
    until(page, "document.querySelector('dialog .packet-bytes') !== null")
    page.keyboard.press("Escape")
    page.keyboard.press("w")
    page.get_by_label("Place of Lanes").select_option("hidden")
    until(page, f"!{OWN_LANES} && document.querySelector('#plots .lane-names').clientHeight > 20")


def test_panels_are_arranged_undone_and_their_file_carries_alarms(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page], tmp_path: Path
) -> None:
    server = serve(SOURCE)
    page = opened(server, open_page, DESKTOP)
    assert page.evaluate(PANELS) == DEFAULT
    assert page.locator("[role=separator]").count() == 0
    width = page.evaluate(WIDTH)
    page.keyboard.press("w")
    until(page, f"{SHEET} !== null")
    assert serious(page, SHEET) == []
    page.get_by_label("Place of Events").select_option("main")
    until(page, f"{PANELS} === 'attitude plots events values health alarms'")
    drag(page, page.get_by_role("separator", name="Width of the side column"), -120, 0)
    until(page, f"Math.abs({WIDTH} - {width + 120}) < 3")
    row = page.locator("[data-row=health] .grip")
    to, at = page.locator("[data-row=values]").bounding_box(), row.bounding_box()
    assert to is not None
    assert at is not None
    drag(page, row, 0, to["y"] - at["y"] - 5)
    until(page, f"{PANELS} === 'attitude plots events health values alarms'")
    page.keyboard.press("Escape")
    until(page, f"{SHEET} === null")
    page.locator("[data-panel=values] h2").dblclick()
    until(page, f"document.querySelector('.maximised')?.clientWidth === {DESKTOP[0]}")
    assert serious(page, "document.querySelector('.maximised')", colours=False) == []
    page.keyboard.press("Escape")
    until(page, "document.querySelector('.maximised') === null")
    for _ in range(8):  # more than there were
        page.keyboard.press("Control+z")
    until(page, f"{PANELS} === '{DEFAULT}' && {WIDTH} === {width}")
    page.keyboard.press("Control+Shift+z")
    until(page, f"{PANELS} === 'attitude plots events values health alarms'")

    condition = {"kind": "expression", "expression": "norm(Acceleration) > 3 g"}
    added = page.request.post(f"{server.url}/api/alarms", data={"name": "Hard knock", "condition": condition})
    assert added.status == 201
    page.keyboard.press("w")
    page.get_by_text("Export, import, default").click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Export", exact=True).click()
    file = tmp_path / download.value.suggested_filename
    download.value.save_as(file)
    until(page, f"{SHEET}.innerText.includes('The file has 1 alarm too.')")
    page.request.delete(f"{server.url}/api/alarms/{added.json()['id']}")
    page.locator(".arrange input[type=file]").set_input_files(file)
    until(page, f"{SHEET}.innerText.includes('1 alarm that this server does not have: Hard knock.')")
    assert serious(page, SHEET) == []
    page.get_by_role("button", name="Add 1 alarm").click()
    until(page, f"{SHEET}.innerText.includes('1 alarm added: Hard knock.')")
    (alarm,) = page.request.get(f"{server.url}/api/alarms").json()
    assert alarm["definition"]["condition"]["expression"] == "norm(Acceleration) > 3 g"
    page.locator(".arrange input[type=file]").set_input_files(file)  # now it has it
    until(page, f"!{SHEET}.innerText.includes('does not have')")
