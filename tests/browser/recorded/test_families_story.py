"""Pages of IDTP devices, from recorded frames: accessibility, and room on a phone and on a desktop.

The page of an Inertial Sense device is looked at in test_families.py. Attitude, satellites, position and marks of trust
are tested in web/src/pages/live.test.tsx.
"""

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, PHONE, drawn, fits, serious, small_targets
from tests.browser.recorded.stories import Story
from tests.support.chromium import until

SHOWN = {"idtp": "[data-numeral]", "secure": "[data-key=wanted]"}


def test_their_pages_are_accessible(open_page: Callable[..., Page]) -> None:
    """No serious findings of axe, no horizontal scrolling, and touch targets of sufficient size.

    The elements are the same at both widths, so axe runs once. Contrast is checked where colours differ.
    """
    for family, shown in SHOWN.items():
        with Story(family) as story:
            page = story.open(open_page, width=PHONE[0], height=PHONE[1], touch=True, still=True)
            until(page, f"document.querySelector('{shown}') !== null")
            drawn(page)
            small = small_targets(page)
            assert not small, "\n".join([family, *small])
            assert fits(page), family
            assert fits(page, width=DESKTOP[0]), family
            page.set_viewport_size({"width": DESKTOP[0], "height": DESKTOP[1]})
            drawn(page)
            assert serious(page, colours=family != "idtp") == [], family
