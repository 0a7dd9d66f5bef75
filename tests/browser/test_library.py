"""A library of drives in a real browser, on a real server.

What is unread is read by itself; order, selection, tags, undo; a range of a drive becomes one of its own.
"""

from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import PHONE, SILENT, click, fits, serious, small_targets
from tests.support.chromium import until
from tests.support.server_process import ServerProcess
from tests.web.wire_scenes import yard_loop

DRIVES = 6
STARTED = 1_795_000_000
ROWS = "[...document.querySelectorAll('tr[aria-rowindex] .c-name b')].map(one => one.textContent)"
PICKED = "document.querySelectorAll('tr[aria-selected=true]').length"
TEXTS = ".library :is(h2, h3, b, th, td, button, .btn, .unit, .tag, .storage span)"
CUT = f"""() => [...document.querySelectorAll({TEXTS!r})]
    .filter(one => one.checkVisibility() && one.clientWidth > 0 && !one.closest("[aria-hidden=true]"))
    .filter(one => one.scrollWidth > one.clientWidth + 1
        || (one.tagName === "B" && one.scrollHeight > one.clientHeight + 2))
    .map(one => one.outerHTML.slice(0, 120))"""


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server with drives of one and two seconds that were recorded elsewhere."""
    data: Path = tmp_path_factory.mktemp("drives")
    (data / "recordings").mkdir()
    for n in range(DRIVES):
        start = STARTED + 3600 * n
        path = data / "recordings" / f"{datetime.fromtimestamp(start, UTC):%Y%m%dT%H%M%SZ}-MTi-630.mcap"
        yard_loop(path, "", rate=100, seconds=1 + n % 2, start=start * 10**9, seed=n + 1)
    with ServerProcess(SILENT, data=data) as server:
        yield server


def library(server: ServerProcess, open_page: Callable[..., Page], size: tuple[int, int]) -> Page:
    page = open_page(f"{server.url}/#/recordings", width=size[0], height=size[1], touch=size == PHONE)
    until(page, f"{ROWS}.length === {DRIVES}")
    until(page, "document.querySelector('.thumbnail.unread') === null")  # they are read by themselves
    until(page, "document.querySelector('.storage')?.textContent.includes('free')")
    return page


def test_drives_are_sorted_selected_tagged_deleted_and_restored(
    drives: ServerProcess, open_page: Callable[..., Page]
) -> None:
    page = library(drives, open_page, (1440, 900))
    newest = page.evaluate(ROWS)
    assert len(set(newest)) == DRIVES
    click(page, "button", "Recorded", f"{ROWS}[0] === {newest[-1]!r}")
    page.reload()
    until(page, f"{ROWS}[0] === {newest[-1]!r}")  # the browser keeps it
    rows = page.locator("tr[aria-rowindex]:not(:has(th))")
    rows.nth(1).locator(".c-length").click()
    rows.nth(3).locator(".c-length").click(modifiers=["Shift"])
    until(page, f"{PICKED} === 3")
    for width in (1440, 1280):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate(CUT) == []
    assert serious(page, "document.querySelector('.library')") == []
    page.get_by_label("Tag all, Enter").fill("mast")
    page.keyboard.press("Enter")
    until(page, "document.querySelector('.tag-cloud')?.textContent.includes('mast 3')")
    page.get_by_role("grid").focus()
    page.keyboard.press("Delete")
    until(page, f"{ROWS}.length === {DRIVES - 3}")
    click(page, "button", "Undo", f"{ROWS}.length === {DRIVES}")
    page.get_by_role("grid").focus()
    page.keyboard.press("Home")
    page.keyboard.press("Shift+ArrowDown")
    until(page, f"{PICKED} === 2")
    page.get_by_role("link", name="Compare").click()
    until(page, "location.hash.includes('a=') && location.hash.includes('b=')")


def test_a_range_of_a_drive_is_kept_on_a_phone_too(drives: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = library(drives, open_page, PHONE)
    assert page.evaluate(CUT) == []
    assert small_targets(page, "document.querySelector('.library-centre')") == []
    page.get_by_role("button", name="Select", exact=True).click()
    page.get_by_role("checkbox").nth(0).check()
    until(page, "document.querySelector('.selection-bar') !== null")
    assert small_targets(page, "document.querySelector('.library-centre')") == []
    assert fits(page)
    page.get_by_role("button", name="Cancel").click()
    page.locator("tr[aria-rowindex] b a").first.click()
    until(page, "window.imuscopeReplay?.drawn.channels.value.some(channel => channel.ring.length > 20)")
    assert page.locator(".replay-head").inner_text().startswith(page.title().removesuffix(" · imuscope"))
    assert small_targets(page, "document.querySelector('.replay-head')") == []
    for _ in range(2):
        page.keyboard.press("+")
    page.get_by_role("button", name="Export, link, markers, devices").click()
    click(page, "button", "Keep this range", "document.querySelector('.band.saved a') !== null")
    page.keyboard.press("Escape")
    page.locator(".band.saved a").click()
    until(page, "document.querySelector('.replay-head b')?.textContent.includes('00:00.0 to 00:0')")
    until(page, "window.imuscopeReplay?.drawn.channels.value.some(channel => channel.ring.length > 5)")
