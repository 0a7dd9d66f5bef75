"""The library and an opened recording, from recorded answers: accessibility, and room on a phone."""

from __future__ import annotations

import base64
import struct
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import DESKTOP, PHONE, fits, go_to, serious, show, small_targets
from tests.browser.stories import Story
from tests.chromium import until
from tests.record_wire import recorded

DRAWN = """window.imuscopeReplay?.drawn.channels.value.some(channel => channel.ring.length > 20)
    && window.imuscopeReplay.near.channels.value.some(channel => channel.ring.length > 20)"""
NOTES = "document.querySelector('[data-panel=notes]')"
CHANNEL_AND_SIZE = struct.Struct("<4xI16xI")  # of a frame's header (web/src/wire/types.ts)


def answers() -> dict[str, Any]:
    """Windows of the recordings: all samples of the channels asked for, and health by device."""
    scene = recorded("recordings")
    found: dict[str, Any] = {}
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

        found |= {f"GET /api/recordings/{name}/window": window, f"GET /api/recordings/{name}/health": health}
    return found


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_the_pages_are_accessible(open_page: Callable[..., Page], size: tuple[int, int]) -> None:
    """Nothing serious from axe; on a phone a finger hits every control, and 360 px do not scroll sideways."""
    is_phone = size == PHONE
    with Story("recordings", answers=answers()) as story:
        page = story.open(open_page, "/#/recordings", width=size[0], height=size[1], touch=is_phone)
        until(page, "document.querySelector('.recording-list tbody tr b a') !== null")
        for place in ("library", "replay"):
            if place == "replay":
                go_to(page, "#/recordings/yard")
                until(page, DRAWN)
            elif not is_phone:
                page.locator(".recording-list tbody tr").first.click(position={"x": 30, "y": 20})
            assert serious(page, colours=not is_phone) == []
            if is_phone:
                small = small_targets(page)
                assert not small, "\n".join(small)
                assert fits(page, width=360)
                page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
        if is_phone:  # notes are written with a thumb
            show(page, "Notes", phone=True)
            until(page, f"{NOTES}?.querySelector('.btn') != null")
            page.locator("[data-panel=notes]").scroll_into_view_if_needed()
            page.locator("[data-panel=notes] .btn").tap()
            page.get_by_label("Notes of the recording").fill("Kerb")
            assert small_targets(page, NOTES) == []
            assert fits(page)
