"""What Inertial Sense and IDTP devices add to the page, with real servers: attitude, satellites, track, trust.

The attitude is checked with one that is known: nose 12° up, right side 20° down, heading 70°, written here by the
textbook in the form that each message has (angles in NED, quaternions from body to NED, to ENU, to the earth's axes).
"""

from __future__ import annotations

import math
import socket
import struct
import threading
import time
import zlib
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from playwright.sync_api import Page

from protocols.idtp.frames import build as idtp_frame
from protocols.idtp.simulator import IdtpSimulator
from protocols.isb.frames import DATA
from protocols.isb.frames import build as isb_frame
from tests.browser.test_capture import number
from tests.browser.test_page import TARGETS, serious
from tests.chromium import until
from tests.conftest import READY
from tests.server_process import ServerProcess
from tests.timeouts import PATIENCE_S

Serve = Callable[..., ServerProcess]
OpenPage = Callable[..., Page]

HEADING, NOSE_UP, RIGHT_DOWN = 70.0, 12.0, 20.0
PLACE = (52.22, 6.89)
FRAMES = 600
WEEK, TOW_S = 2445, 100_000.0

SELECT = "id => { window.imuscope.view.value = {...window.imuscope.view.value, device: id}; }"
SHOWN = """() => Object.fromEntries(
    [...document.querySelectorAll("[data-numeral]")].map(n => [n.dataset.numeral, n.innerText.trim()]))"""


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Scalar first, of angles in ° turned in the order yaw, pitch, roll."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in np.radians([roll, pitch, yaw]) / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def product(p: tuple[float, ...], q: tuple[float, ...]) -> tuple[float, ...]:
    """p ⊗ q."""
    (a, b, c, d), (e, f, g, h) = p, q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


NED = quaternion(RIGHT_DOWN, NOSE_UP, HEADING)
"""Body forward, right, down."""
ENU = quaternion(RIGHT_DOWN, -NOSE_UP, 90 - HEADING)
"""Body forward, left, up: positive pitch is nose down."""
# The earth's axes turned by the longitude about z, then by 90° and the latitude about −y, are north, east, down.
ECEF = product(product(quaternion(0, 0, PLACE[1]), quaternion(0, -90 - PLACE[0], 0)), NED)


def ecef_position() -> tuple[float, float, float]:
    """Where PLACE is, at height 0."""
    lat, lon = np.radians(PLACE)
    e2 = 0.0066943799901413165
    n = 6378137.0 / math.sqrt(1 - e2 * math.sin(lat) ** 2)
    return n * math.cos(lat) * math.cos(lon), n * math.cos(lat) * math.sin(lon), n * (1 - e2) * math.sin(lat)


def ins(did: int, *tail: bytes) -> bytes:
    """A file of one INS message at 100 Hz."""
    out = b""
    for k in range(FRAMES):
        head = struct.pack("<IdII", WEEK, TOW_S + k / 100, 0x0008_0000 | 3 << 16, 0)
        out += isb_frame(DATA, did, head + b"".join(tail))
    return out


def ins_1() -> bytes:
    angles = struct.pack("<3f", *np.radians([RIGHT_DOWN, NOSE_UP, HEADING]))
    return ins(4, angles, struct.pack("<3f", 1, 0, 0), struct.pack("<3d", *PLACE, 60), struct.pack("<3f", 0, 0, 0))


def ins_2() -> bytes:
    return ins(5, struct.pack("<4f", *NED), struct.pack("<3f", 1, 0, 0), struct.pack("<3d", *PLACE, 60))


def ins_4() -> bytes:
    return ins(66, struct.pack("<4f", *ECEF), struct.pack("<3f", 0, 0, 0), struct.pack("<3d", *ecef_position()))


def imu_quat() -> bytes:
    payload = struct.pack("<4f", *ENU)
    return b"".join(
        idtp_frame(6, payload, sequence=k + 1, timestamp=10_000 * k, mode=1, device=7) for k in range(FRAMES)
    )


@pytest.mark.parametrize(
    ("make", "frame", "source", "pitch"),
    [
        (ins_1, "NED", "from INS 1", NOSE_UP),
        (ins_2, "NED", "from INS 2", NOSE_UP),
        (ins_4, "NED", "from INS 4", NOSE_UP),
        (imu_quat, "ENU", "from quaternion", -NOSE_UP),
    ],
    ids=["INS_1", "INS_2", "INS_4", "IDTP"],
)
def test_the_attitude_is_right_in_every_form(
    serve: Serve, open_page: OpenPage, tmp_path: Path, make: Callable[[], bytes], frame: str, source: str, pitch: float
) -> None:
    path = tmp_path / "attitude.bin"
    path.write_bytes(make())
    page = open_page(serve(f"{path}?loop=1").url)
    until(page, READY)
    until(page, "/\\d/.test(document.querySelector('[data-numeral=heading]')?.innerText)")
    expected = pytest.approx({"heading": HEADING, "roll": RIGHT_DOWN, "pitch": pitch}, abs=0.06)
    shown: dict[str, str] = {}

    def is_right() -> bool:
        shown.update(page.evaluate(SHOWN))
        return all(map(str.strip, shown.values())) and {n: number(text) for n, text in shown.items()} == expected

    eventually(page, is_right, shown)
    assert page.locator(".nums .seg [aria-pressed=true]").inner_text() == frame
    assert page.locator(".nums .from").inner_text() == source


@pytest.fixture(scope="module")
def families(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A server with three devices: 1 an IMX-5, 2 an IDTP device, 3 one whose key nobody has given."""
    data = tmp_path_factory.mktemp("data")
    with ServerProcess("twin:isb", "twin:idtp", "twin:idtp?mode=secure", data=data) as process:
        yield process


def looking_at(page: Page, device: str) -> None:
    until(page, "window.imuscope?.store.devices.value.length >= 3")
    page.evaluate(SELECT, device)


SKY = """() => {
  const channel = window.imuscope.store.channels.value.find(c => c.info.name.includes("GPS1_SAT"));
  const {ring, info} = channel, at = name => info.columns.findIndex(c => c.name === name), last = ring.length - 1;
  const sent = [];
  for (let k = last; k >= 0 && ring.arrival(k) === ring.arrival(last); k--)
    sent.push([ring.value(at("svId"), k), ring.value(at("cno"), k), (ring.value(at("status"), k) >> 3) & 1]);
  const rows = [...document.querySelectorAll(".sky tr[data-use]")].map(row => [...row.cells]);
  const shown = rows.map(([id, bar, strength, use]) =>
    [+id.innerText.replace(/\\D/g, ""), +strength.firstChild.data, use.innerText.trim() === "used" ? 1 : 0]);
  return {sent, shown};
}"""


def eventually(page: Page, true: Callable[[], object], last: object = None) -> None:
    """Wait for what is asked of the page in several steps; `last` tells what it was when it does not come."""
    deadline = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < deadline, last
        page.wait_for_timeout(100)


def test_satellites_are_those_that_were_sent(families: ServerProcess, open_page: OpenPage) -> None:
    page = open_page(families.url)
    looking_at(page, "1")
    until(page, "document.querySelectorAll('.sky tr[data-use]').length > 5")

    def agree() -> bool:
        sky = page.evaluate(SKY)
        return sorted(sky["sent"]) == sorted(sky["shown"])

    eventually(page, agree)
    table = page.get_by_role("table", name="Satellites by constellation")
    assert table.get_by_role("rowheader").count() == len(page.evaluate(SKY)["shown"])
    assert "used" in table.inner_text()
    looking_at(page, "2")  # a device without a receiver has no such panel, and one is not left behind
    until(page, "document.querySelector('.sky') === null")


def test_the_track_opens_large(families: ServerProcess, open_page: OpenPage) -> None:
    page = open_page(families.url)
    looking_at(page, "1")
    button = page.get_by_role("button", name="Track within the window")
    button.focus()
    page.keyboard.press("Enter")
    dialog = page.get_by_role("dialog", name="Track of")
    dialog.wait_for()
    until(page, "/sat/.test(document.querySelector('.trackline')?.innerText)")
    canvas = dialog.locator("canvas")
    drawn = """canvas => { const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        let n = 0; for (let k = 3; k < data.length; k += 4) n += data[k] > 200; return n; }"""
    assert canvas.evaluate(drawn) > 100
    dialog.get_by_role("button", name="Zoom in").click()
    canvas.focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("0")
    assert serious(page) == []
    page.keyboard.press("Escape")
    dialog.wait_for(state="detached")
    assert page.evaluate("document.activeElement.className") == "enlarge"


class Maps(BaseHTTPRequestHandler):
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
    with ThreadingHTTPServer(("127.0.0.1", 0), Maps) as maps:
        threading.Thread(target=maps.serve_forever, daemon=True).start()
        config = tmp_path / "imuscope.toml"
        address = f"http://127.0.0.1:{maps.server_port}/{{z}}/{{x}}/{{y}}.png"
        config.write_text(f'[map]\ntiles = "{address}"\nattribution = "© the survey"\n')
        page = open_page(serve("twin:isb", arguments=("--config", str(config))).url)
        until(page, "/3D/.test(document.querySelector('.gnss .cap')?.innerText)")
        page.get_by_role("button", name="Track within the window").click()
        until(page, "document.querySelector('.attribution')?.innerText.includes('the survey')")
        canvas = page.locator(".trackbox canvas")
        eventually(page, lambda: canvas.evaluate(COVERED) > 0.9)
        for _ in range(8):  # at rest all of it is within one tile
            page.get_by_role("button", name="Zoom out", exact=True).click()
            page.wait_for_timeout(150)
        eventually(page, lambda: canvas.evaluate(COVERED) > 0.9)
        assert 4 <= len(Maps.asked) < 200  # a short track lies where four tiles meet
        assert len(Maps.asked) == len(set(Maps.asked)), "each is asked for once"
        page.get_by_role("button", name="Map", exact=True).click()
        eventually(page, lambda: canvas.evaluate(COVERED) == 0)
        maps.shutdown()


def test_without_a_tile_server_none_is_asked(families: ServerProcess, open_page: OpenPage) -> None:
    page = open_page(families.url)
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    looking_at(page, "1")
    until(page, "/3D/.test(document.querySelector('.gnss .cap')?.innerText)")
    page.get_by_role("button", name="Track within the window").click()
    eventually(page, lambda: [url for url in asked if "/api/map" in url])
    page.wait_for_timeout(1500)
    assert not [url for url in asked if "/tiles/" in url]
    assert page.get_by_role("button", name="Map", exact=True).count() == 0


def test_position_and_status_without_set_up(families: ServerProcess, open_page: OpenPage) -> None:
    page = open_page(families.url)
    looking_at(page, "1")
    until(page, "/3D · \\d+ sat/.test(document.querySelector('.gnss .cap')?.innerText)")
    names = page.locator(".lanenames").inner_text()
    assert "Solution" in names
    assert "Fix" in names
    assert names.count("\n") < 14
    before = page.locator(".lanenames button").count()
    page.get_by_role("button", name="more lane").click()
    assert page.locator(".lanenames button").count() > before
    page.get_by_role("button", name="Fewer lanes").click()
    assert "Velocity" in page.locator(".leg b").all_inner_texts()[-1]
    page.locator(".more summary", has_text="GPS1 position").click()
    page.locator(".more").get_by_role("button", name="Height above sea level").click()
    until(page, "[...document.querySelectorAll('.leg b')].some(b => b.innerText.startsWith('Height above'))")


def test_trust_is_shown_and_a_key_is_asked_for(serve: Serve, open_page: OpenPage) -> None:
    server = serve("twin:isb", "twin:idtp", "twin:idtp?mode=secure")
    page = open_page(server.url)
    looking_at(page, "2")
    until(page, "document.querySelector('.dev[aria-current] .trust')?.dataset.trust === 'verified'")
    assert "Safety, CRC-32" in page.locator(".dev[aria-current] .trust").inner_text()
    looking_at(page, "3")
    band = page.locator("[data-key=wanted]")
    until(page, "/Secure frames? rejected/.test(document.querySelector('[data-key=wanted]')?.innerText ?? '')")
    assert "--key" in band.inner_text()
    band.get_by_role("button", name="Give the key").click()
    field = page.get_by_label("Key for Secure frames")
    assert field.get_attribute("type") == "password"
    field.fill("not hex")
    page.get_by_role("button", name="Use this key").click()
    assert "hex" in page.get_by_role("alert").inner_text()
    key = "00112233445566778899aabbccddeeff"
    field.fill(key)
    page.get_by_role("button", name="Use this key").click()
    until(page, "document.querySelector('.dev[aria-current] .trust')?.innerText.includes('Secure')")
    assert page.locator(".dev[aria-current] .trust").get_attribute("data-trust") == "verified"
    until(page, "document.querySelector('[data-key=wanted]') === null")
    assert page.evaluate("window.imuscope.view.value.device") == "3", "it is the same device"
    assert page.locator(".dev").filter(has_text="twin:idtp").count() == 2
    assert key not in page.content()


def test_unverified_data_are_marked_wherever_they_are(serve: Serve, open_page: OpenPage) -> None:
    server = serve("twin:idtp?mode=secure&unverified=1")
    page = open_page(server.url)
    until(page, READY)
    until(page, "document.querySelector('.dev .trust')?.dataset.trust === 'unverified'")
    assert page.locator("[data-key=wanted]").count() == 1
    legends = page.locator(".leg b").all_inner_texts()
    assert legends
    assert all("▲" in text for text in legends)
    groups = page.locator(".vals tr.g").all_inner_texts()
    assert all("▲ unverified" in text for text in groups)
    assert page.locator(".nums .trustmark").inner_text() == "▲ unverified"
    until(page, "/unverified\\s*▲/.test(document.querySelector('.hl')?.innerText)")


def test_a_key_given_later_keeps_what_came_before(serve: Serve, open_page: OpenPage) -> None:
    page = open_page(serve("twin:idtp?mode=secure&unverified=1").url)
    until(page, READY)
    until(page, "document.querySelector('.trustmark')?.innerText === '▲ unverified'")
    oldest = """() => window.imuscope.store.channels.value
        .filter(({info, ring}) => info.name === "Quaternion?" && ring.length).map(({ring}) => ring.time(0))[0]"""
    before = page.evaluate(oldest)
    page.get_by_role("button", name="Give the key").click()
    page.get_by_label("Key for Secure frames").fill("00112233445566778899aabbccddeeff")
    page.get_by_role("button", name="Use this key").click()
    until(page, "document.querySelector('.trustmark')?.innerText === '● verified'")
    assert page.evaluate(oldest) == before, "what came before the key is still there"
    assert page.evaluate("window.imuscope.view.value.device") == "1"
    shown = page.locator(".leg b").all_inner_texts()
    assert shown
    assert not [text for text in shown if "▲" in text], "what is shown from here on is verified"


class Sensors(threading.Thread):
    """Two IDTP devices that send to one UDP port, one of them payloads of its vendor's own types too."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.port = port
        self.devices = {7: IdtpSimulator(device_id=7), 102: IdtpSimulator(device_id=102, mode=0, rate=50)}
        self.stopped = threading.Event()

    def run(self) -> None:
        began, k = time.monotonic_ns(), 0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            while not self.stopped.wait(0.02):
                now = time.monotonic_ns() - began
                for device in self.devices.values():
                    for part in device.advance(now).split(b"IDTP")[1:]:
                        link.sendto(b"IDTP" + part, ("127.0.0.1", self.port))
                k += 1
                payload = struct.pack("<hh", 1000 + k % 100, -250)
                stamp = now // 1000 & 0xFFFF_FFFF
                link.sendto(
                    idtp_frame(0x80, payload, sequence=k, timestamp=stamp, mode=1, device=9), ("127.0.0.1", self.port)
                )


@pytest.fixture
def sensors() -> Any:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    thread = Sensors(port)
    thread.start()
    yield port
    thread.stopped.set()
    thread.join()


def test_devices_that_share_a_link_are_looked_at_one_by_one(serve: Serve, open_page: OpenPage, sensors: int) -> None:
    page = open_page(serve(f"udp://:{sensors}").url)
    until(page, "document.querySelectorAll('.dev .pick').length >= 3")
    names = page.locator(".devs .dev b").all_inner_texts()
    assert sorted(names) == ["IDTP device 102", "IDTP device 7", "IDTP device 9"]
    assert page.locator(".dev.sibling").count() == 2
    for name, protection, rate in (("IDTP device 7", "verified", 100), ("IDTP device 102", "not protected", 50)):
        page.locator(".dev .pick", has=page.get_by_text(name, exact=True)).click()
        until(page, f"document.querySelector('.trustmark')?.innerText.includes('{protection}')")
        until(page, "/\\d/.test(document.querySelector('[data-numeral=heading]')?.innerText)")
        figures = (
            """() => { const {store, view} = window.imuscope; return store.health.value.get(view.value.device); }"""
        )
        until(page, f"Math.abs(({figures})().rate - {rate}) < 8")
    own = page.evaluate(
        """() => { const {store, view} = window.imuscope, mine = ({info}) => info.device === view.value.device;
        return store.channels.value.filter(mine).map(({info}) => info.name); }"""
    )
    assert len(own) == len(set(own))
    page.get_by_role("button", name="Remove the link").click()
    assert "all 3 devices" in page.locator(".acts").inner_text()
    page.get_by_role("button", name="Remove", exact=True).click()
    until(page, "document.querySelectorAll('.dev .pick').length === 0 || !document.querySelector('.devs')")


def test_raw_payloads_are_shown_and_can_be_described(serve: Serve, open_page: OpenPage, sensors: int) -> None:
    page = open_page(serve(f"udp://:{sensors}").url)
    until(page, "window.imuscope?.store.raws.value.length > 0")
    page.locator(".dev .pick", has=page.get_by_text("IDTP device 9", exact=True)).click()
    panel = page.get_by_role("region", name="Raw payloads")
    until(page, "/06 FF/.test(document.querySelector('.hex')?.innerText)")  # the high byte of −250
    assert "0x80" in panel.inner_text()
    assert "4 B" in panel.inner_text()
    until(page, "document.querySelector('.hex mark') !== null")
    assert page.locator(".hex div").count() == 1
    assert serious(page, "document.querySelector('.side')") == []
    panel.get_by_role("button", name="Describe this type").click()
    text = page.get_by_label("Its fields, in the order of the bytes")
    until(page, "document.querySelector('textarea')?.value.includes('count = 2')")
    text.fill(text.input_value().replace('unit = ""', 'unit = "m/s"').replace("scale = 1.0", "scale = 0.001"))
    page.get_by_role("button", name="Use this description").click()
    until(page, "[...document.querySelectorAll('.leg b')].some(b => b.innerText.startsWith('Values'))")
    values = """() => { const channel = window.imuscope.store.channels.value.find(({info}) => info.name === "Values");
        return channel && channel.ring.value(1, channel.ring.length - 1); }"""
    until(page, f"Math.abs(({values})() + 0.25) < 1e-6")


@pytest.mark.parametrize("size", [(1440, 900), (390, 844)], ids=["desktop", "phone"])
@pytest.mark.parametrize("device", ["1", "2", "3"])
def test_the_standard_holds_for_them(
    families: ServerProcess, open_page: OpenPage, size: tuple[int, int], device: str
) -> None:
    """Nothing serious from axe, no sideways scrolling, and a finger hits every control."""
    phone = size[0] < 721
    page = open_page(families.url, width=size[0], height=size[1], touch=phone)
    looking_at(page, device)
    page.wait_for_timeout(1200)
    assert serious(page) == []
    assert page.evaluate("document.scrollingElement.scrollWidth") <= size[0]
    if phone:
        small = page.evaluate(TARGETS)
        assert not small, "\n".join(small)


def test_switching_is_instant(families: ServerProcess, open_page: OpenPage) -> None:
    page = open_page(families.url)
    looking_at(page, "1")
    until(page, READY)
    # Counted in frames of the page, not in time: what is asked for first would come some later.
    frames = """async ([name, frame]) => {
      [...document.querySelectorAll(".dev .pick")].find(e => e.innerText.includes(name)).click();
      for (let n = 1; n < 200; n++) {
        await new Promise(requestAnimationFrame);
        if (document.querySelector(".nums .seg [aria-pressed=true]")?.innerText === frame) return n;
      }
    }"""
    for name, frame in (("IDTP", "ENU"), ("IMX", "NED"), ("IDTP", "ENU")):
        assert page.evaluate(frames, [name, frame]) < 10
