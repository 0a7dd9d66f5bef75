"""Workspaces in a real browser with a real server: stored, shared, changed by two, exported with alarms and restored.

How panels are arranged is tested in test_panels.py, in web/src/workspace/arrange.test.tsx and beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, click, opened, reload, serious
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

SOURCE = "sim:xbus?product=MTi-630&rate=20&seed=1"
PANELS = "[...document.querySelectorAll('[data-panel]')].map(one => one.dataset.panel).join(' ')"
WIDTH = "Math.round(document.querySelector('.side').getBoundingClientRect().width)"
SHEET = "document.querySelector('.arrange')"


def layout(page: Page) -> str:
    """Panels on screen, those of the side column apart."""
    return str(page.evaluate(f"{PANELS} + ' | ' + {WIDTH}"))


def save(page: Page, name: str) -> None:
    page.get_by_label("Name of a new workspace").fill(name)
    click(page, "button", "Save as new", f"{SHEET}.innerText.includes('{name} is saved.')")


def follow_link(page: Page, expected: str) -> None:
    """Time range, both cursors and the workspace go into a link in one action; it shows the arrangement."""
    page.keyboard.press("Escape")
    page.keyboard.press(" ")
    stack = page.locator(".stack")
    stack.click(position={"x": 300, "y": 60})
    stack.click(position={"x": 360, "y": 60}, modifiers=["Shift"])
    page.keyboard.press("c")
    link = page.evaluate("location.href")
    assert all(f"{name}=" in link for name in ("t0", "t1", "cursor", "measure", "workspace"))
    reload(page)
    until(page, f"{PANELS} + ' | ' + {WIDTH} === '{expected}'")


def save_both(page: Page, other: Page) -> None:
    """Change a workspace on two pages at the same time: who comes second is told, and opens the newer one."""
    for one in (page, other):
        one.keyboard.press("w")
        one.get_by_label("Stored workspace").select_option("Bench 3")
        until(one, f"{SHEET}.innerText.includes('Bench 3 is open.')")
    page.get_by_label("Place of Health").select_option("hidden")
    click(page, "button", "Save", f"{SHEET}.innerText.includes('Bench 3 is saved.')", exact=True)
    other.get_by_role("button", name="Save", exact=True).click()
    until(other, f"{SHEET}.innerText.includes('was changed since it was opened')")
    other.get_by_role("button", name="Open the newer one").click()
    until(other, f"{PANELS} === 'attitude plots events alarms'")


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
    expected = layout(page)
    save(page, "Bench 3")
    condition = {"kind": "expression", "expression": "norm(Acceleration) > 3 g"}
    added = page.request.post(f"{server.url}/api/alarms", data={"name": "Hard knock", "condition": condition})
    assert added.status == 201
    page.get_by_text("Export, import, default").click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Export", exact=True).click()
    file = tmp_path / download.value.suggested_filename
    download.value.save_as(file)
    assert file.name == "Bench 3.json"
    until(page, f"{SHEET}.innerText.includes('The file has 1 alarm too.')")
    page.request.delete(f"{server.url}/api/alarms/{added.json()['id']}")
    assert serious(page, SHEET) == []
    page.get_by_label("Open devices of").click()  # it is checked once the server has it
    until(
        page, f"{SHEET}.innerText.includes('Pages without a layout') && {SHEET}.querySelector('input:checked') !== null"
    )
    follow_link(page, expected)

    other = opened(server, open_page, DESKTOP)
    until(other, f"{PANELS} + ' | ' + {WIDTH} === '{expected}'")  # the default of the family
    save_both(page, other)

    # a file brings back what was exported, alarms too; one that is none changes nothing
    other.get_by_text("Export, import, default").click()
    other.locator(".stored input[type=file]").set_input_files(file)
    until(other, f"{PANELS} + ' | ' + {WIDTH} === '{expected}'")
    until(other, f"{SHEET}.innerText.includes('1 alarm that this server does not have: Hard knock.')")
    other.get_by_role("button", name="Add 1 alarm").click()
    until(other, f"{SHEET}.innerText.includes('1 alarm added: Hard knock.')")
    (alarm,) = page.request.get(f"{server.url}/api/alarms").json()
    assert alarm["definition"]["condition"]["expression"] == "norm(Acceleration) > 3 g"
    other.locator(".stored input[type=file]").set_input_files(
        {"name": "x.json", "mimeType": "application/json", "buffer": b"{"}
    )
    until(other, f"{SHEET}.innerText.includes('This is not a workspace of imuscope')")
    assert layout(other) == expected
