"""The Live page's design standard (design, section 10), from recorded frames.

No serious finding of axe-core in either theme and at either width; 360 px without sideways scrolling; targets that a
finger can hit; a bar with room at every width. Keys, bar and dialogs are tested without a browser, in
web/src/pages/top-bar.test.tsx and dialogs.test.tsx.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from playwright.sync_api import Page

from tests.browser.page_checks import PHONE, fits, go_to, serious, small_targets
from tests.browser.recorded.stories import Story
from tests.support.chromium import until

SHOWN = (
    "document.querySelector('[data-numeral]') !== null && document.querySelectorAll('.lane-names button').length > 2"
)
BOX = "(e => e && (({x, y, right, bottom}) => [x, y, right, bottom])(e.getBoundingClientRect()))"


def test_a_desktop_and_a_tablet(open_page: Callable[..., Page]) -> None:
    """Nothing serious from axe, no motion where it is unwanted, a ring on each focus, and lanes that say what they
    are; on a tablet, panels over the page.
    """
    with Story("xbus") as story:
        page = story.open(open_page, still=True)
        until(page, SHOWN)
        pages = page.locator(".nav a").all_inner_texts()
        assert pages == ["Live", "Configure", "Recordings"], "without a store there are no Questions"
        assert page.evaluate("document.getAnimations().filter(a => a.playState === 'running').length") == 0
        assert serious(page) == []

        visited = set()
        for _ in range(12):
            page.keyboard.press("Tab")
            ring = page.evaluate("""() => {
              const element = document.activeElement, style = getComputedStyle(element);
              const isSeen = style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 2;
              return [element.outerHTML.slice(0, 80), isSeen];
            }""")
            visited.add(ring[0])
            assert ring[1], f"no focus ring on {ring[0]}"
        assert len(visited) > 5

        lane = page.locator(".lane-names button").nth(1)
        lane.focus()
        until(page, "document.querySelector('.lane-description').innerText.length > 20")
        by_key = page.inner_text(".lane-description b").split(":")[0]
        lane.blur()
        until(page, "document.querySelector('.lane-description').innerText === ''")
        box = page.locator(".lane-box").bounding_box()
        assert box
        page.mouse.move(box["x"] + 600, box["y"] + 17 * 1.5)
        until(page, f"document.querySelector('.lane-description b')?.innerText.startsWith({by_key!r})")

        page.keyboard.press("?")
        link = page.get_by_role("dialog").get_by_role("link", name="API reference")
        assert link.get_attribute("href") == "/docs"
        page.keyboard.press("Escape")
        panels_of_a_tablet_lie_over_the_page(page)


def panels_of_a_tablet_lie_over_the_page(page: Page) -> None:
    """At its edge, from the bar to the foot of the window; nothing moves below it."""
    page.set_viewport_size({"width": 1000, "height": 800})
    for place in ("#/", "#/configure"):
        go_to(page, place)
        middle = f"{BOX}(document.querySelector('main'))"
        until(page, f"{middle} !== null && document.querySelector('.bar [aria-controls=rail]') !== null")
        before = page.evaluate(middle)
        for name in ("rail", "side"):
            toggle = page.locator(f".bar [aria-controls={name}]:visible").first
            toggle.click()
            x, y, right, bottom = until(page, f"{BOX}(document.querySelector('.{name}.open'))")
            assert (x if name == "rail" else right) == (0 if name == "rail" else 1000)
            assert (y, bottom) == (page.locator(".bar").evaluate("e => e.getBoundingClientRect().bottom"), 800)
            assert page.evaluate(middle) == before
            toggle.click()


def test_the_bar_has_room_at_every_width(open_page: Callable[..., Page]) -> None:
    """While it records, with Questions as the fourth page, which a server with a store has, and with neither."""
    has_room = "document.querySelector('.bar').scrollWidth <= document.querySelector('.bar').clientWidth"
    with Story("xbus") as story:
        page = story.open(open_page, height=844)
        until(page, SHOWN)
        # What is below the bar changes nothing, and takes time to be laid out.
        page.evaluate("document.querySelectorAll('.app > :not(.bar)').forEach(one => { one.style.display = 'none'; })")
        for running in (True, False):
            page.evaluate("text => window.imuscope.store.receive({kind: 'text', text})", recorder(story, running))
            until(page, f"(document.querySelector('.bar .stop-recording') !== null) === {str(running).lower()}")
            if running:
                page.evaluate(f"document.querySelector('.nav').insertAdjacentHTML('beforeend', {FOURTH!r})")
            else:
                page.evaluate("document.querySelector('#fourth').remove()")
            for width in (*range(1840, 720, -40), 721, 390, 360):
                page.set_viewport_size({"width": width, "height": 844})
                until(page, has_room)
        # On a phone, the selected device is named in full.
        page.set_viewport_size({"width": 390, "height": 844})
        name = "document.querySelector('.device-name .ellipsis')"
        until(page, f"{name}.innerText.length > 3 && {name}.scrollWidth <= {name}.clientWidth")


FOURTH = '<a id="fourth">Questions</a>'


def recorder(story: Story, running: bool) -> dict[str, Any]:
    """State of the recorder after an hour, or when nothing is recorded."""
    began = story.time - 3599 if running else None
    size = {"bytes": 123_456_789, "behind_s": 0.1, "free": 5 * 10**10, "seconds_left": 86_400}
    more = {"id": "run" if running else "", "title": "", "devices": ["1"], "message": "", "hint": "", "headless": []}
    return {"op": "recorder", "running": running, "started": began, **size, **more}


def test_a_phone(open_page: Callable[..., Page]) -> None:
    """Nothing serious from axe, a finger hits every control, and 360 px do not scroll sideways.

    A finger's question to a lane was answered and wiped away at once, as the finger was lifted.
    """
    with Story("xbus") as story:
        page = story.open(open_page, width=PHONE[0], height=PHONE[1], touch=True)
        until(page, SHOWN)
        assert serious(page, colours=False) == []
        small = small_targets(page)
        assert not small, "\n".join(small)
        page.evaluate("document.querySelector('.lane-box').scrollIntoView({block: 'center'})")
        box = page.locator(".lane-box").bounding_box()
        assert box
        page.touchscreen.tap(200, box["y"] + 17 * 1.5)
        until(page, "document.querySelector('.lane-description').innerText.length > 20")
        page.evaluate("scrollTo(0, 0)")
        assert fits(page, width=360)
        page.mouse.wheel(400, 0)
        assert page.evaluate("scrollX") == 0
