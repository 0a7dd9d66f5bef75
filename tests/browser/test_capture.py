"""A real capture in a real browser: the attitude on the page is that of the capture.

The expected angles are worked out here from the quaternions of the capture's published values, by the textbook formula,
with nothing of the product in between: bytes, decoder, wire, rings, derived channel, cursor and table must all be right
for the numbers on the page to agree.
"""

import json
import math
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import drawn
from tests.support.chromium import until
from tests.support.server_process import ServerProcess
from tests.support.waiting import block_until

TIMES = (0.1, 0.3, 0.5, 0.7, 0.9)  # as a share of the capture

# Of the samples with angles the one whose packet counter is nearest (a page that is held up misses some): where
# it stands in time, and the derived angles.
FIND = """counter => {
  const {store} = window.imuscope, of = name => store.channels.value.find(channel => channel.info.name === name);
  const counters = of("PacketCounter").ring, euler = of("EulerAngles");
  const away = i => i < 0 ? Infinity : Math.abs(counters.value(0, i) - counter);
  const angledAt = time => euler.ring.time(euler.ring.indexAt(time + 1e-4, "device"));
  const angled = i => Math.abs(angledAt(counters.time(i)) - counters.time(i)) < 1e-4;
  let found = -1;
  for (let i = 0; i < counters.length; i++) if (away(i) < away(found) && angled(i)) found = i;
  if (found < 0) return null;
  const time = counters.time(found) + 1e-4, at = euler.ring.indexAt(time, "device");
  const angles = Object.fromEntries(euler.info.columns.map((c, k) => [c.name, euler.ring.value(k, at)]));
  return {counter: counters.value(0, found), time, angles};
}"""
# What is written on the page: the three rows under "Euler angles", and the numerals beside the horizon.
SHOWN = """() => {
  const rows = [...document.querySelectorAll("table.values-table tr")], shown = {};
  const start = rows.findIndex(row => row.className === "group-row" && /^Euler angles/.test(row.innerText.trim()));
  for (const {cells} of rows.slice(start + 1, start + 4)) shown[cells[0].innerText.trim()] = cells[1].innerText.trim();
  for (const numeral of document.querySelectorAll("[data-numeral]"))
    shown["numeral " + numeral.dataset.numeral] = numeral.innerText.trim();
  return shown;
}"""
COUNTERS = """() => { const c = window.imuscope.store.channels.value.find(c => c.info.name === "PacketCounter");
  return Array.from({length: c.ring.length}, (_, i) => c.ring.value(0, i)); }"""
PIN = "time => { window.imuscope.cursor.value = {kind: 'pinned', time}; }"


def euler_degrees(w: float, x: float, y: float, z: float) -> dict[str, float]:
    """Roll, pitch, yaw in °, turned in the order yaw, pitch, roll about the axes z, y, x."""
    sine = max(-1.0, min(1.0, 2 * (w * y - z * x)))
    return {
        "roll": math.degrees(math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))),
        "pitch": math.degrees(math.asin(sine)),
        "yaw": math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))),
    }


def number(text: str) -> float:
    """A number as the page writes it: true minus, thin spaces, unit behind; NaN before it is written."""
    return float(text.replace("\u2212", "-").replace("\u2009", "").rstrip("° ") or "nan")


@pytest.fixture(scope="module")
def expected(captures: Path) -> dict[int, list[float]]:
    """Packet counter → quaternion, of every frame of the capture that has one."""
    rows = map(json.loads, (captures / "xbus" / "mti_100hz_49s.expected.jsonl").read_text().splitlines())
    return {row["1020"]: row["2010"] for row in rows if "2010" in row}


def pinned(page: Page, counter: int) -> tuple[int, dict[str, float], dict[str, float]]:
    """Pin the cursor on a sample. Returns its counter, the derived angles in memory and those written on the page."""
    results: dict[str, Any] = until(page, FIND, counter)
    page.evaluate(PIN, results["time"])

    def shown() -> dict[str, float]:
        return {name: number(text) for name, text in page.evaluate(SHOWN).items()}

    def is_there() -> bool:
        return all(shown().get(name) == pytest.approx(value, abs=0.0052) for name, value in results["angles"].items())

    with suppress(AssertionError):  # the caller says which angle is wrong
        block_until(is_there, "the angles of that moment")  # the table is written a few times a second
    drawn(page)  # numerals
    return results["counter"], results["angles"], shown()


def test_a_capture_plays_and_its_attitude_is_right(
    serve: Callable[..., ServerProcess],
    open_page: Callable[..., Page],
    captures: Path,
    expected: dict[int, list[float]],
) -> None:
    server = serve(f"{captures}/xbus/mti_100hz_49s.bin?speed=25")
    page = open_page(server.url)
    counters = list(expected)
    last = counters[-1]
    until(
        page,
        # Rows that were decoded together are in order within each kind of message: the GNSS rows may stand last.
        """last => { const c = window.imuscope?.store.channels.value.find(c => c.info.name === "PacketCounter");
                     const n = c?.ring.length ?? 0;
                     for (let i = Math.max(0, n - 300); i < n; i++) if (c.ring.value(0, i) >= last - 2) return true;
                     return false; }""",
        last,
    )
    there = {*page.evaluate(COUNTERS)}  # a page that is slow on a busy machine is spared samples
    counters = [counter for counter in counters if counter in there]
    yaws = set()
    for share in TIMES:
        target = counters[round(share * (len(counters) - 1))]
        counter, memory, shown = pinned(page, target)
        assert abs(counter - target) < len(counters) / 20
        truth = euler_degrees(*expected[counter])
        for angle, value in truth.items():
            assert memory[angle] == pytest.approx(value, abs=2e-4), f"{angle} in memory at counter {counter}"
            assert shown[angle] == pytest.approx(value, abs=0.0052), f"{angle} in the table at counter {counter}"
        # The numerals beside the horizon have one decimal. This device speaks ENU: heading is clockwise from north.
        for angle, value in {**truth, "heading": (90 - truth["yaw"]) % 360}.items():
            if angle != "yaw":
                assert shown[f"numeral {angle}"] == pytest.approx(value, abs=0.052), f"{angle} at counter {counter}"
        yaws.add(round(truth["yaw"], 2))
    assert len(yaws) > 2, "the capture moves, so the test must have seen different angles"
