"""The page of a fleet in a real browser: order, filters, keys, details, and a phone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, PHONE, TARGETS, serious
from tests.chromium import until
from tests.free_ports import free_port
from tests.server_process import ServerProcess
from tests.synthetic_fleet import SyntheticFleet
from tests.waiting import block_until

ROWS = "[...document.querySelectorAll('.fleet-row')]"
NAMES = f"{ROWS}.sort((a, b) => a.ariaRowIndex - b.ariaRowIndex).map(row => row.querySelector('a')?.textContent)"
# Places of all rows and cells, and of what stands above them.
PARTS = ".fleet-row, [role=gridcell], [role=columnheader], .fleet-tools *"
BOXES = (
    f"[...document.querySelectorAll({PARTS!r})]"
    """.map(one => {
  const {x, y, width, height} = one.getBoundingClientRect();
  return [x, y, width, height].join();
})"""
)


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SyntheticFleet]:
    with SyntheticFleet(300, tmp_path_factory.mktemp("fleet")) as running:
        yield running


def opened(
    fleet: SyntheticFleet, open_page: Callable[..., Page], at: str = "", size: tuple[int, int] = DESKTOP
) -> Page:
    page = open_page(fleet.url + at, width=size[0], height=size[1], touch=size == PHONE)
    until(page, f"{ROWS}.length > 5")
    return page


def afresh(page: Page, fleet: SyntheticFleet) -> None:
    """The page as opened for the first time."""
    page.goto("about:blank")
    page.goto(fleet.url)
    until(page, f"{ROWS}.length > 5")


def lost(fleet: SyntheticFleet) -> set[str]:
    return {one.name for one in fleet.maker.robots if one.state == "lost"}


def test_robots_that_need_somebody_are_reached_by_keys_and_by_a_link(
    fleet: SyntheticFleet, open_page: Callable[..., Page]
) -> None:
    """Without a connection figures stay, with their age."""
    page = opened(fleet, open_page)
    assert page.evaluate("location.hash") == "#/fleet"
    names = page.evaluate(NAMES)
    assert set(names[: len(lost(fleet))]) == lost(fleet)
    assert page.evaluate(f"{ROWS}.length") < 80
    assert serious(page) == []

    page.route("**/api/fleet/robots*", lambda route: route.abort("connectionrefused"))
    until(page, "document.querySelector('.fleet .band')?.innerText.includes('No connection to the fleet server')")
    assert page.evaluate(NAMES)[:10] == names[:10]
    page.unroute("**/api/fleet/robots*")
    until(page, "document.querySelector('.fleet .band') === null")

    page.evaluate("location.hash = '#/fleet?sort=name'")
    until(page, f"{ROWS}.length > 5")
    page.get_by_role("grid").focus()
    page.keyboard.press("End")
    until(page, "document.querySelector('.fleet-row.active a')?.textContent === 'amr-300'")
    until(page, "document.querySelector('.fleet-row.active').getBoundingClientRect().bottom <= innerHeight")
    page.keyboard.press("Home")
    for _ in range(4):
        page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowRight")  # it has two devices
    until(page, "document.querySelectorAll('.fleet-row.of-device').length === 2")
    page.keyboard.press("Enter")
    until(page, "document.querySelector('.fleet-details h2')?.textContent === 'amr-005'")
    until(page, "document.querySelectorAll('.fleet-device').length === 2")
    link = page.get_by_role("link", name="Configure", exact=True).last
    assert link.get_attribute("href") == "/robots/amr-005/#/configure"
    own = page.get_by_role("link", name="Open at its own address")
    assert own.get_attribute("href") == "http://amr-005.example:8080/"
    assert serious(page, colours=False) == []
    page.go_back()
    until(page, "document.querySelector('.fleet-details') === null")

    afresh(page, fleet)
    page.locator(".fleet-summary").get_by_role("button", name="Lost").click()
    page.get_by_role("button", name="Map", exact=True).click()
    until(page, "document.querySelectorAll('.map-cell').length === 300")
    assert page.evaluate("document.querySelectorAll('.map-cell:not(.faint)').length") == len(lost(fleet))
    page.get_by_role("listbox").focus()
    for key in ("Home", "ArrowDown", "ArrowRight", "ArrowUp"):
        page.keyboard.press(key)
    until(page, "document.querySelector('.map-line b')?.innerText === 'amr-002'")
    page.keyboard.press("Enter")
    until(page, "document.querySelector('.fleet-details h2')?.textContent === 'amr-002'")
    assert page.evaluate("location.hash") == "#/fleet?show=lost&view=map&robot=amr-002"
    assert serious(page) == []

    afresh(page, fleet)
    page.get_by_role("button", name="Losing samples").click()
    page.get_by_label("Group by").select_option("firmware")
    page.get_by_role("columnheader", name="Loss").get_by_role("button").click()
    page.keyboard.press("/")
    page.keyboard.type("amr")
    address = "#/fleet?sort=loss&show=loss&q=amr&by=firmware"
    until(page, f"location.hash === {address!r}")
    listed = page.evaluate(NAMES)
    page.reload()
    until(page, f"{ROWS}.length > 1")
    assert page.evaluate("location.hash") == address
    assert page.evaluate(NAMES) == listed
    assert page.get_by_role("searchbox").input_value() == "amr"


def test_nothing_moves_while_figures_change(fleet: SyntheticFleet, open_page: Callable[..., Page]) -> None:
    page = opened(fleet, open_page, "#/fleet?sort=temperature")
    box = page.get_by_role("grid").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 300, box["y"] + 200)  # the pointer holds the order
    names, boxes = page.evaluate(NAMES), page.evaluate(BOXES)
    shown = page.evaluate(f"{ROWS}.map(row => row.innerText).join()")
    until(page, "document.querySelector('.sort-now').disabled")

    def has_changed() -> bool:
        fleet.change()
        return bool(page.evaluate("!document.querySelector('.sort-now').disabled"))

    block_until(has_changed, "another order")
    assert page.evaluate(f"{ROWS}.map(row => row.innerText).join()") != shown
    assert page.evaluate(NAMES) == names
    assert page.evaluate(BOXES) == boxes
    page.get_by_role("button", name="Sort now").click()
    until(page, f"{NAMES}.join() !== {','.join(names)!r}")


def test_everything_is_reachable_on_a_phone(fleet: SyntheticFleet, open_page: Callable[..., Page]) -> None:
    page = opened(fleet, open_page, size=PHONE)
    assert serious(page) == []
    small = page.evaluate(TARGETS)
    assert not small, "\n".join(small)
    page.set_viewport_size({"width": 360, "height": 740})
    assert page.evaluate("document.scrollingElement.scrollWidth") <= 360
    page.locator(".fleet-row").first.tap()
    until(page, "document.querySelector('.fleet-details h2') === document.activeElement")
    assert page.evaluate("document.querySelector('.fleet-details').getBoundingClientRect().top") == 52
    small = page.evaluate(TARGETS)
    assert not small, "\n".join(small)
    page.get_by_role("button", name="Close the details").tap()
    until(page, "document.querySelector('.fleet-details') === null")


def test_a_robot_joins_and_is_lost(tmp_path: Path, open_page: Callable[..., Page]) -> None:
    """A robot with a simulated device and a fleet server, as they are started on a command line."""
    bus = f"tcp/127.0.0.1:{free_port()}"
    config = tmp_path / "robot.toml"
    config.write_text(f'[fleet]\nrouter = "{bus}"\nname = "otter-7"\ngroup = "otters"\n')
    with ServerProcess(data=tmp_path / "fleet", arguments=("--listen", bus), command="fleet") as server:
        page = open_page(server.url)
        until(page, "document.querySelector('.card code')?.innerText === 'imuscope serve --fleet tcp/127.0.0.1:7447'")
        assert page.locator(".nav").inner_text().split() == ["Fleet", "Recordings"]
        arguments = ("--config", str(config))
        with ServerProcess("sim:xbus?product=MTi-630", data=tmp_path / "robot", arguments=arguments):
            row = "document.querySelector('.fleet-row')?.innerText"
            until(page, f"/otter-7/.test({row}) && /MTi-630/.test({row}) && /Hz/.test({row})")
            until(page, "document.querySelector('.fleet-row .dot').classList.contains('live')")
        until(page, f"/lost/.test({row})")
        assert page.evaluate("document.querySelector('.fleet-row').classList.contains('held')")
        page.locator(".fleet-row").click()
        page.get_by_text("Newest events").click()
        until(page, "document.querySelectorAll('.fleet-events li').length > 0")
        page.get_by_role("button", name="Remove from the list").click()
        until(page, "document.querySelector('.card code') !== null")
