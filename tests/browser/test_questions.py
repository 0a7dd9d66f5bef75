"""The page of questions in a real browser: completion, an answer as table and picture, its recording."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page

from server.devices.decode_options import DecodeOptions
from server.fleet.store import location
from server.fleet.upload import upload
from tests.browser.page_checks import PHONE, TARGETS, serious
from tests.chromium import until
from tests.recordings.recorded_drive import drive
from tests.server_process import ServerProcess

WHERE = "WHERE quantity = 'acceleration' AND axis <> 'norm'"
SQL = f"SELECT recording, minute, signal, mean FROM minutes {WHERE} ORDER BY mean"
CELLS = "[...document.querySelectorAll('.answer-table tbody tr td:nth-child(4)')].map(one => one.innerText)"
PAGES = "[...document.querySelectorAll('.nav a')].map(one => one.innerText).join(' ')"


@pytest.fixture
def asked(tmp_path: Path, serve: Callable[..., ServerProcess]) -> ServerProcess:
    """A server with a store of one recording."""
    drive(tmp_path / "drive.mcap", 70)
    upload(tmp_path / "drive.mcap", location(str(tmp_path / "store")), "otter", DecodeOptions())
    return serve("sim:xbus", arguments=("--store", str(tmp_path / "store")))


def _run(page: Page, sql: str) -> None:
    field = page.get_by_label("Question in SQL")
    field.fill(sql)
    field.press("Control+Enter")


def test_a_question_from_the_keyboard_to_the_recording(
    asked: ServerProcess, open_page: Callable[..., Page], tmp_path: Path
) -> None:
    page = open_page(asked.url)
    until(page, f"{PAGES} === 'Live Configure Recordings Questions'")
    page.get_by_role("link", name="Questions").first.click()
    until(page, "document.querySelectorAll('.question-start button').length === 4")
    assert serious(page) == []

    field = page.get_by_label("Question in SQL")
    field.fill("SELECT * FROM ")
    field.press_sequentially("recor")
    until(page, "document.querySelector('#question-words [role=option]')?.innerText.startsWith('recordings')")
    field.press("ArrowDown")
    field.press("Enter")
    assert field.input_value() == "SELECT * FROM recordings"
    until(page, "document.querySelectorAll('#question-words [role=option]').length === 0")

    _run(page, "SELECT robto\nFROM recordings")
    until(page, "document.querySelector('.question-mistake mark')?.innerText === 'robto'")
    assert "Line 1, column 8" in page.locator("#question-problem").inner_text()

    _run(page, SQL)
    until(page, f"{CELLS}.length >= 3")
    assert page.locator("#question-problem").inner_text() == ""
    means = [float(text) for text in page.evaluate(CELLS)]
    assert means == sorted(means)
    page.get_by_role("button", name="mean").click()
    page.get_by_role("button", name="mean").click()
    until(page, "document.querySelector('th[aria-sort=descending]')?.innerText === 'mean'")
    assert [float(text) for text in page.evaluate(CELLS)] == means[::-1]
    assert serious(page) == []
    with page.expect_download() as coming:
        page.get_by_label("Download").select_option("csv")
    lines = Path(coming.value.path()).read_text().splitlines()
    assert (lines[0], len(lines)) == ("recording,minute,signal,mean", len(means) + 1)

    page.get_by_role("button", name="Plot", exact=True).click()
    until(page, "document.querySelectorAll('.answer-chart .points').length === 3")
    assert page.locator(".answer-chart .axis-x").count() == 1
    assert serious(page) == []
    page.get_by_role("button", name="Histogram", exact=True).click()
    until(page, "document.querySelectorAll('.answer-chart .bin').length >= 8")

    other = open_page(page.evaluate("location.href"))
    until(other, f"document.querySelector('#question')?.value === {json.dumps(SQL)}")

    page.get_by_role("button", name="Table", exact=True).click()
    page.get_by_role("button", name="Open recording").first.click()
    until(page, "window.imuscopeReplay?.drawn.channels.value.some(channel => channel.ring.length > 20)")
    assert "t0=" in page.evaluate("location.hash")


def test_a_phone_and_a_question_that_takes_long(asked: ServerProcess, open_page: Callable[..., Page]) -> None:
    width, height = PHONE
    page = open_page(f"{asked.url.rstrip('/')}/#/questions", width=width, height=height, touch=True)
    until(page, "document.querySelectorAll('.question-start button').length === 4")
    missed = page.evaluate(TARGETS)
    assert missed == []
    _run(page, SQL)
    until(page, f"{CELLS}.length >= 3")
    missed = page.evaluate(TARGETS)
    assert missed == []
    page.get_by_role("button", name="Plot", exact=True).click()
    until(page, "document.querySelectorAll('.answer-chart .points').length === 3")
    assert page.evaluate(TARGETS) == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.set_viewport_size({"width": 360, "height": 740})
    until(page, "document.documentElement.scrollWidth <= 360")

    _run(page, "SELECT sum(a.range * b.range) FROM range(1000000000) a, range(1000000000) b")
    until(page, "/Running for [1-9]\\d* s/.test(document.querySelector('.question-status')?.innerText)")
    page.get_by_role("button", name="Cancel").click()
    until(page, "document.querySelector('.question-status')?.innerText === 'Cancelled.'")
    page.get_by_role("button", name="Table", exact=True).click()
    _run(page, "SELECT 42 AS answer")
    until(page, "document.querySelector('.answer-table td')?.innerText === '42'")
