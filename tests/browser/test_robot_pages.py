"""The page of a robot in a real browser, through its fleet server."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Page

from tests.browser.page_checks import serious
from tests.chromium import until
from tests.server.fleet.robot_with_pages import CONTROL, fleet_of


def test_a_robot_is_opened_from_the_fleet_and_left_again(tmp_path: Path, open_page: Callable[..., Page]) -> None:
    with fleet_of(tmp_path, "view") as (server, _, _):
        page = open_page(f"{server.url}?token={CONTROL}")
        page.get_by_role("link", name="Open the page of otter 7").click()
        until(page, "location.pathname === '/robots/otter%207/'")
        until(page, "/Round trip \\d+/.test(document.querySelector('.through-fleet')?.innerText)")
        until(page, "document.querySelectorAll('.main canvas, main canvas').length > 1")
        assert serious(page, colours=False) == []
        page.get_by_role("link", name="Fleet", exact=True).click()
        until(page, "document.querySelector('.fleet-details h2')?.textContent === 'otter 7'")
