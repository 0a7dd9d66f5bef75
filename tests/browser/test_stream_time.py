"""Time of a stream in a real browser: figures of loss and jitter lead to the clocks of a device with a bursty link."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import PHONE, fits, press, serious, show, small_targets
from tests.recordings.recorded_drive import drive
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

BURSTY = "sim:xbus?rate=400&burst_ms=16&packet=0&drop=0.01"
DIALOG = "document.querySelector('dialog[open] .file-time')"
MEASURED = f"{DIALOG}?.querySelectorAll('tbody tr').length > 2"
LINKS = "document.querySelectorAll('.health-list [data-about=time][role=link]').length"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    data: Path = tmp_path_factory.mktemp("stream-time")
    (data / "recordings").mkdir()
    drive(data / "recordings" / "drive.mcap", seconds=2.0)
    with ServerProcess(BURSTY, data=data) as running:
        yield running


def test_figures_lead_to_the_clocks_of_the_stream(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = open_page(server.url)
    until(page, f"{LINKS} === 4")
    until(page, "window.imuscope.store.channels.value.some(channel => channel.ring.length > 1000)")
    page.locator(".health-list").get_by_text("Arrival jitter").click()
    until(page, MEASURED)
    dialog = page.locator("dialog[open]")
    words = dialog.inner_text()
    assert "at once with the one before" in words
    assert "SampleTimeFine" in words
    plots = dialog.locator(".file-time-difference")
    assert plots.count() >= 2
    assert plots.first.locator(".file-time-band").first.get_attribute("d")
    assert serious(page, DIALOG) == []
    press(page, "Escape", f"{DIALOG} === null")

    page.locator(".health-list").get_by_role("link", name="Arrival jitter").press("Enter")
    until(page, MEASURED)
    page.keyboard.press("Escape")
    event = page.locator(".event-list [data-event=gap]").first
    event.get_by_role("button", name="Time", exact=True).click()
    until(page, MEASURED)
    page.keyboard.press("Escape")
    show(page, "Time of this stream")
    until(page, "document.querySelectorAll('[data-panel=stream-time] tbody tr').length > 2")


def test_the_clocks_of_a_stream_fit_a_phone(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = open_page(server.url, width=PHONE[0], height=PHONE[1], touch=True)
    until(page, "document.querySelector('.strip [data-about=time][role=link]') !== null")
    page.locator(".strip [data-about=time]").first.click()
    until(page, MEASURED)
    assert fits(page, place="document.querySelector('dialog[open]')")
    assert small_targets(page, "document.querySelector('dialog[open]')") == []


def test_losses_of_a_recording_lead_into_the_player(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = open_page(f"{server.url}/#/recordings", still=True)
    until(page, "document.querySelector('.recording-list tbody tr b a') !== null")
    page.locator(".recording-list tbody tr").first.click(position={"x": 30, "y": 20})
    until(page, "document.querySelector('.fact-list [data-about=time][role=link]') !== null")
    page.locator(".fact-list [data-about=time]").click()
    until(page, "window.imuscopeReplay?.detail.info.id === 'drive'")
    until(page, MEASURED)
    assert "Time of this file" in page.locator("dialog[open]").inner_text()
    assert page.evaluate(LINKS) >= 3
