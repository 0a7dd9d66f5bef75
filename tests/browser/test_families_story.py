"""Pages of Inertial Sense and IDTP devices, from recorded frames: accessibility, and room on a phone.

Attitude, satellites, position and marks of trust are tested in web/src/pages/live.test.tsx.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, PHONE, drawn, fits, serious, small_targets
from tests.browser.stories import Story
from tests.chromium import until

SHOWN = {"isb": "[data-numeral]", "idtp": "[data-numeral]", "secure": "[data-key=wanted]"}


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_their_pages_are_accessible(open_page: Callable[..., Page], size: tuple[int, int]) -> None:
    """No serious findings of axe, no horizontal scrolling, and touch targets of sufficient size.

    On a phone the elements are the same, so axe runs once. Contrast is checked where colours differ.
    """
    is_phone = size == PHONE
    for family, shown in SHOWN.items():
        with Story(family) as story:
            page = story.open(open_page, width=size[0], height=size[1], touch=is_phone, still=True)
            until(page, f"document.querySelector('{shown}') !== null")
            drawn(page)
            if not is_phone:
                assert serious(page, colours=family != "idtp") == [], family
            assert fits(page, width=size[0]), family
            if is_phone:
                small = small_targets(page)
                assert not small, "\n".join([family, *small])
