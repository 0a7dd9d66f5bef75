"""A robot in a real browser, through its fleet server: it joins, shows its page, is lost, and is removed."""

from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Page

from tests.browser.page_checks import click, serious
from tests.server.extensions.fleet.robot_with_pages import CONTROL, fleet_of
from tests.support.chromium import until

ROW = "document.querySelector('.fleet-row')"


def test_a_robot_is_opened_from_the_fleet_and_lost(tmp_path: Path, open_page: Callable[..., Page]) -> None:
    with fleet_of(tmp_path, "view") as (server, robot, _):
        page = open_page(f"{server.url}?token={CONTROL}")
        until(page, f"/otter 7/.test({ROW}.innerText) && /MTi-630/.test({ROW}.innerText) && /Hz/.test({ROW}.innerText)")
        until(page, f"{ROW}.querySelector('.dot').classList.contains('live')")
        assert page.locator(".nav").inner_text().split() == ["Fleet", "Recordings"]
        click(page, "link", "Open the page of otter 7", "location.pathname === '/robots/otter%207/'")
        until(page, "/Round trip \\d+/.test(document.querySelector('.through-fleet')?.innerText)")
        until(page, "document.querySelectorAll('.main canvas, main canvas').length > 1")
        assert serious(page, colours=False) == []
        page.get_by_role("link", name="Fleet", exact=True).click()
        until(page, "document.querySelector('.fleet-details h2')?.textContent === 'otter 7'")
        robot.stop()
        until(page, f"/lost/.test({ROW}.innerText) && {ROW}.classList.contains('held')")
        page.get_by_text("Newest events").click()
        until(page, "document.querySelectorAll('.fleet-events li').length > 0")
        page.get_by_role("button", name="Remove from the list").click()
        until(page, "document.querySelector('.card code')?.innerText === 'imuscope serve --fleet tcp/127.0.0.1:7447'")
