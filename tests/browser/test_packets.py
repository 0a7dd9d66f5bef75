"""From a point of a plot to its bytes and back, in a real browser, counted in actions."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page

from tests.browser.test_measuring import area
from tests.browser.test_page import DESKTOP, PHONE, serious
from tests.browser.test_page import opened as live
from tests.browser.test_recordings import opened, recorded
from tests.chromium import until
from tests.server_process import ServerProcess

__all__ = ["recorded"]  # a fixture

SOURCE = "sim:xbus?product=MTi-630&rate=100&seed=1"
DIALOG = "document.querySelector('.packet')"
SHOWN = f"{DIALOG}?.querySelector('tbody tr') != null"
ROWS = f"""[...{DIALOG}.querySelectorAll('tbody tr')].map(row => [...row.cells].map(cell => cell.textContent))"""


def floats(text: str) -> tuple[float, ...]:
    data = bytes.fromhex(text)
    return struct.unpack(f">{len(data) // 4}f", data)


def test_one_action_leads_from_a_point_to_its_bytes_and_one_back(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    page = live(serve(SOURCE), open_page, DESKTOP)
    until(page, "imuscope.store.channels.value.some(({ring}) => ring.length > 800)")
    left, right, y = area(page)
    page.mouse.click(left + 0.8 * (right - left), y, button="right")
    until(page, SHOWN)
    rows: Any = page.evaluate(ROWS)
    acceleration = next(row for row in rows if row[2].startswith("Acceleration:"))
    assert [float(word) for word in acceleration[3].split(", ")] == pytest.approx(floats(acceleration[1]), rel=1e-6)
    assert "".join(row[1] for row in rows).startswith("FA")
    assert "device time" in page.evaluate(f"{DIALOG}.textContent")
    assert serious(page, "document.querySelector('dialog')") == []
    counted = next(row[3] for row in rows if row[2].startswith("PacketCounter"))
    page.keyboard.press("ArrowRight")
    until(page, f"{ROWS}.some(row => row[2] === 'PacketCounter: {(int(counted) + 1) % 65536}')")
    page.get_by_role("button", name="Show in plot").click()
    until(page, f"{DIALOG} === null && imuscope.cursor.value?.kind === 'pinned'")


def test_a_recording_leads_to_its_bytes_by_key(recorded: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = opened(recorded, open_page)
    page.keyboard.press("p")
    until(page, SHOWN)
    assert page.get_by_role("button", name="Show in plot").is_visible()


def test_on_a_phone_the_bytes_fit(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = live(serve(SOURCE), open_page, PHONE)
    until(page, "imuscope.store.channels.value.some(({ring}) => ring.length > 300)")
    page.keyboard.press("p")
    until(page, SHOWN)
    width = "document.querySelector('dialog').scrollWidth - document.querySelector('dialog').clientWidth"
    assert page.evaluate(width) <= 0
    assert serious(page, "document.querySelector('dialog')") == []
