"""Evidence in a real browser: made from a recording, opened from disk without a network, measured, also on a phone.

What is asked of the server, also from Live, is tested without a browser, in web/src/pages/dialogs.test.tsx; what is in
a file, in tests/server/extensions/evidence/test_evidence.py.
"""

import re
import urllib.request
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pyarrow as pa
import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import PHONE, SILENT, click, press, serious
from tests.browser.test_recordings import opened
from tests.server.extensions.evidence.evidence_harness import content_in
from tests.support.chromium import until
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S
from tests.web.wire_scenes import yard_loop

MADE = "document.querySelector('dialog .jobs a') !== null"
CHIP = "[...document.querySelectorAll('.chip')].find(chip => chip.textContent.startsWith(NAME))?.textContent"
AXIS = "document.querySelector('canvas').getAttribute('aria-label')"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    data: Path = tmp_path_factory.mktemp("evidence")
    (data / "recordings").mkdir()
    yard_loop(data / "recordings" / "yard.mcap", title="Yard </script><script>window.hit = 1</script>")
    with ServerProcess(SILENT, data=data) as server:
        yield server


def made(page: Page, folder: Path) -> Path:
    """The file that the dialog makes."""
    page.keyboard.press("e")
    click(page, "button", "Make the file", MADE)
    with page.expect_download() as coming:
        page.locator("dialog .jobs a").first.click()
    path = folder / coming.value.suggested_filename
    coming.value.save_as(path)
    return path


def from_disk(open_page: Callable[..., Page], path: Path, **how: object) -> Page:
    page = open_page(path.as_uri(), **how)
    until(page, "document.querySelectorAll('.plot canvas').length > 2")
    until(page, f"{AXIS} !== null")
    return page


def cursor(page: Page, name: str) -> float:
    """Time of a cursor, s of the day."""
    text = until(page, CHIP.replace("NAME", repr(name)))
    hours, minutes, seconds = text.split()[1].split(":")
    return 3600 * int(hours) + 60 * int(minutes) + float(seconds)


def test_a_file_measures_offline_what_the_recording_holds(
    recorded: ServerProcess, open_page: Callable[..., Page], tmp_path: Path
) -> None:
    of_server = opened(recorded, open_page)
    path = made(of_server, tmp_path)
    of_server.context.close()
    page = from_disk(open_page, path)
    page.context.set_offline(True)
    page.reload()
    until(page, f"{AXIS} !== null")
    assert page.evaluate("window.hit") is None
    assert page.title().startswith("Evidence: Yard </script>")
    whole = page.evaluate(AXIS)
    canvas = page.locator(".plot canvas").first
    box = canvas.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60)
    page.mouse.wheel(0, -400)
    until(page, f"{AXIS} !== {whole!r}")
    zoomed = page.evaluate(AXIS)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2 - 150, box["y"] + 60, steps=4)
    page.mouse.up()
    until(page, f"{AXIS} !== {zoomed!r}")
    page.keyboard.press("Escape")  # the file has the cursor of the page
    until(page, "[...document.querySelectorAll('.chip')].every(chip => chip.hidden)")
    canvas.click(position={"x": 0.3 * box["width"], "y": 60})
    canvas.click(position={"x": 0.6 * box["width"], "y": 60}, modifiers=["Shift"])
    a, b = cursor(page, "A"), cursor(page, "B")
    assert b - a > 0.1
    row = page.locator(".measured tbody tr", has_text="Acceleration: z")
    cells = [text.replace("\u2212", "-").replace("\u2009", "") for text in row.locator("td").all_inner_texts()]
    values = [float(cell.split()[0]) for cell in cells]
    times, z = samples(recorded, content_in(path.read_text(encoding="utf-8"))["t0"])
    within = (times >= a - 1e-6) & (times <= b + 1.01e-4)  # cursors are on samples; their texts are cut to 0.1 ms
    assert values[6] == within.sum()
    assert values[5] == pytest.approx(z[within].mean(), abs=6e-4)
    assert values[0] == pytest.approx(z[np.abs(times - a).argmin()], abs=6e-4)
    assert values[4] == pytest.approx(z[within].max(), abs=6e-4)
    press(page, ".", f"{CHIP.replace('NAME', repr('A'))} !== undefined")
    press(page, "0", f"{AXIS} === {whole!r}")
    press(page, "Escape", "document.querySelector('.measured') === null")
    page.locator("button.time", has_text=re.compile(r"\d")).first.click()
    assert cursor(page, "A") > 0
    assert serious(page) == []
    page.context.close()
    on_a_phone(from_disk(open_page, path, width=PHONE[0], height=PHONE[1], touch=True, dark=False))


def on_a_phone(phone: Page) -> None:
    assert phone.evaluate("document.documentElement.scrollWidth") <= PHONE[0]
    canvas = phone.locator(".plot canvas").first
    canvas.tap(position={"x": 150, "y": 60})
    phone.get_by_role("button", name="B", exact=True).click()
    canvas.tap(position={"x": 250, "y": 60})
    assert cursor(phone, "B") > cursor(phone, "A")
    heights = phone.evaluate("[...document.querySelectorAll('.toolbar button')].map(one => one.offsetHeight)")
    assert min(heights) >= 44


def samples(server: ServerProcess, t0: float) -> tuple[np.ndarray, np.ndarray]:
    """Times, s of the day, and z of the acceleration of the whole recording."""
    url = f"{server.url}/api/recordings/yard/query?channel={quote('Acceleration')}"
    with urllib.request.urlopen(url, timeout=PATIENCE_S) as answer:
        table = pa.ipc.open_stream(answer.read()).read_all()
    moment = datetime.fromtimestamp(t0, UTC)
    midnight = datetime(moment.year, moment.month, moment.day, tzinfo=UTC).timestamp()
    name = next(name for name in table.column_names if name.endswith("z"))
    return table["time"].to_numpy() - midnight, table[name].to_numpy()
