"""The Configure page from recorded answers: accessibility, room on a phone, no motion, and keys beside a dialog."""

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.page_checks import PHONE, WATCH, click, drawn, fits, go_to, press, serious, small_targets
from tests.browser.recorded.stories import Story
from tests.support.chromium import until

ACCELERATION = 'tr[data-id="0x4020"]'
PLACES = ("Output%20configuration", "Frame%20and%20mounting", "PortConfig", "SetSyncSettings", "compare", "restore")
COLOURFUL = ("Output%20configuration", "compare")
"""Of the places those that have every colour: contrast is asked about there, in both themes."""


def configured(story: Story, open_page: Callable[..., Page], **options: object) -> Page:
    """The page with a change that has not been written."""
    page = story.open(open_page, "/#/configure/1", **options)
    page.locator(f"{ACCELERATION} select").first.select_option("50")
    until(page, "document.querySelector('.hex-part.changed') !== null")
    return page


def shown(page: Page, place: str) -> None:
    go_to(page, f"#/configure/1/{place}")


def test_every_sort_of_place_is_accessible(open_page: Callable[..., Page]) -> None:
    with Story("xbus") as story:
        page = configured(story, open_page, still=True)
        page.hover(f"{ACCELERATION} td:nth-child(2)")
        assert page.evaluate("document.getAnimations().filter(a => a.playState === 'running').length") == 0
        assert serious(page) == []
        for place in PLACES[1:]:
            shown(page, place)
            assert serious(page, "document.querySelector('main')", colours=place in COLOURFUL) == [], place
        nothing_moves_while_traffic_comes(story, page)
        keys_rest_while_a_question_is_open(page)


def nothing_moves_while_traffic_comes(story: Story, page: Page) -> None:
    """Load and traffic keep updating."""
    shown(page, PLACES[0])
    page.evaluate(WATCH)
    [health] = [text for text in story.texts if text["op"] == "health"]
    log = story.answers["GET /api/devices/1/traffic?limit=200"]
    newest = max(entry["seq"] for entry in log)
    for n, entry in enumerate(log[-3:], 1):
        texts = [health, {"op": "traffic", "entries": [{**entry, "seq": newest + n}]}]
        page.evaluate("texts => texts.forEach(text => window.imuscope.store.receive({kind: 'text', text}))", texts)
        drawn(page)
    assert page.evaluate("[...document.querySelectorAll('.log-entry')].length") >= 3
    assert page.evaluate("window.shift") < 0.01


def keys_rest_while_a_question_is_open(page: Page) -> None:
    """Keys led away from it, and Esc left it open."""
    shown(page, "RestoreFactoryDef")
    click(page, "button", "Send", "document.querySelector('dialog[open]') !== null", exact=True)
    page.keyboard.press("g")
    page.keyboard.press("l")
    press(page, "Escape", "document.querySelector('dialog') === null")
    assert "#/configure" in page.url


def test_everything_is_reachable_on_a_phone(open_page: Callable[..., Page]) -> None:
    """No sideways scrolling, also at 360 px, and targets that a finger hits, in every sort of place."""
    with Story("xbus") as story:
        page = configured(story, open_page, width=PHONE[0], height=PHONE[1], touch=True)
        assert serious(page, colours=False) == []
        for place in (*PLACES, "Filter%20profile", "corrections"):
            shown(page, place)
            assert fits(page, width=360), place
            if place in PLACES:
                small = small_targets(page)
                assert not small, "\n".join([place, *small])
        assert fits(page, width=390)
        page.evaluate("scrollTo(0, 0)")
        page.get_by_role("button", name="Settings", exact=True).click()
        page.get_by_label("Search settings and commands").fill("lever")
        assert page.get_by_role("navigation", name="Matches").is_visible() or "No matches" in page.inner_text("#rail")
