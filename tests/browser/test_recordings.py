"""Recordings in a real browser, on a real server.

Record, stop, find, open, zoom, scrub, mark, export, download; a copied link opens in the same place; lost samples are
seen at every zoom; values are samples as they were sent, however much of the recording is on screen. What the player,
the notes and the markers do is tested without a browser, in web/src/pages/recordings and web/src/extensions/notes.
"""

import csv
import io
import re
import zipfile
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import (
    DESKTOP,
    PHONE,
    SILENT,
    click,
    first_five_plots,
    fits,
    press,
    serious,
    show,
    small_targets,
)
from tests.conftest import READY
from tests.support.chromium import until
from tests.support.server_process import ServerProcess
from tests.web.wire_scenes import RATE, yard_loop

OPEN = "window.imuscopeReplay !== undefined"
DRAWN = """window.imuscopeReplay?.drawn.channels.value.some(channel => channel.ring.length > 20)
    && window.imuscopeReplay.near.channels.value.some(channel => channel.ring.length > 20)"""
NOTES = "document.querySelector('[data-panel=notes]')"
NOTES_TEXT = f"{NOTES}?.querySelector('.notes-text')?.innerText"
ANALYSIS = "document.querySelector('[data-panel=analysis]')"
CURVES = "document.querySelectorAll('[data-panel=analysis] path.trace').length"
FIRST = "document.querySelector('.recording-list tbody tr b a')"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server with a silent link and a recording of two devices, one of which loses frames, and a marker."""
    data: Path = tmp_path_factory.mktemp("recordings")
    (data / "recordings").mkdir()
    yard_loop(data / "recordings" / "yard.mcap")
    with ServerProcess(SILENT, data=data) as server:
        yield server


def opened(server: ServerProcess, open_page: Callable[..., Page], size: tuple[int, int] = DESKTOP, **more: Any) -> Page:
    """The recording, open, with samples on screen."""
    page = open_page(f"{server.url}/#/recordings", width=size[0], height=size[1], touch=size == PHONE, **more)
    until(page, f"{FIRST} !== null")
    page.evaluate(f"{FIRST}.click()")
    until(page, OPEN)
    until(page, DRAWN)
    return page


def view_of(page: Page) -> dict[str, Any]:
    """The visible range and the playhead."""
    return page.evaluate("({...window.imuscope.view.value, head: window.imuscopeReplay.head})")  # type: ignore[no-any-return]


@pytest.mark.parametrize("size", [DESKTOP, (720, 450), PHONE], ids=str)
def test_plots_of_the_player_have_room(
    recorded: ServerProcess, open_page: Callable[..., Page], size: tuple[int, int]
) -> None:
    plots = first_five_plots(opened(recorded, open_page, size))
    assert min(bottom - top for top, bottom in plots) >= 96
    assert plots[0][1] <= size[1], "one whole plot is in the first view"
    if size == DESKTOP:
        assert sum(bottom - top for top, bottom in plots) >= 520


def test_from_the_record_button_to_the_list(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    """Notes and markers belong to the recording that runs."""
    server = serve("sim:xbus?rate=50")
    page = open_page(server.url)
    until(page, READY)
    show(page, "Notes")
    until(page, f"{NOTES}?.innerText.includes('Start one with Record')")
    click(page, "button", "Record", "window.imuscope.store.recorder.value?.running === true", exact=True)
    page.get_by_role("button", name="Write notes").click()
    page.get_by_label("Notes of the recording").fill("Start of the run")
    page.get_by_role("button", name="Insert time").click()
    click(page, "button", "Save", f"{NOTES_TEXT}?.startsWith('Start of the run')", exact=True)
    press(page, "m", "document.body.innerText.includes('Marker at')")
    until(page, "window.imuscope.store.recorder.value.bytes > 500")
    page.get_by_role("link", name="Recordings").first.click()
    until(page, "document.querySelector('.recording-list')?.innerText.includes('recording now')")
    assert page.evaluate("window.imuscope.store.recorder.value.running")  # another page stops nothing
    press(page, "Shift+R", f"!window.imuscope.store.recorder.value.running && {FIRST} !== null")
    [info] = server.request("GET", "/api/recordings")
    assert info["markers"] == 1
    assert info["notes"].startswith("Start of the run [")
    page.evaluate(f"{FIRST}.click()")
    until(page, "window.imuscopeReplay?.near.channels.value.some(channel => channel.ring.length > 5)")
    assert page.locator(".markers li").count() == 1


def test_a_recording_is_read_shared_exported_and_played(
    recorded: ServerProcess, open_page: Callable[..., Page]
) -> None:
    page = opened(recorded, open_page)
    views = (zoom_and_scrub, read_at_every_zoom, see_a_loss_at_every_zoom, measure_the_whole, analyse, export_the_view)
    for check in views:
        page.keyboard.press("f")
        check(recorded, page)
        page.keyboard.press("Escape")
        until(page, "document.querySelector('dialog') === null")  # until then keys are not the recording's
    share_a_link(page)
    share_a_link_while_it_plays(page)
    play_as_a_device(recorded, page)


def zoom_and_scrub(recorded: ServerProcess, page: Page) -> None:
    whole = view_of(page)
    box = page.locator(".overview canvas").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    head = view_of(page)["head"]
    assert whole["end"] - whole["span"] < head < whole["end"]
    for _ in range(9):
        page.keyboard.press("+")
    near = view_of(page)
    assert near["span"] < whole["span"] / 20
    assert near["end"] - near["span"] <= head <= near["end"]
    # Exact samples come: as many as 400 Hz gives, and no bounds of stretches.
    count = """() => {
      const {drawn, bounds} = window.imuscopeReplay, {end, span, device} = window.imuscope.view.value;
      const {ring} = drawn.channels.value.find(c => c.info.device === device && c.info.name === "Acceleration");
      const n = ring.row(end, "device") - ring.row(end - span, "device");
      return Math.abs(n - 400 * span) < 0.1 * 400 * span + 4;
    }"""
    until(page, f"({count})()")
    page.keyboard.press("f")
    assert view_of(page)["span"] == pytest.approx(whole["span"], rel=0.05)


def read_at_every_zoom(recorded: ServerProcess, page: Page) -> None:
    [info, *_] = recorded.request("GET", "/api/recordings")
    detail = recorded.request("GET", f"/api/recordings/{info['id']}")
    t = detail["t0"] + 0.6 * (detail["t1"] - detail["t0"])
    channel = next(one for one in detail["channels"] if one["device"] == "1" and one["name"] == "Acceleration")
    path = f"/api/recordings/{info['id']}/query?channel={channel['id']}&t0={t - 0.05}&t1={t}&format=json"
    table = recorded.request("GET", path)["columns"]
    want = table["x"][-1]
    page.evaluate("t => window.imuscopeReplay.seek(t)", t)
    read = """() => {
      const {near, head} = window.imuscopeReplay, {ring} = near.channel("1", "Acceleration");
      return ring.value(0, ring.indexAt(head, "device"));
    }"""
    for _ in range(3):
        until(page, f"t => Math.abs(({read})() - t) < 1e-6", want)
        shown = "document.querySelector('.plot .legend .series-value').textContent"
        until(page, f"t => Math.abs(Number({shown}.replace('−', '-')) - t) < 0.002", want)
        for _ in range(4):
            page.keyboard.press("+")


def see_a_loss_at_every_zoom(recorded: ServerProcess, page: Page) -> None:
    losses = page.evaluate("window.imuscopeReplay.drawn.losses('1')")
    assert losses, "the simulator drops frames"
    middle = losses[len(losses) // 2]
    t = (middle["t0"] + middle["t1"]) / 2
    # The overview and the lane of losses have the colour of a loss at its position.
    red = """([selector, x]) => {
      const canvas = document.querySelector(selector), ratio = canvas.width / canvas.clientWidth;
      const {data} = canvas.getContext("2d").getImageData(Math.round((x - 4) * ratio), 0, 8 * ratio, canvas.height);
      let n = 0;
      for (let i = 0; i < data.length; i += 4) if (data[i] > 200 && data[i + 1] < 120 && data[i + 3] > 60) n += 1;
      return n > 3;
    }"""
    place = """t => {
      const {first, last} = window.imuscopeReplay.bounds, w = document.querySelector(".overview canvas").clientWidth;
      return 164 + (t - first) / (last - first) * (w - 204);
    }"""
    until(page, f"a => ({red})(a)", [".overview canvas", page.evaluate(place, t)])
    page.evaluate("t => window.imuscopeReplay.seek(t)", t)
    for _ in range(4):
        where = """t => {
          const {end, span} = window.imuscope.view.value, w = document.querySelector(".lane-box canvas").clientWidth;
          return 164 + (t - end + span) / span * (w - 204);
        }"""
        until(page, f"([s, t]) => ({red})([s, ({where})(t)])", [".lane-box canvas", t])
        for _ in range(4):
            page.keyboard.press("+")
    # Zoomed in, no line is drawn over it.
    breaks = """t => {
      const {ring} = window.imuscopeReplay.drawn.channel("1", "Acceleration");
      return ring.breaks.some(row => Math.abs(ring.time(row - ring.first) - t) < 0.02);
    }"""
    until(page, breaks, middle["t1"])


def measure_the_whole(recorded: ServerProcess, page: Page) -> None:
    """Regression: Δ was "—" more than a second from the cursor, and mean and σ where the window was summarised.

    They are of what lies between the cursors.
    """
    first, last = page.evaluate("[window.imuscopeReplay.bounds.first, window.imuscopeReplay.bounds.last]")
    a, b = first + 0.2 * (last - first), first + 0.8 * (last - first)
    box = page.locator(".plot canvas").first.bounding_box()
    assert box is not None
    place = "([t]) => { const {end, span} = window.imuscope.view.value; return (t - end + span) / span; }"
    for t, modifier in ((a, []), (b, ["Shift"])):
        x = 164 + page.evaluate(place, [t]) * (box["width"] - 204)
        page.locator(".plot canvas").first.click(position={"x": x, "y": 40}, modifiers=modifier)
    until(page, "document.querySelector('.plot .legend .series-value').textContent.match(/^Δ [−0-9.]+$/) !== null")
    mean = "[...document.querySelectorAll('.values-table td.num')].slice(0, 12).map(cell => cell.textContent)"
    until(page, f"{mean}.every(text => /[0-9]/.test(text))")
    [info, *_] = recorded.request("GET", "/api/recordings")
    detail = recorded.request("GET", f"/api/recordings/{info['id']}")
    channel = next(one for one in detail["channels"] if one["device"] == "1" and one["name"] == "Acceleration")
    columns = recorded.request("GET", f"/api/recordings/{info['id']}/query?channel={channel['id']}&format=json")[
        "columns"
    ]
    until(page, "/cursor=.*measure=/.test(location.href)")
    a, b = (float(re.search(rf"{word}=([0-9.]+)", page.url)[1]) for word in ("cursor", "measure"))  # type: ignore[index]
    inside = [row for row, t in enumerate(columns["time"]) if min(a, b) <= t <= max(a, b)]
    x, z = (sum(columns[axis][row] for row in inside) / len(inside) for axis in "xz")
    shown = [float(text.replace("−", "-")) for text in page.evaluate(mean)]
    assert shown[1] == pytest.approx(x, abs=0.01)
    assert shown[7] == pytest.approx(z, abs=0.01)


def analyse(recorded: ServerProcess, page: Page) -> None:
    """A spectrum in one action, and of an expression in one more."""
    press(
        page,
        "a",
        f"{CURVES} === 3 && {ANALYSIS}.innerText.includes('at {RATE} Hz')",
    )
    page.get_by_label("Signals or expressions").fill("norm(Acceleration) - 1 g")
    until(page, f"{CURVES} === 1")
    click(
        page,
        "button",
        "Spectrogram",
        f"{ANALYSIS}.querySelector('.spectrogram > canvas') !== null",
    )


def share_a_link(page: Page) -> None:
    """The address holds what is shown, and a page that is opened there shows it."""
    page.evaluate("() => { const r = window.imuscopeReplay; r.seek(r.bounds.first + 1.234); }")
    for _ in range(5):
        page.keyboard.press("+")
    page.keyboard.press("2")  # hides the second series
    click(page, "button", "Copy link", "document.querySelector('.transport').innerText.includes('Link copied')")
    was = view_of(page)
    page.reload()
    until(page, DRAWN)
    now = view_of(page)
    for name in ("end", "span", "head"):
        assert now[name] == pytest.approx(was[name], abs=1e-3), name
    assert now["device"] == was["device"]
    pressed = "document.querySelectorAll('.plot .legend button')[1].getAttribute('aria-pressed')"
    assert page.evaluate(pressed) == "false"


def share_a_link_while_it_plays(page: Page) -> None:
    """The address did not follow the view any more after it."""
    begin = page.evaluate("() => (window.imuscopeReplay.toggle(), window.imuscopeReplay.head)")
    until(page, f"window.imuscopeReplay.head > {begin}")
    click(page, "button", "Copy link", "document.querySelector('.transport').innerText.includes('Link copied')")
    page.evaluate("() => window.imuscopeReplay.toggle()")
    until(page, "window.imuscopeAddress?.()")


def export_the_view(recorded: ServerProcess, page: Page) -> None:
    page.evaluate("() => { const r = window.imuscopeReplay; r.seek(r.bounds.first + 2); }")
    for _ in range(5):
        page.keyboard.press("+")
    observed = view_of(page)
    page.get_by_role("button", name="Export").click()
    page.get_by_role("button", name="In view").click()
    with page.expect_download() as coming:
        page.locator("dialog .start-export").click()
    data = Path(coming.value.path()).read_bytes()
    tables = csv_tables(data)
    name, rows = next((name, rows) for name, rows in tables.items() if any("Acceleration" in cell for cell in rows[0]))
    assert abs(len(rows) - 1 - 400 * observed["span"]) < 0.1 * 400 * observed["span"] + 5, name


def csv_tables(data: bytes) -> dict[str, list[list[str]]]:
    """The tables of an export: one file, or a zip of them."""
    if data[:2] != b"PK":
        return {"": list(csv.reader(io.StringIO(data.decode())))}
    with zipfile.ZipFile(io.BytesIO(data)) as files:
        return {name: list(csv.reader(io.StringIO(files.read(name).decode()))) for name in files.namelist()}


def play_as_a_device(recorded: ServerProcess, page: Page) -> None:
    page.get_by_role("button", name="As device").click()
    until(page, "!location.hash.includes('recordings') && window.imuscope.store.devices.value.length > 1")
    until(page, READY)
    page.context.close()  # it may still be requesting the previous range
    for one in recorded.request("GET", "/api/devices"):
        if not one["parent"] and one["source"] != SILENT:
            recorded.request("DELETE", f"/api/devices/{one['id']}")


def test_files_are_downloaded_added_refused_and_renamed(
    recorded: ServerProcess, open_page: Callable[..., Page], tmp_path: Path
) -> None:
    page = open_page(f"{recorded.url}/#/recordings")
    until(page, f"{FIRST} !== null")
    data = download_the_whole(page)
    photo, void = tmp_path / "photo.jpg", tmp_path / "void.mcap"
    whole, torn = tmp_path / "other.mcap", tmp_path / "torn.mcap"
    photo.write_bytes(b"\xff\xd8" + bytes(2000))
    void.write_bytes(b"")
    whole.write_bytes(data)
    torn.write_bytes(data[: len(data) * 6 // 10])
    page.locator("input[type=file]").set_input_files([whole, photo, void, torn])
    until(page, "document.querySelectorAll('.incoming .why').length === 2")
    refused = page.locator(".incoming").inner_text()
    assert "photo.jpg is not a format imuscope knows." in refused
    assert "void.mcap is empty" in refused
    until(page, "document.querySelectorAll('.recording-list tbody tr').length === 3")
    until(page, "document.querySelector('.side .problem')?.innerText.includes('torn off')")  # it is chosen
    for name in ("photo.jpg", "void.mcap"):
        page.get_by_role("button", name=f"Dismiss {name}").click()
    assert page.locator(".incoming").count() == 0
    field = page.locator(".side input[value='torn'], .side label:has-text('File') input").last
    field.fill("battery pulled")
    field.press("Enter")
    until(page, "document.querySelector('.recording-list').innerText.includes('battery pulled')")
    assert any(one["file"] == "battery pulled.mcap" for one in recorded.request("GET", "/api/recordings"))
    page.evaluate("location.hash = '#/recordings/battery%20pulled'")
    until(page, DRAWN)
    until(page, "document.querySelector('.band.warning')?.innerText.includes('torn off')")
    page.context.close()  # before it would miss what is deleted
    for name in ("battery%20pulled", "other"):
        recorded.request("DELETE", f"/api/recordings/{name}")


def download_the_whole(page: Page) -> bytes:
    page.locator(".recording-list tbody tr").first.click(position={"x": 30, "y": 20})
    with page.expect_download() as coming:
        page.locator(".detail .actions a", has_text="Download").click()
    assert coming.value.suggested_filename.endswith(".mcap")
    data = Path(coming.value.path()).read_bytes()
    assert data.startswith(b"\x89MCAP0\r\n")
    return data


# -- a library of drives ----------------------------------------------------------------------------------------------

DRIVES = 6
STARTED = 1_795_000_000
ROWS = "[...document.querySelectorAll('tr[aria-rowindex] [data-column=name] b')].map(one => one.textContent)"
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
    rows.nth(1).locator("[data-column=length]").click()
    rows.nth(3).locator("[data-column=length]").click(modifiers=["Shift"])
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
