"""The library and an opened recording, from recorded answers: accessibility, and room on a phone."""

from __future__ import annotations

import base64
import struct
from collections.abc import Callable
from typing import Any

from playwright.sync_api import Page

from tests.browser.page_checks import PHONE, fits, go_to, serious, show, small_targets
from tests.browser.recorded.stories import Story
from tests.support.chromium import until
from tests.web.record_wire import recorded

DRAWN = """window.imuscopeReplay?.drawn.channels.value.some(channel => channel.ring.length > 20)
    && window.imuscopeReplay.near.channels.value.some(channel => channel.ring.length > 20)"""
FIRST = "document.querySelector('.recording-list tbody tr b a')"
NOTES = "document.querySelector('[data-panel=notes]')"
CHANNEL_AND_SIZE = struct.Struct("<4xI16xI")  # of a frame's header (web/src/wire/types.ts)


AS_IT_IS = {"reading": {}, "is_chosen": False, "is_table": False, "about": "", "problem": ""}
"""How a recording is read without choices."""


def answers() -> dict[str, Any]:
    """Windows of the recordings: all samples of the channels asked for, and health by device."""
    scene = recorded("recordings")
    results: dict[str, Any] = {}
    for name, whole in scene["windows"].items():
        frames: dict[str, bytes] = {}
        data, at = base64.b64decode(whole), 0
        while at < len(data):
            channel, size = CHANNEL_AND_SIZE.unpack_from(data, at)
            frames[str(channel)] = data[at : at + size]
            at += size

        def window(query: dict[str, list[str]], _: Any, frames: dict[str, bytes] = frames) -> bytes:
            return b"".join(frames.get(one, b"") for one in query["channels"][0].split(","))

        def health(query: dict[str, list[str]], _: Any, name: str = name) -> Any:
            return scene["answers"][f"GET /api/recordings/{name}/health?device={query['device'][0]}"]

        results |= {f"GET /api/recordings/{name}/window": window, f"GET /api/recordings/{name}/health": health}
        results[f"GET /api/recordings/{name}/reading"] = AS_IT_IS
    return results


def named_at_length(detail: Any) -> Any:
    """The same recording of a device whose name and serial number are as long as names may be."""
    first, *others = detail["devices"]
    name = "MTi-" + "long-" * 30
    return detail | {"devices": [first | {"name": name, "product": name, "serial_number": "0080" * 20}, *others]}


def test_a_desktop(open_page: Callable[..., Page]) -> None:
    """Nothing serious from axe on the library, an opened recording and its notes, and a long name has its room."""
    scene = recorded("recordings")
    notes = [one | {"notes": "Turn [09:46:42.000]"} for one in scene["answers"]["GET /api/recordings"]]
    long_names = named_at_length(scene["answers"]["GET /api/recordings/yard"])
    report = answers() | {"GET /api/recordings": notes, "GET /api/recordings/yard": long_names}
    with Story("recordings", answers=report) as story:
        page = story.open(open_page, "/#/recordings")
        until(page, f"{FIRST} !== null")
        page.locator(".recording-list tbody tr").first.click(position={"x": 30, "y": 20})
        assert serious(page) == []
        go_to(page, "#/recordings/yard")
        until(page, DRAWN)
        show(page, "Notes")
        until(page, f"{NOTES}?.querySelector('.notes-time') != null")
        assert serious(page) == []
        # Regression: a long serial number left no room for the name beside it and covered the plots.
        widths = page.evaluate(
            """['.ellipsis', '.count'].map(part => {
                const [row, box] = ['.categories button', `.categories button ${part}`].map(
                    (name) => document.querySelector(name).getBoundingClientRect());
                return [box.width / row.width, box.right <= row.right];
            })"""
        )
        assert all(0.2 < width < 0.7 and inside for width, inside in widths)


def test_a_phone(open_page: Callable[..., Page]) -> None:
    """A finger hits every control, 360 px do not scroll sideways, and notes are written with a thumb."""
    with Story("recordings", answers=answers()) as story:
        page = story.open(open_page, "/#/recordings", width=PHONE[0], height=PHONE[1], touch=True)
        until(page, f"{FIRST} !== null")
        for place in ("library", "replay"):
            if place == "replay":
                go_to(page, "#/recordings/yard")
                until(page, DRAWN)
            assert serious(page, colours=False) == []
            small = small_targets(page)
            assert not small, "\n".join(small)
            assert fits(page, width=360)
            page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
        show(page, "Notes", phone=True)
        until(page, f"{NOTES}?.querySelector('.btn') != null")
        page.locator("[data-panel=notes]").scroll_into_view_if_needed()
        page.locator("[data-panel=notes] .btn").tap()
        page.get_by_label("Notes of the recording").fill("Kerb")
        assert small_targets(page, NOTES) == []
        assert fits(page)
