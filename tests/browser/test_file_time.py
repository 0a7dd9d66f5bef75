"""Time of a file in a real browser: a dropped table is asked about, its heading remembered, another clock used."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import SILENT, drawn, fits, press, serious, show, small_targets
from tests.recordings.recorded_drive import drive
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

ROWS = 200
OPEN = "time,gyr_x (rad/s),gyr_y (rad/s),gyr_z (rad/s),temp\n" + "".join(
    f"{5000 + n},{n % 40 / 20 - 1:.3f},0.25,-9.5,24.5\n" for n in range(ROWS)
)
TWO = "time (s),TimeUS,gyr_x\n" + "".join(f"{1.5e9 + n / 100:.2f},{n * 20_000},{n % 40}\n" for n in range(ROWS))
LASTS = "(() => { const d = window.imuscopeReplay?.detail; return d && d.t1 - d.t0; })()"
DIALOG = "document.querySelector('dialog[open] .table-reading')"
DROP = """([name, text]) => {
  const data = new DataTransfer();
  data.items.add(new File([text], name));
  const init = {bubbles: true, cancelable: true, dataTransfer: data};
  for (const kind of ["dragover", "drop"]) document.body.dispatchEvent(new DragEvent(kind, init));
}"""
DRAWN = "window.imuscopeReplay?.near.channels.value.some(channel => channel.ring.length > 20)"
ADDRESS = "window.imuscopeAddress?.()"  # it holds the panels that are shown
PANEL = "[data-panel=file-time]"
AXIS = "document.querySelector('[data-panel=file-time] tr:has(.file-time-axis) th')?.firstChild.textContent.trim()"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server with a silent link, a table with two clocks and a recording of a device."""
    data: Path = tmp_path_factory.mktemp("file-time")
    (data / "recordings").mkdir()
    (data / "recordings" / "two.csv").write_text(TWO)
    drive(data / "recordings" / "drive.mcap", seconds=2.0)
    with ServerProcess(SILENT, data=data) as running:
        yield running


def is_open(seconds: float) -> str:
    return f"Math.abs({LASTS} - {seconds}) < 0.005"


def test_a_table_is_queried_once_for_its_heading(
    server: ServerProcess, open_page: Callable[..., Page], tmp_path: Path
) -> None:
    page = open_page(f"{server.url}/#/recordings", still=True)
    until(page, "document.querySelector('.recording-list') !== null")
    page.evaluate(DROP, ["first.csv", OPEN])
    until(
        page, f"{DIALOG}?.querySelector('.table-question') !== null && {DIALOG}.querySelectorAll('tbody tr').length > 3"
    )
    dialog = page.locator("dialog[open]")
    assert "Read first.csv" in dialog.inner_text()
    assert dialog.locator("th.of-vector").all_inner_texts() == ["gyr"]
    assert dialog.get_by_role("button", name="Read it so").is_disabled()
    assert serious(page, f"{DIALOG}") == []
    dialog.get_by_role("button", name="ms 1 kHz").click()
    until(page, f"!{DIALOG}.querySelector('.table-question')")
    first, second = (dialog.locator("tbody tr").nth(n).locator("td").first.inner_text() for n in range(2))
    assert (float(second[-9:]) - float(first[-9:])) % 60 == pytest.approx(0.001, abs=2e-6)
    dialog.get_by_role("button", name="Read it so").click()
    until(page, is_open((ROWS - 1) / 1000))

    page.evaluate("location.hash = '#/recordings'")
    until(page, "document.querySelector('.recording-list') !== null")
    page.evaluate(DROP, ["second.csv", OPEN])
    until(page, "document.querySelector('.actions a.btn.main')?.href.endsWith('/second')")
    page.evaluate("location.hash = '#/recordings/second'")
    until(page, is_open((ROWS - 1) / 1000))
    assert page.evaluate(f"{DIALOG} === null")


def test_the_dialog_fits_a_phone(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = open_page(f"{server.url}/#/recordings", width=390, height=844, touch=True, still=True)
    until(page, "document.querySelector('.recording-list, .library') !== null")
    page.evaluate(DROP, ["phone.csv", OPEN.replace("temp", "temperature")])
    until(page, f"{DIALOG}?.querySelectorAll('tbody tr').length > 3")
    assert fits(page, place="document.querySelector('dialog[open]')")
    assert small_targets(page, "document.querySelector('dialog[open]')") == []
    press(page, "Escape", f"{DIALOG} === null")


def test_another_clock_is_used_and_stays(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = open_page(f"{server.url}/#/recordings/two", still=True)
    until(page, is_open((ROWS - 1) / 100))
    until(page, DRAWN)
    show(page, "Time of this file")
    until(page, f"{AXIS} === 'time'")
    until(page, ADDRESS)
    page.locator(PANEL).get_by_role("button", name="Use this clock").click()
    until(page, is_open((ROWS - 1) / 50))
    until(page, f"{AXIS} === 'TimeUS'")
    until(page, ADDRESS)
    page.reload()
    until(page, is_open((ROWS - 1) / 50))
    until(page, DRAWN)
    until(page, f"{AXIS} === 'TimeUS'")
    until(page, ADDRESS)  # the panels are in their places: a button that moves takes no click
    page.locator(PANEL).get_by_role("button", name="Automatic").click()
    until(page, is_open((ROWS - 1) / 100))
    page.locator(PANEL).get_by_role("button", name="Read otherwise").click()
    until(page, f"{DIALOG}?.querySelectorAll('tbody tr').length > 3")
    page.get_by_label("Time column").select_option(label="TimeUS")
    until(page, f"{DIALOG}.innerText.includes('50 Hz')")
    page.keyboard.press("Escape")

    page.evaluate("location.hash = '#/recordings/drive'")
    until(page, "window.imuscopeReplay?.detail.info.id === 'drive'")
    until(page, DRAWN)
    show(page, "Time of this file")
    until(page, f"{AXIS} === 'time'")
    until(page, ADDRESS)
    page.locator(PANEL).get_by_role("button", name="Use this clock").first.click()
    until(page, f"{AXIS} === 'arrival'")
    drawn(page)
