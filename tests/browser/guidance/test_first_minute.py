"""The first minute on the page: its line, the tour by keys and on a phone, and the guide that is served with it."""

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.page_checks import PHONE, click, fits, opened, press, reload, serious, small_targets
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

OpenPage = Callable[..., Page]
LINE, TOUR, DIALOG = (
    "[data-key=first-minute]",
    "document.querySelector('.tour')",
    "document.querySelector('dialog[open]')",
)
RING = "(box => box && [box.width, box.height])(document.querySelector('.tour-ring')?.getBoundingClientRect())"
VISIBLE = "[...document.querySelectorAll('.bar, .bar .icon-word, .bar .btn')].filter(one => one.checkVisibility())"
CUT = f"{VISIBLE}.filter(one => one.scrollWidth > one.clientWidth + 1).map(one => one.outerHTML.slice(0, 90))"
WORDS = f"{VISIBLE}.filter(one => one.className === 'icon-word').map(one => one.innerText)"


def test_the_line_leads_to_a_tour_by_keys_and_stays_away_once_dismissed(
    server: ServerProcess, open_page: OpenPage
) -> None:
    page = opened(server, open_page, still=True, first_minute=True)
    assert page.inner_text(f"{LINE} b") == "One simulated sensor"
    assert page.locator(f"{LINE} input[type=file]").count() == 1
    click(page, "button", "Connect yours", f"{DIALOG}?.innerText.includes('Address')")
    press(page, "Escape", f"{DIALOG} === null")
    click(page, "button", "What am I looking at?", f"{TOUR}?.innerText.includes('Stop 1 of 5')")
    for stop in range(2, 6):
        press(page, "ArrowRight", f"{TOUR}.innerText.includes('Stop {stop} of 5')")
        assert page.evaluate("document.activeElement.id") == "tour-title"
        assert min(until(page, RING)) > 20
    assert serious(page, TOUR) == []
    press(page, "ArrowLeft", f"{TOUR}.innerText.includes('Stop 4 of 5')")
    press(page, "Escape", f"{TOUR} === null")
    assert page.evaluate("document.activeElement.innerText") == "What am I looking at?"
    click(page, "button", "Dismiss", f"document.querySelector('{LINE}') === null")
    assert page.evaluate("localStorage.getItem('imuscope.first-minute')") == "dismissed"
    reload(page)
    until(page, "document.querySelector('#plots canvas') !== null")
    assert page.locator(LINE).count() == 0


def test_the_tour_on_a_phone(server: ServerProcess, open_page: OpenPage) -> None:
    page = opened(server, open_page, PHONE, first_minute=True)
    assert fits(page)
    page.get_by_role("button", name="What am I looking at?").tap()
    for stop in range(1, 6):
        until(page, f"{TOUR}?.innerText.includes('Stop {stop} of 5')")
        box = page.locator(".tour").bounding_box()
        assert box
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= PHONE[0]
        assert box["y"] + box["height"] <= PHONE[1]
        assert min(until(page, RING)) > 20
        assert not small_targets(page, TOUR)
        page.locator(".tour .btn.main").tap()
    until(page, f"{TOUR} === null")


def test_the_guide_is_searched_without_a_network(server: ServerProcess, open_page: OpenPage) -> None:
    page = opened(server, open_page)
    press(page, "?", f"{DIALOG} !== null")
    click(page, "button", "Open the guide", f"{DIALOG}.querySelector('article h3')?.innerText === 'First look'")
    page.keyboard.type("allan deviation")
    page.keyboard.press("Enter")
    until(page, f"/allan/.test({DIALOG}.querySelector('[aria-pressed=true]')?.innerText ?? '')")
    assert serious(page, DIALOG) == []
    page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert page.evaluate(f"{DIALOG}.scrollWidth <= {DIALOG}.clientWidth")


def test_icons_of_the_bar_have_words_and_nothing_is_cut(server: ServerProcess, open_page: OpenPage) -> None:
    page = opened(server, open_page)
    for width in (1440, 1280):
        page.set_viewport_size({"width": width, "height": 900})
        for running in (False, True):
            until(page, f"(document.querySelector('.bar .stop-recording') !== null) === {str(running).lower()}")
            until(page, f"{WORDS}.includes('Help')")
            assert {"Analysis", "Workspace", "Link", "Help"} <= set(page.evaluate(WORDS))
            assert page.evaluate(CUT) == []
            page.keyboard.press("Shift+R")
        until(page, "document.querySelector('.bar .stop-recording') === null")
