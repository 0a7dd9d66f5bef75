"""The page of an Inertial Sense device, from recorded frames: its track with and without a map, and room for all of it.

What needs no browser (attitude, satellites, position, marks of trust, keys, vendor payloads) is tested in
web/src/pages/live.test.tsx and dialogs.test.tsx; the server's tiles in tests/server/integrations/test_map_tiles.py.
"""

import io
from collections.abc import Callable
from typing import Any

from PIL import Image
from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, PHONE, drawn, fits, press, serious, show, small_targets
from tests.browser.recorded.stories import Story
from tests.support.chromium import until

TRACK = "document.querySelector('[data-panel=track]')"
SUMMARY = f"{TRACK}?.querySelector('.track-summary')?.innerText ?? ''"


def png(colour: tuple[int, int, int]) -> bytes:
    """A square tile of one colour."""
    out = io.BytesIO()
    Image.new("RGB", (256, 256), colour).save(out, "PNG")
    return out.getvalue()


MAGENTA = png((255, 0, 255))
COVERED = """canvas => { const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    let n = 0, of = 0;  // of every seventh pixel
    for (let k = 0; k < data.length; k += 28, of++) n += data[k] > 150 && data[k + 1] < 60 && data[k + 2] > 150;
    return n / of; }"""


INK = """canvas => { const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    let n = 0; for (let k = 3; k < data.length; k += 4) n += data[k] > 200; return n; }"""
LARGE_VIEW = "document.querySelector('dialog .track-box canvas')"


def enlarged(page: Page) -> None:
    button = page.get_by_role("button", name="Enlarge the track")
    button.focus()
    page.keyboard.press("Enter")
    page.get_by_role("dialog", name="Track of").wait_for()
    until(page, f"({INK})({LARGE_VIEW}) > 100")


def shown_on_a_map(page: Page, story: Story) -> None:
    """Tiles cover the large track; each is asked for once, and the map can be taken away."""
    enlarged(page)
    until(page, "document.querySelector('dialog .attribution')?.innerText.includes('the survey')")
    until(page, f"({COVERED})({LARGE_VIEW}) > 0.9")

    def tiles() -> list[str]:
        return [one for one in story.requests if "/tiles/" in one]

    while len(tiles()) < 4:  # further out the picture is where tiles meet
        page.get_by_role("dialog").get_by_role("button", name="Zoom out", exact=True).click()
        drawn(page)
    until(page, f"({COVERED})({LARGE_VIEW}) > 0.9")
    assert len(tiles()) < 200
    assert len(tiles()) == len(set(tiles())), "each is asked for once"
    page.get_by_role("dialog").get_by_role("button", name="Map", exact=True).click()
    until(page, f"({COVERED})({LARGE_VIEW}) === 0")


def test_the_track_is_large_with_a_map_where_there_is_one(open_page: Callable[..., Page]) -> None:
    map_of: dict[str, Any] = {"tiles": False, "attribution": ""}
    answers = {"GET /api/map": lambda *_: map_of, "GET /api/tiles/*": MAGENTA}
    with Story("isb", answers=answers) as story:
        page = story.open(open_page, width=PHONE[0], height=PHONE[1], touch=True, still=True)
        until(page, "/3D/.test(document.querySelector('.gnss .caption')?.innerText)")
        drawn(page)
        small = small_targets(page)
        assert not small, "\n".join(small)
        assert fits(page)
        show(page, "Track", phone=True)
        until(page, f"/\\d+\\.\\d+.*°.*°/.test({SUMMARY})")
        assert page.evaluate(f"{TRACK}.querySelector('canvas').clientHeight") > 200
        assert small_targets(page, TRACK) == []
        assert fits(page)

        assert fits(page, width=DESKTOP[0])
        page.set_viewport_size({"width": DESKTOP[0], "height": DESKTOP[1]})
        drawn(page)
        assert page.evaluate(f"{TRACK}.querySelector('canvas').clientHeight") > 100
        assert serious(page) == []
        enlarged(page)
        until(page, "/sat/.test(document.querySelector('dialog').innerText)")
        page.get_by_role("dialog").get_by_role("button", name="Zoom in", exact=True).click()
        page.locator("dialog .track-box canvas").focus()
        page.keyboard.press("ArrowLeft")
        page.keyboard.press("0")
        drawn(page)
        assert serious(page, "document.querySelector('dialog')") == []
        assert page.get_by_role("dialog").get_by_role("button", name="Map", exact=True).count() == 0
        press(page, "Escape", "document.querySelector('dialog') === null")
        assert page.evaluate("document.activeElement.className") == "enlarge"
        assert "GET /api/map" in story.requests
        assert not [one for one in story.requests if "/tiles/" in one], "no map was configured"

        map_of |= {"tiles": True, "attribution": "© the survey"}
        shown_on_a_map(page, story)
