"""The Live page of a streaming simulator: nothing moves while digits change, and a reload has its past at once.

How it looks is tested from recorded frames, in test_live_story.py.
"""

from collections.abc import Callable

from playwright.sync_api import Page

from tests.browser.page_checks import BOXES, PHONE, WATCH, drawn, opened
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

HEARTBEATS = "window.imuscope.store.health.value.get('1')?.time ?? 0"


def after(page: Page, reports: int) -> None:
    """Wait until that many seconds of the device's own have passed, and are on screen."""
    first = page.evaluate(HEARTBEATS)
    until(page, f"{HEARTBEATS} >= {first + reports}")


def test_nothing_moves_while_values_change(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = opened(server, open_page)
    after(page, 2)  # rare messages of a device and the first events have appeared
    for size in (None, PHONE):
        if size:
            page.set_viewport_size({"width": size[0], "height": size[1]})
            until(page, "document.querySelector('.stack.narrow') !== null")
            drawn(page)
        page.evaluate(WATCH)
        before = page.evaluate(BOXES)
        after(page, 1)
        now = page.evaluate(BOXES)
        moved = [f"{one}  ->  {other}" for one, other in zip(before, now, strict=False) if one != other]
        assert len(before) == len(now), "elements came or went"
        assert not moved, "\n".join(moved[:20])
        assert page.evaluate("window.shift") < 0.01

    # Samples that are older than the page that shows them: waiting does not bring these. Live ones may come first.
    ring = """window.imuscope?.store.channels.value.find(one => one.info.name === "Acceleration")?.ring"""
    newest = page.evaluate(f"{ring}.time({ring}.length - 1)")
    page.reload()
    until(page, f"{ring}?.length > 0 && {ring}.time(0) < {newest}")
