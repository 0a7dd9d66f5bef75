"""The Configure page with a real server and simulator: a rate is changed and seen in the plot, and a profile goes back.

What the page shows, asks and sends is tested without a browser, in web/src/pages/configure/page.test.tsx and
writing.test.tsx; what becomes of it on the device, in tests/server/configuration.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import click
from tests.browser.test_pictures import SIZES, picture
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

Serve = Callable[..., ServerProcess]
OpenPage = Callable[..., Page]

SAMPLES = "window.imuscope?.store.channels.value.some(channel => channel.ring.length > 20)"
RATE = """name => {
  const ring = window.imuscope.store.channels.value.find(channel => channel.info.name === name)?.ring;
  const last = ring ? ring.length - 1 : 0, first = Math.max(0, last - 40);
  return ring && last > 40 ? (last - first) / (ring.time(last) - ring.time(first)) : 0;
}"""
"""Samples per second of a quantity, over its newest forty."""
ACCELERATION = 'tr[data-id="0x4020"]'


def configured(server: ServerProcess, open_page: OpenPage, place: str = "", **options: Any) -> Page:
    """The Configure page of the first device, with its settings read."""
    page = open_page(f"{server.url.rstrip('/')}/#/configure/1{place}", **options)
    until(page, "document.querySelector('.settings-form h1') !== null")
    if page.get_by_role("button", name="Read settings").count():
        page.get_by_role("button", name="Read settings").click()
    until(page, "document.querySelector('[data-setting], [data-command], .compare') !== null")
    return page


def test_a_rate_is_changed_in_five_actions_the_plot_follows_and_a_profile_goes_back(
    serve: Serve, open_page: OpenPage
) -> None:
    server = serve("sim:xbus")
    page = open_page(server.url)
    until(page, SAMPLES)
    until(page, f"Math.abs(({RATE})('Acceleration') - 100) < 10")
    page.get_by_role("link", name="Configure").click()  # 1
    page.get_by_role("button", name="Read settings").click()  # 2
    page.locator(f"{ACCELERATION} select").first.select_option("50")  # 3
    until(page, "document.querySelector('.previous')?.innerText === 'was 100 Hz'")
    page.get_by_role("button", name="Apply", exact=True).click()  # 4
    until(page, "/1 of 1 settings written and read back/.test(document.querySelector('.apply-bar')?.innerText)")
    click(page, "link", "Live", f"Math.abs(({RATE})('Acceleration') - 50) < 5", exact=True)  # 5
    until(page, "document.querySelector('.plots canvas') !== null")

    page.get_by_role("link", name="Configure").click()
    page.get_by_role("navigation", name="Snapshots").get_by_role("link", name="First contact").click()
    until(page, "document.querySelectorAll('.difference-table tbody tr').length === 1")
    row = page.locator(".difference-table tbody tr")
    assert "50 Hz" in row.locator("td").first.inner_text()
    assert "100 Hz" in row.locator("td").last.inner_text()
    picture(page, "compare-1440")
    page.get_by_role("button", name="Apply this profile").click()
    page.get_by_role("dialog").get_by_role("button", name="Write profile").click()
    until(page, "document.querySelector('.compare')?.innerText.includes('No difference')")
    entries = server.request("GET", "/api/devices/1/values")["values"]["OutputConfiguration"]["outputs"]
    assert {"data_identifier": 0x4020, "output_frequency": 100} in entries


@pytest.mark.slow  # for people
@pytest.mark.parametrize("width", SIZES)
def test_a_change_in_both_themes(server: ServerProcess, open_page: OpenPage, width: str) -> None:
    size = SIZES[width]
    page = configured(server, open_page, width=size[0], height=size[1], touch=width == "phone")
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    until(page, "document.querySelector('.hex-part.changed') !== null")
    for theme in ("light", "dark"):
        page.emulate_media(color_scheme=theme)  # type: ignore[arg-type]
        until(page, f"document.documentElement.dataset.theme === {theme!r}")
        picture(page, f"configure-{width}-{theme}")
