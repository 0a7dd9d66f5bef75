"""The Configure page from recorded answers: accessibility, room on a phone, and no motion."""

from __future__ import annotations

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.page_checks import PHONE, fits, go_to, serious, small_targets
from tests.browser.stories import Story
from tests.chromium import until

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
        for place in PLACES:
            shown(page, place)
            assert serious(page, colours=place in COLOURFUL) == [], place


def test_everything_is_reachable_on_a_phone(open_page: Callable[..., Page]) -> None:
    """No sideways scrolling, also at 360 px, and targets that a finger hits, in every sort of place."""
    with Story("xbus") as story:
        page = configured(story, open_page, width=PHONE[0], height=PHONE[1], touch=True)
        assert serious(page, colours=False) == []
        for place in (*PLACES, "Filter%20profile", "corrections"):
            shown(page, place)
            assert fits(page, width=390), place
            if place in PLACES:
                small = small_targets(page)
                assert not small, "\n".join([place, *small])
            assert fits(page, width=360), place
        page.evaluate("scrollTo(0, 0)")
        page.get_by_role("button", name="Settings", exact=True).click()
        page.get_by_label("Search settings and commands").fill("lever")
        assert page.get_by_role("navigation", name="Matches").is_visible() or "No matches" in page.inner_text("#rail")
