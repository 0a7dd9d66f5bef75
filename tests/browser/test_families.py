"""Pages of Inertial Sense and IDTP devices, with real servers: track, map, keys, vendor payloads.

What needs no browser (attitude, satellites, position, marks of trust) is tested in web/src/pages/live.test.tsx.
"""

from __future__ import annotations

import struct
import threading
import zlib
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import serious
from tests.chromium import until
from tests.conftest import READY
from tests.server_process import ServerProcess
from tests.waiting import block_until
from tests.wire_scenes import Sensors, free_port

Serve = Callable[..., ServerProcess]
OpenPage = Callable[..., Page]

SELECT = "id => { window.imuscope.view.value = {...window.imuscope.view.value, device: id}; }"


@pytest.fixture(scope="module")
def families(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A server with an IMX-5 and three IDTP devices, of which 3 and 4 lack a key; 4 is shown all the same."""
    data = tmp_path_factory.mktemp("data")
    sources = ("sim:isb", "sim:idtp", "sim:idtp?mode=secure", "sim:idtp?mode=secure&unverified=1")
    with ServerProcess(*sources, data=data) as process:
        yield process


def looking_at(page: Page, device: str) -> None:
    until(page, "window.imuscope?.store.devices.value.length >= 4")
    page.evaluate(SELECT, device)


def eventually(page: Page, true: Callable[[], object], last: object = None) -> None:
    """Wait for a condition of the page in several steps; `last` is its last value if it does not hold."""
    block_until(lambda: page.evaluate("true") and true(), str(last))


def test_the_track_opens_large_without_a_map_and_switching_is_instant(
    families: ServerProcess, open_page: OpenPage
) -> None:
    page = open_page(families.url)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    looking_at(page, "1")
    until(page, READY)
    until(page, "/3D/.test(document.querySelector('.gnss .caption')?.innerText)")
    button = page.get_by_role("button", name="Enlarge the track")
    button.focus()
    page.keyboard.press("Enter")
    dialog = page.get_by_role("dialog", name="Track of")
    dialog.wait_for()
    until(page, "/sat/.test(document.querySelector('.track-summary')?.innerText)")
    canvas = dialog.locator("canvas")
    drawn = """canvas => { const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        let n = 0; for (let k = 3; k < data.length; k += 4) n += data[k] > 200; return n; }"""
    canvas.wait_for()
    until(page, f"({drawn})(document.querySelector('[role=dialog] canvas, dialog canvas')) > 100")
    dialog.get_by_role("button", name="Zoom in").click()
    canvas.focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("0")
    eventually(page, lambda: [url for url in asked if "/api/map" in url])
    assert serious(page, "document.querySelector('[role=dialog], dialog')") == []
    assert not [url for url in asked if "/tiles/" in url]
    assert page.get_by_role("button", name="Map", exact=True).count() == 0
    page.keyboard.press("Escape")
    dialog.wait_for(state="detached")
    assert page.evaluate("document.activeElement.className") == "enlarge"

    # Counted in frames of the page instead of time, because the first requests take longer.
    frames = """async ([name, frame]) => {
      [...document.querySelectorAll(".device .choose-device")].find(e => e.innerText.includes(name)).click();
      for (let n = 1; n < 200; n++) {
        await new Promise(requestAnimationFrame);
        if (document.querySelector(".numerals .segmented [aria-pressed=true]")?.innerText === frame) return n;
      }
    }"""
    for name, frame in (("IDTP", "ENU"), ("IMX", "NED"), ("IDTP", "ENU")):
        assert page.evaluate(frames, [name, frame]) < 10


class MapServer(BaseHTTPRequestHandler):
    """A tile server: every tile is one square of magenta, a colour that the page has nowhere else."""

    asked: ClassVar[list[str]] = []

    def do_GET(self) -> None:
        self.asked.append(self.path)
        self.send_response(200)
        self.send_header("content-type", "image/png")
        self.send_header("content-length", str(len(MAGENTA)))
        self.end_headers()
        self.wfile.write(MAGENTA)

    def log_message(self, *args: Any) -> None:
        return


def png(red: int, green: int, blue: int, size: int = 256) -> bytes:
    """A square of one colour."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = (b"\0" + bytes((red, green, blue)) * size) * size
    head = struct.pack(">IIBBBBB", size, size, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


MAGENTA = png(255, 0, 255)
COVERED = """canvas => { const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    let n = 0, of = 0;  // of every seventh pixel
    for (let k = 0; k < data.length; k += 28, of++) n += data[k] > 150 && data[k + 1] < 60 && data[k + 2] > 150;
    return n / of; }"""


def test_a_map_lies_under_the_track_where_a_tile_server_is_configured(
    serve: Serve, open_page: OpenPage, tmp_path: Path
) -> None:
    with ThreadingHTTPServer(("127.0.0.1", 0), MapServer) as maps:
        threading.Thread(target=maps.serve_forever, daemon=True).start()
        config = tmp_path / "imuscope.toml"
        address = f"http://127.0.0.1:{maps.server_port}/{{z}}/{{x}}/{{y}}.png"
        config.write_text(f'[map]\ntiles = "{address}"\nattribution = "© the survey"\n')
        page = open_page(serve("sim:isb", arguments=("--config", str(config))).url, width=1000, height=600)
        until(page, "/3D/.test(document.querySelector('.gnss .caption')?.innerText)")
        page.get_by_role("button", name="Enlarge the track").click()
        until(page, "document.querySelector('.attribution')?.innerText.includes('the survey')")
        canvas = page.locator(".track-box canvas")
        eventually(page, lambda: canvas.evaluate(COVERED) > 0.9)

        def shows_four_tiles_further_out() -> bool:
            """At rest the whole track is within one tile; further out it is where four meet."""
            page.get_by_role("button", name="Zoom out", exact=True).click()
            return len(MapServer.asked) >= 4

        eventually(page, shows_four_tiles_further_out)
        eventually(page, lambda: canvas.evaluate(COVERED) > 0.9)
        assert len(MapServer.asked) < 200
        assert len(MapServer.asked) == len(set(MapServer.asked)), "each is asked for once"
        page.get_by_role("button", name="Map", exact=True).click()
        eventually(page, lambda: canvas.evaluate(COVERED) == 0)
        maps.shutdown()


def test_trust_is_shown_and_a_key_given_later_keeps_earlier_data(families: ServerProcess, open_page: OpenPage) -> None:
    page = open_page(families.url)
    looking_at(page, "2")
    until(page, "document.querySelector('.device[aria-current] .trust')?.dataset.trust === 'verified'")
    assert "Safety, CRC-32" in page.locator(".device[aria-current] .trust").inner_text()
    looking_at(page, "3")
    band = page.locator("[data-key=wanted]")
    until(page, "/Secure frames? rejected/.test(document.querySelector('[data-key=wanted]')?.innerText ?? '')")
    assert "--key" in band.inner_text()
    band.get_by_role("button", name="Enter key").click()
    field = page.get_by_label("Key for Secure frames")
    assert field.get_attribute("type") == "password"
    field.fill("not hex")
    page.get_by_role("button", name="Use this key").click()
    assert "hex" in page.get_by_role("alert").inner_text()
    key = "00112233445566778899aabbccddeeff"
    field.fill(key)
    page.get_by_role("button", name="Use this key").click()
    until(page, "document.querySelector('.device[aria-current] .trust')?.innerText.includes('Secure')")
    assert page.locator(".device[aria-current] .trust").get_attribute("data-trust") == "verified"
    until(page, "document.querySelector('[data-key=wanted]') === null")
    assert page.evaluate("window.imuscope.view.value.device") == "3", "it is the same device"
    assert page.locator(".device").filter(has_text="sim:idtp").count() == 3
    assert key not in page.content()

    looking_at(page, "4")
    until(page, "document.querySelector('.trust-mark')?.innerText === '▲ unverified'")
    oldest = """() => window.imuscope.store.channels.value
        .filter(({info, ring}) => info.device === "4" && info.name === "Quaternion?" && ring.length)
        .map(({ring}) => ring.time(0))[0]"""
    before = page.evaluate(oldest)
    page.get_by_role("button", name="Enter key").click()
    page.get_by_label("Key for Secure frames").fill("00112233445566778899aabbccddeeff")
    page.get_by_role("button", name="Use this key").click()
    until(page, "document.querySelector('.trust-mark')?.innerText === '● verified'")
    assert page.evaluate(oldest) == before, "what came before the key is still there"
    assert page.evaluate("window.imuscope.view.value.device") == "4"
    shown = page.locator(".legend b").all_inner_texts()
    assert shown
    assert not [text for text in shown if "▲" in text], "what is shown from here on is verified"


@pytest.fixture
def sensors() -> Any:
    thread = Sensors(free_port())
    thread.start()
    yield thread.port
    thread.stop()


def test_raw_payloads_are_shown_and_can_be_described(serve: Serve, open_page: OpenPage, sensors: int) -> None:
    page = open_page(serve(f"udp://:{sensors}").url)
    until(page, "window.imuscope?.store.unknownPayloads.value.length > 0")
    page.locator(".device .choose-device", has=page.get_by_text("IDTP device 9", exact=True)).click()
    panel = page.get_by_role("region", name="Raw payloads")
    until(page, "/06 FF/.test(document.querySelector('.hex')?.innerText)")  # the high byte of −250
    assert "0x80" in panel.inner_text()
    assert "4 B" in panel.inner_text()
    until(page, "document.querySelector('.hex mark') !== null")
    assert page.locator(".hex div").count() == 1
    assert serious(page, "document.querySelector('.side')") == []
    panel.get_by_role("button", name="Define payload").click()
    text = page.get_by_label("Fields, in byte order")
    until(page, "document.querySelector('textarea')?.value.includes('count = 2')")
    text.fill(text.input_value().replace('unit = ""', 'unit = "m/s"').replace("scale = 1.0", "scale = 0.001"))
    page.get_by_role("button", name="Use this definition").click()
    until(page, "[...document.querySelectorAll('.legend b')].some(b => b.innerText.startsWith('Values'))")
    values = """() => { const channel = window.imuscope.store.channels.value.find(({info}) => info.name === "Values");
        return channel && channel.ring.value(1, channel.ring.length - 1); }"""
    until(page, f"Math.abs(({values})() + 0.25) < 1e-6")
