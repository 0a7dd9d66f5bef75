"""Comparing in a real browser: two live devices in one action, a link that restores them, a recording, a phone."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, PHONE, TARGETS, opened, serious
from tests.chromium import until
from tests.server_process import ServerProcess
from tests.timeouts import http_client
from tests.waiting import block_until

TEXT = "(document.querySelector('main')?.innerText ?? '')"
PAIRS = "document.querySelectorAll('.overlay-chart .side-a path[d^=M]').length"
SECOND = "document.querySelectorAll('.overlay-chart .side-b path[d^=M]').length"
DIFFERENCES = "document.querySelectorAll('.overlay-chart .difference path[d^=M]').length"
SOURCES = ("sim:xbus?product=MTi-630&rate=100&seed=1", "sim:xbus?product=MTi-630&rate=100&seed=2")


def test_a_recording_and_its_range(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    """From a recording one click; against itself, the alignment is exact and states its uncertainty."""
    server = serve(SOURCES[0])
    with http_client(base_url=server.url) as client:
        block_until(lambda: client.get("/api/devices").json()[0]["status"] == "live", "it streams")
        client.post("/api/devices/1/read", json={})
        block_until(lambda: client.get("/api/devices/1/jobs").json()["done"], "its settings are read")
        block_until(lambda: client.get("/api/devices").json()[0]["status"] == "live", "it streams again")
        recording = client.post("/api/recordings/start", json={"devices": ["1"]}).json()["id"]
        block_until(lambda: client.get("/api/recorder").json()["bytes"] > 80_000, "some seconds are recorded")
        assert client.post("/api/recordings/stop", json={}).status_code == 200
    page = open_page(f"{server.url.rstrip('/')}/#/recordings/{recording}")
    page.get_by_role("button", name="Compare", exact=True).click()
    until(page, f"{PAIRS} === 3 && {SECOND} === 3")
    page.get_by_label("B: recording or device").select_option(recording)
    until(page, f"{TEXT}.includes('0 … 0 m/s²')")
    page.get_by_role("button", name="Align by cross-correlation").click()
    until(page, f"/0 s ± [0-9.·⁻¹²³⁴⁵⁶⁷⁸⁹−]+ s/.test({TEXT})")
    labels = (
        "[...document.querySelector('.overlay-chart .grid').querySelectorAll('text[y]')].map(one => one.textContent)"
    )
    whole = page.evaluate(labels)
    chart = page.locator(".overlay-chart").first
    chart.scroll_into_view_if_needed()
    chart.hover()
    page.mouse.wheel(0, -600)
    until(page, f"{labels}.join() !== {','.join(whole)!r}")  # another part of the time
    chart.dblclick()
    until(page, f"{labels}.join() === {','.join(whole)!r}")
    chart.press("+")
    until(page, f"{labels}.join() !== {','.join(whole)!r}")
    assert page.locator(".overlay-chart").nth(1).locator(".grid text[x]").count() >= 4  # the difference
    page.get_by_text("Spectra of both").click()
    until(page, "document.querySelectorAll('path.interval').length >= 6")
    page.get_by_text("Settings of both").click()
    until(page, f"{TEXT}.includes('The settings agree.')")


def test_two_live_devices(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    """One key from Live; one click more aligns. Both simulators make the same motion at the same time. On a phone the
    link has room.
    """
    server = serve(*SOURCES)
    page = opened(server, open_page, DESKTOP)
    page.keyboard.press("d")
    until(page, f"{PAIRS} === 3 && {SECOND} === 3 && {DIFFERENCES} === 3")
    until(page, f"{TEXT}.includes('95 % within')")
    assert serious(page, "document.querySelector('main')") == []
    until(page, "location.hash.includes('b=2')")
    before = page.evaluate("location.hash")
    page.keyboard.press("Tab")
    chart = page.get_by_role("slider", name="Acceleration.x of A and B").first
    chart.press("Shift+ArrowRight")
    until(page, "/offset=0\\.[0-9]*[1-9]/.test(location.hash)")
    moved = page.evaluate("location.hash")
    assert moved != before
    page.reload()
    until(page, f"{PAIRS} === 3 && location.hash === {moved!r}")
    page.context.close()

    at = f"{server.url.rstrip('/')}/#/recordings?a=1&al=30&b=2&bl=30"
    page = open_page(at, width=PHONE[0], height=PHONE[1], touch=True)
    until(page, f"{PAIRS} === 3")
    assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE[0]
    assert page.evaluate("document.querySelector('main').scrollWidth") <= PHONE[0]
    place = "document.querySelector('main')"
    small = page.evaluate(TARGETS.replace("document.querySelectorAll", f"{place}.querySelectorAll"))
    assert not small, small
