"""The page of questions in a real browser: an answer of a store as table, file and picture, its recording, and a phone.

Completion, mistakes and cancelling are tested without a browser, in web/src/extensions/fleet/questions/page.test.tsx.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page

from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.extensions.fleet.store.store import location
from imuscope.server.extensions.fleet.upload.upload import upload
from tests.browser.page_checks import PHONE, SILENT, click, fits, serious, small_targets
from tests.recordings.recorded_drive import drive
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

WHERE = "WHERE quantity = 'acceleration' AND axis <> 'norm'"
SQL = f"SELECT recording, minute, signal, mean FROM minutes {WHERE} ORDER BY mean"
CELLS = "[...document.querySelectorAll('.answer-table tbody tr td:nth-child(4)')].map(one => one.innerText)"
PAGES = "[...document.querySelectorAll('.nav a')].map(one => one.innerText).join(' ')"


@pytest.fixture
def question_server(tmp_path: Path, serve: Callable[..., ServerProcess]) -> ServerProcess:
    """A server with a store of one recording."""
    drive(tmp_path / "drive.mcap", 70)
    upload(tmp_path / "drive.mcap", location(str(tmp_path / "store")), "otter", DecodeOptions())
    return serve(SILENT, arguments=("--store", str(tmp_path / "store")))


def test_a_question_from_the_page_to_the_recording(
    question_server: ServerProcess, open_page: Callable[..., Page]
) -> None:
    page = open_page(question_server.url)
    until(page, f"{PAGES} === 'Live Configure Recordings Questions'")
    page.get_by_role("link", name="Questions").first.click()
    until(page, "document.querySelectorAll('.question-start button').length === 4")
    assert serious(page, colours=False) == []

    field = page.get_by_label("Question in SQL")
    field.fill(SQL)
    field.press("Control+Enter")
    until(page, f"{CELLS}.length >= 3")
    means = [float(text) for text in page.evaluate(CELLS)]
    assert means == sorted(means)
    with page.expect_download() as coming:
        page.get_by_label("Download").select_option("csv")
    lines = Path(coming.value.path()).read_text().splitlines()
    assert (lines[0], len(lines)) == ("recording,minute,signal,mean", len(means) + 1)
    assert serious(page) == []
    click(page, "button", "Plot", "document.querySelectorAll('.answer-chart .points').length === 3", exact=True)
    assert page.locator(".answer-chart .axis-x").count() == 1
    assert serious(page, "document.querySelector('.query-answer')") == []

    fits_a_phone(page)
    page.get_by_role("button", name="Table", exact=True).click()
    fits_a_phone(page)
    page.get_by_role("button", name="Open recording").first.click()
    until(page, "window.imuscopeReplay?.drawn.channels.value.some(channel => channel.ring.length > 20)")
    assert "t0=" in page.evaluate("location.hash")


def fits_a_phone(page: Page) -> None:
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert fits(page)
    assert small_targets(page) == []
    assert fits(page, width=360)
