"""Pictures for the README and the user guide: the real page with simulators, taken by a real browser.

    python -m tests.browser.guide_pictures              all of them, into docs/guide/images
    python -m tests.browser.guide_pictures live-dark    only those named

A picture is reduced to a palette of 128 colours, which keeps it below `MAX_BYTES`. The moving one, of the README, has
its frames at the times at which they were taken.
"""

import io
import itertools
import json
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from imuscope.recordings import sidecar
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.extensions.fleet.store.store import location
from imuscope.server.extensions.fleet.upload.upload import upload
from tests.browser.page_checks import click
from tests.conftest import READY
from tests.recordings.recorded_drive import drive
from tests.server.extensions.fleet.synthetic_fleet import SyntheticFleet
from tests.support import chromium
from tests.support.chromium import until
from tests.support.server_process import ROOT, ServerProcess
from tests.support.timeouts import PATIENCE_S

FOLDER = ROOT / "docs" / "guide" / "images"
WIDE, PHONE = (1440, 900), (390, 844)
COLOURS = 128
MAX_BYTES = 150_000
MOVING_SIZE, MOVING_S, MOVING_MAX_BYTES = (1120, 700), 5.0, 1_500_000
FILLED_S = 40  # the simulators have turned by then, and the window is full
RECORDED_S = 25
FIRST_DRIVE = 1_795_000_000  # unix s
WAIT_MS = 120_000
QUESTION = """SELECT minute, mean, axis, robot, recording
FROM minutes
WHERE quantity = 'acceleration' AND axis <> 'norm'
ORDER BY minute"""
DRAWN = "window.imuscopeReplay?.drawn.channels.value.some(channel => channel.ring.length > 20)"

Painter = Callable[["Studio"], None]
PAINTERS: dict[str, Painter] = {}


def picture(name: str) -> Callable[[Painter], Painter]:
    """Register a function that takes the picture of this name."""

    def register(painter: Painter) -> Painter:
        PAINTERS[name] = painter
        return painter

    return register


class Studio:
    """A browser, and one server for each list of sources."""

    def __init__(self, browser: Browser, folder: Path) -> None:
        self._browser = browser
        self.folder = folder
        self._servers: dict[tuple[str, ...], ServerProcess] = {}
        self._born: dict[tuple[str, ...], float] = {}
        self.recording = ""

    def server(self, *sources: str) -> ServerProcess:
        """The server of these sources; without any, with the simulators of a first start."""
        if sources not in self._servers:
            self._servers[sources] = ServerProcess(*sources, data=self.folder / str(len(self._servers)))
            self._born[sources] = time.monotonic()
        return self._servers[sources]

    @contextmanager
    def page(
        self, *sources: str, at: str = "", size: tuple[int, int] = WIDE, theme: str = "dark", filled_s: float = 0
    ) -> Iterator[Page]:
        """A page of that server; it is opened when the server has streamed for `filled_s`."""
        server = self.server(*sources)
        time.sleep(max(0.0, self._born[sources] + filled_s - time.monotonic()))
        with self.page_of(server.url, at, size, theme) as page:
            yield page

    @contextmanager
    def page_of(self, url: str, at: str = "", size: tuple[int, int] = WIDE, theme: str = "dark") -> Iterator[Page]:
        """A page of any server."""
        context = self._browser.new_context(
            viewport={"width": size[0], "height": size[1]},
            color_scheme="light" if theme == "light" else "dark",
            has_touch=size == PHONE,
        )
        context.add_init_script(chromium.NOT_THE_FIRST_MINUTE)
        page = context.new_page()
        page.goto(f"{url.rstrip('/')}/{at}")
        yield page
        context.close()

    def request(self, method: str, path: str, body: Any = None, sources: tuple[str, ...] = ()) -> Any:
        """One request to a server's API."""
        content = None if body is None else json.dumps(body).encode()
        address = self.server(*sources).url.rstrip("/") + path
        request = urllib.request.Request(address, content, {"content-type": "application/json"}, method=method)
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return json.loads(answer.read() or b"null")

    def recorded(self) -> str:
        """The id of a recording of all simulators, with markers and words."""
        if not self.recording:
            self.request("POST", "/api/recordings/start", {})
            for text in ("leaves the yard", "kerb"):
                time.sleep(RECORDED_S / 3)
                self.request("POST", "/api/recordings/mark", {"text": text})
            time.sleep(RECORDED_S / 3)
            self.request("POST", "/api/recordings/stop")
            self.recording = self.request("GET", "/api/recordings")[0]["id"]
            words = {"title": "Yard loop", "tags": ["calibrated"], "notes": "New mounting plate."}
            self.recording = self.request("PATCH", f"/api/recordings/{self.recording}", words)["id"]
        return self.recording

    def close(self) -> None:
        """End the servers."""
        for server in self._servers.values():
            server.stop()


def keep(page: Page, name: str, of: str = "", method: Image.Quantize = Image.Quantize.MEDIANCUT) -> None:
    """Write what the page, or one element of it, shows.

    Args:
        method: MAXCOVERAGE keeps colours of few pixels, such as marks of status in a long list.
    """
    time.sleep(1)
    data = page.locator(of).first.screenshot(timeout=WAIT_MS) if of else page.screenshot(timeout=WAIT_MS)
    image = Image.open(io.BytesIO(data)).convert("RGB")
    reduced = image.quantize(COLOURS, method=method, dither=Image.Dither.NONE)
    FOLDER.mkdir(parents=True, exist_ok=True)
    path = FOLDER / f"{name}.png"
    reduced.save(path, optimize=True)
    size = path.stat().st_size
    print(f"{path.relative_to(ROOT)}: {size} bytes", flush=True)
    if size > MAX_BYTES:
        sys.exit(f"{path.name} has more than {MAX_BYTES} bytes: show less of the page, or use fewer colours")


class Film:
    """Frames of a page while it is used, written as an animated WebP."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._frames: list[Image.Image] = []
        self._times: list[float] = []

    def roll(self, until_s: float, step: Callable[[float], None] = lambda share: None) -> None:
        """Take frames until the film is so long; `step` is called before each, with the share that has passed."""
        began = self._length()
        while (now := self._length()) < until_s:
            step((now - began) / (until_s - began))
            data = self._page.screenshot(timeout=WAIT_MS)
            self._times.append(time.monotonic())
            self._frames.append(Image.open(io.BytesIO(data)).convert("RGB"))

    def _length(self) -> float:
        return time.monotonic() - self._times[0] if self._times else 0.0

    def keep(self, name: str) -> None:
        """Write it, in the best quality that fits; the last frame stays for a second."""
        lasts_ms = [round(1000 * (after - at)) for at, after in itertools.pairwise(self._times)] + [1000]
        path = FOLDER / f"{name}.webp"
        for quality in (80, 65, 50, 35, 20):
            still, *others = self._frames
            still.save(path, save_all=True, append_images=others, duration=lasts_ms, loop=0, quality=quality, method=4)
            if (size := path.stat().st_size) <= MOVING_MAX_BYTES:
                print(f"{path.relative_to(ROOT)}: {size} bytes, {len(lasts_ms)} frames, quality {quality}", flush=True)
                return
        sys.exit(f"{path.name} has more than {MOVING_MAX_BYTES} bytes: show less of the page, or for a shorter time")


def configured(page: Page, shows: str) -> None:
    """Have the settings read, where they were not yet."""
    until(page, "document.querySelector('.settings-form h1') !== null")
    if page.get_by_role("button", name="Read settings").count():
        page.get_by_role("button", name="Read settings").click()
    until(page, f"document.querySelector({shows!r}) !== null")


# -- Live --------------------------------------------------------------------------------------------------------------


@picture("live-dark")
def live_dark(studio: Studio) -> None:
    with studio.page() as page:
        until(page, READY)
        time.sleep(FILLED_S)
        box = page.locator("#plots canvas").first.bounding_box()
        if box:
            page.mouse.move(box["x"] + 0.62 * box["width"], box["y"] + 0.5 * box["height"])
        keep(page, "live-dark")


@picture("tour")
def tour(studio: Studio) -> None:
    """What streams, and from a point to its bytes."""
    with studio.page(size=MOVING_SIZE, filled_s=FILLED_S) as page:
        until(page, READY)
        time.sleep(3)
        box = page.locator("#plots canvas").first.bounding_box()
        assert box
        film, y = Film(page), box["y"] + 0.5 * box["height"]
        film.roll(1.5)
        film.roll(3.0, lambda share: page.mouse.move(box["x"] + (0.9 - 0.4 * share) * box["width"], y))
        page.mouse.click(box["x"] + 0.5 * box["width"], y, button="right")
        film.roll(MOVING_S - 1)
        film.keep("tour")


@picture("live-light")
def live_light(studio: Studio) -> None:
    with studio.page(theme="light", filled_s=FILLED_S) as page:
        until(page, READY)
        time.sleep(3)
        keep(page, "live-light")


@picture("live-phone")
def live_phone(studio: Studio) -> None:
    with studio.page(size=PHONE, filled_s=FILLED_S) as page:
        until(page, READY)
        time.sleep(3)
        keep(page, "live-phone")


@picture("measure")
def two_cursors(studio: Studio) -> None:
    with studio.page(filled_s=FILLED_S) as page:
        until(page, READY)
        time.sleep(3)
        page.keyboard.press("Space")
        box = page.locator("#plots canvas").nth(1).bounding_box()
        assert box
        for share, key in ((0.35, []), (0.7, ["Shift"])):
            position = {"x": share * box["width"], "y": 0.5 * box["height"]}
            page.locator("#plots canvas").nth(1).click(position=position, modifiers=key, force=True)  # type: ignore[arg-type]
        page.mouse.move(5, 5)
        keep(page, "measure", ".centre")


@picture("health")
def health(studio: Studio) -> None:
    with studio.page("sim:xbus?drop=0.01&corrupt=0.005&burst_ms=16", size=(1440, 1500), filled_s=FILLED_S) as page:
        until(page, READY)
        time.sleep(20)
        keep(page, "health", "section.health")


@picture("fleet")
def fleet(studio: Studio) -> None:
    at = "#/fleet?robot=amr-552"
    with SyntheticFleet(1000, studio.folder / "fleet") as running, studio.page_of(running.url, at) as page:
        page.wait_for_selector(".fleet-row")
        page.wait_for_selector(".fleet-device")
        keep(page, "fleet", method=Image.Quantize.MAXCOVERAGE)


@picture("calibration")
def calibration(studio: Studio) -> None:
    source = "sim:xbus?motion=tumble&hard_iron=0.3&soft_iron=0.1"
    with studio.page(source, size=PHONE) as page:
        until(page, READY)
        page.locator(".bar .device-name").click()
        page.get_by_role("button", name="Calibrate", exact=True).click()
        click(page, "button", "Magnetometer", "document.querySelectorAll('.calibration-halves .seen').length > 20")
        keep(page, "calibration")


@picture("add-device")
def add_device(studio: Studio) -> None:
    with studio.page() as page:
        until(page, READY)
        page.locator("#rail .head button").first.click()
        until(page, "document.querySelector('[role=dialog], dialog') !== null")
        keep(page, "add-device", "[role=dialog], dialog")


# -- Configure ---------------------------------------------------------------------------------------------------------


@picture("configure")
def configure(studio: Studio) -> None:
    with studio.page("sim:xbus", at="#/configure/1/OutputConfiguration") as page:
        configured(page, 'tr[data-id="0x4020"] select')
        page.locator('tr[data-id="0x4020"] select').first.select_option("50")
        until(page, "document.querySelector('.hex-part.changed') !== null")
        page.hover('tr[data-id="0x4020"] td:nth-child(2)')
        keep(page, "configure")


@picture("temporary")
def temporary(studio: Studio) -> None:
    with studio.page("sim:xbus?seed=2", at="#/configure/1/PortConfig") as page:
        configured(page, "[data-field=words] select")
        page.locator("[data-field=words] select").first.select_option(label="921 600 Bd")
        page.locator(".apply-bar .btn.main").click()
        page.locator(".question-actions .btn.edge").click()
        until(page, "document.querySelector('[role=alertdialog]') !== null")
        time.sleep(2)
        keep(page, "temporary")


@picture("compare")
def compare(studio: Studio) -> None:
    sources = ("sim:xbus?seed=3",)
    with studio.page(*sources, at="#/configure/1/OutputConfiguration") as page:
        configured(page, 'tr[data-id="0x4020"] select')
        page.locator('tr[data-id="0x4020"] select').first.select_option("50")
        page.locator(".apply-bar .btn.main").click()
        until(page, "document.querySelector('nav[aria-label=Snapshots] a') !== null")
        until(page, "document.querySelector('.apply-bar progress, .apply-bar .spin') === null")
        time.sleep(5)
        page.locator("nav[aria-label=Snapshots] a").first.click()
        until(page, "document.querySelector('.compare table') !== null")
        keep(page, "compare")


@picture("comparing")
def comparing(studio: Studio) -> None:
    """Two devices on one axis of time, and their difference."""
    sources = tuple(f"sim:xbus?product=MTi-630&rate=100&seed={seed}" for seed in (1, 2))
    with studio.page(*sources, at="#/recordings?a=1&al=20&b=2&bl=20", size=(1440, 1000), filled_s=FILLED_S) as page:
        until(page, "document.querySelectorAll('.overlay-chart .difference path[d^=M]').length === 3")
        until(page, "document.querySelector('.compare-table') !== null")
        keep(page, "comparing")


@picture("corrections")
def corrections(studio: Studio) -> None:
    with studio.page("sim:xbus?product=MTi-680G", at="#/configure/1") as page:
        configured(page, "[data-setting], [data-command]")
        page.goto(page.url.partition("#")[0] + "#/configure/1/corrections")
        until(page, "document.querySelector('section[aria-label=Corrections] input') !== null")
        keep(page, "corrections", "section[aria-label=Corrections]")


# -- Recordings --------------------------------------------------------------------------------------------------------


DRIVES = (  # title, notes, tags
    ("", "", ()),
    ("Yard loop, new mast", "Three laps, kerb at the end. Tyre swapped after lap 2.", ("yard", "mast")),
    ("", "Vibration at 92 Hz, see marker", ("yard",)),
    ("", "", ("route",)),
    ("Warehouse A to C", "", ("route",)),
    ("", "", ()),
    ("Crane test", "Battery pulled at the end.", ("crane",)),
    ("", "", ("route",)),
)


@picture("library")
def library(studio: Studio) -> None:
    folder = studio.folder / "drives" / "recordings"
    folder.mkdir(parents=True)
    for n, (title, notes, tags) in enumerate(DRIVES):
        started = FIRST_DRIVE - n * 47_000
        path = folder / f"{datetime.fromtimestamp(started, UTC):%Y%m%dT%H%M%SZ}-MTi-630.mcap"
        drive(path, seconds=9.0 + 7 * n, started_ns=started * 10**9)
        sidecar.write(path, sidecar.Edits(title or path.stem, tags, notes))
    with ServerProcess("udp://:0", data=folder.parent) as server, studio.page_of(server.url, "#/recordings") as page:
        until(page, f"document.querySelectorAll('.recording-list canvas').length === {len(DRIVES)}")
        page.locator(".recording-list tbody tr [data-column=length]").nth(1).click()
        page.locator(".recording-list tbody tr [data-column=length]").nth(3).click(modifiers=["Control"])
        until(page, "document.querySelector('.selection-bar') !== null")
        time.sleep(1)
        keep(page, "library")


@contextmanager
def opened(studio: Studio) -> Iterator[Page]:
    """The recording in the player."""
    recording = studio.recorded()
    with studio.page(at=f"#/recordings/{recording}") as page:
        until(page, DRAWN)
        time.sleep(3)
        yield page


@picture("replay")
def replay(studio: Studio) -> None:
    with opened(studio) as page:
        page.locator(".markers li button").last.click()
        time.sleep(1)
        page.keyboard.press("+")
        time.sleep(2)
        keep(page, "replay")


@picture("export")
def export(studio: Studio) -> None:
    with opened(studio) as page:
        page.locator(".hand-over .btn.edge").first.click()
        until(page, "document.querySelector('.formats') !== null")
        time.sleep(3)
        keep(page, "export", "[role=dialog], dialog")


@picture("evidence")
def evidence(studio: Studio) -> None:
    """The file itself, with both cursors."""
    with opened(studio) as page:
        page.keyboard.press("e")
        click(page, "button", "Make the file", "document.querySelector('dialog .jobs a') !== null")
        with page.expect_download() as coming:
            page.locator("dialog .jobs a").click()
        page.goto(Path(coming.value.path()).rename(studio.folder / "evidence.html").as_uri())
        until(page, "document.querySelectorAll('.plot canvas').length > 2")
        canvas = page.locator(".plot canvas").first
        canvas.click(position={"x": 500, "y": 60})
        canvas.click(position={"x": 760, "y": 60}, modifiers=["Shift"])
        page.mouse.move(5, 5)
        keep(page, "evidence")


@picture("questions")
def questions(studio: Studio) -> None:
    """The drives of a store, and the mean of each minute over time."""
    store = studio.folder / "store"
    for n in range(6):
        path = studio.folder / f"drive-{n}.mcap"
        drive(path, 240 + 60 * n, started_ns=1_760_000_000_000_000_000 + n * 7200 * 10**9)
        upload(path, location(str(store)), f"otter-{n % 3}", DecodeOptions())
    server = ServerProcess("sim:xbus", data=studio.folder / "questions", arguments=("--store", str(store)))
    try:
        with studio.page_of(server.url, "#/questions") as page:
            page.get_by_label("Question in SQL").fill(QUESTION)
            page.get_by_role("button", name="Run").click()
            click(page, "button", "Plot", "document.querySelectorAll('.answer-chart .points').length > 2", exact=True)
            page.evaluate(  # not the temporary folder of this program
                "place => { document.querySelector('.question-store').textContent = `Recordings in ${place}`; }",
                "s3://robots/drives",
            )
            keep(page, "questions")
    finally:
        server.stop()


def main() -> None:
    """The command line."""
    path = chromium.required()
    expected = sys.argv[1:] or list(PAINTERS)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=chromium.ARGUMENTS)
        studio = Studio(browser, Path(folder))
        try:
            for name in expected:
                PAINTERS[name](studio)
        finally:
            studio.close()
            browser.close()


if __name__ == "__main__":
    main()
