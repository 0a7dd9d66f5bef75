"""Panels, plots of one's own, and measuring with real gestures on a page of recorded frames: dragged, drawn, kept by a
reload; and with a thumb.

Choices and words of each panel are tested beside it, in web/src and web/src/extensions; figures of the server against
numpy in test_measuring.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page

from tests.browser.page_checks import (
    DESKTOP,
    PHONE,
    click,
    drag,
    drawn,
    fits,
    press,
    reload,
    serious,
    show,
    small_targets,
)
from tests.browser.recorded.stories import Answer, Story
from tests.support.chromium import until

XY, HISTOGRAM = (f"document.querySelector('[data-panel={name}]')" for name in ("xy", "histogram"))
ABOUT = f"{XY}?.querySelector('.xy-foot')?.innerText"
INK = f"""(() => {{
  const canvas = {XY}.querySelector('canvas');
  const {{ data }} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let coloured = 0;
  for (let k = 0; k < data.length; k += 4)
    if (Math.abs(data[k] - data[k + 2]) > 60 && data[k + 3] > 120) coloured += 1;
  return coloured;
}})()"""
OUTLINES = f"{HISTOGRAM}?.querySelectorAll('path.bins').length"
TREE = "document.querySelector('.signals-panel')"
OWN = "[...document.querySelectorAll('.stack .remove-plot')].length"
SHEET = "document.querySelector('.arrange')"
KEYS = "[...document.querySelectorAll('.stack > .plot')].map(one => one.dataset.key).slice(0, 3).join(' ')"
HEIGHT = "Math.round(document.querySelector('.plot[data-key=RateOfTurn]').getBoundingClientRect().height)"
DEFAULT, CHANGED = "Acceleration RateOfTurn MagneticField", "RateOfTurn Acceleration MagneticField"
PANELS = "[...document.querySelectorAll('[data-panel]')].map(one => one.dataset.panel).join(' ')"
WIDTH = "Math.round(document.querySelector('.side').getBoundingClientRect().width)"
MEASURED = "document.querySelector('.measure')"
COUNTED = (
    f"{MEASURED} !== null && {MEASURED}.querySelector('.pending') === null && {MEASURED}.querySelector('td') !== null"
)
DIALOG = "document.querySelector('.packet')"
BYTES = f"{DIALOG}?.querySelector('tbody tr') != null"


def histogram(_: Any, body: Any) -> Answer:
    """Three columns of each signal, in two bins."""
    figures = {
        **{"edges": [1, 2, 3], "counts": [10, 30], "density": [0.25, 0.75], "n": 43, "below": 1, "above": 2},
        **{"mean": 2.2, "sigma": 0.4, "min": 0.5, "max": 3.5, "at_min": 1, "at_max": 2, "width": 1, "notes": []},
    }
    return [
        {"signal": signal, "device": "1", "units": {}, "figures": figures}
        for signal in body["signals"]
        for _ in range(3)
    ]


def frames(story: Story) -> Answer:
    """Bytes of a frame, and those around it."""
    frame = {
        **{"kind": "frame", "gap_ms": 10, "rank": 0, "size": 4, "hex": "fa0102c8", "name": "MTData2"},
        **{"title": "MTData2", "protocol": "xbus", "verdict": "Accepted.", "reason": "", "doc": "Measured data."},
        **{"source": "MT0101P 5.3.6", "fields": {"PacketCounter": 258}, "flags": {}},
        "spans": [
            {"offset": 0, "size": 1, "label": "preamble", "path": ""},
            {"offset": 1, "size": 2, "label": "PacketCounter: 258", "path": "PacketCounter"},
            {"offset": 3, "size": 1, "label": "checksum", "path": ""},
        ],
    }
    packets = [{**frame, "arrival": story.time - 1 + 0.01 * n} for n in range(3)]
    return {"device": "1", "protocol": "xbus", "at": 1, "time": story.time - 1, "packets": packets}


def story_of() -> Story:
    story = Story("xbus", answers={"POST /api/analysis/histogram": histogram})
    story.answers["GET /api/devices/1/frames"] = frames(story)
    return story


def opened(story: Story, open_page: Callable[..., Page], size: tuple[int, int]) -> Page:
    page = story.open(open_page, width=size[0], height=size[1], touch=size == PHONE)
    until(page, f"{KEYS} === '{DEFAULT}' && document.querySelector('[data-numeral]') !== null")
    page.evaluate("imuscope.view.value = {...imuscope.view.value, span: 2}")  # half a second of it was recorded
    drawn(page)
    return page


def area(page: Page) -> tuple[float, float, float]:
    """Left and right edge of the plots, and a height within the first one, px."""
    box = page.locator(".stack .plot > canvas").first.bounding_box()
    assert box is not None
    gutter, tail = (
        page.evaluate(f"parseFloat(getComputedStyle(document.querySelector('.stack')).getPropertyValue('{name}'))")
        for name in ("--gutter-w", "--tail-w")
    )
    return box["x"] + gutter, box["x"] + box["width"] - tail, box["y"] + box["height"] * 0.6


def where(page: Page, share: float) -> float:
    """Place of a share of the samples in the window, px: cursors snap to samples, and these are few of its seconds."""
    left, right, _ = area(page)
    begin, end, edge, span = page.evaluate(
        """(() => {
          const {ring} = imuscope.store.channels.value.find(({info}) => info.name === 'Acceleration');
          const {span, end, live} = imuscope.view.value, last = ring.time(ring.length - 1);
          const edge = live ? imuscope.store.edgeOf('1') : end;
          return [Math.max(ring.time(0), edge - span), Math.min(last, edge), edge, span];
        })()"""
    )
    time = begin + share * (end - begin)
    return float(right - (edge - time) / span * (right - left))


def test_a_page_is_arranged_with_the_mouse_and_kept(open_page: Callable[..., Page]) -> None:
    with story_of() as story:
        page = opened(story, open_page, DESKTOP)
        plots_are_moved_and_sized(page)
        panels_are_arranged(page)
        signals_are_plotted(page)
        press(page, "Escape", f"{TREE} === null")
        show(page, "XY plot", "Histogram")
        until(page, f"/[1-9].* samples? · same sample times/.test({ABOUT})")
        until(page, f"{INK} > 20 && {OUTLINES} === 3")
        for panel in (XY, HISTOGRAM):
            assert serious(page, panel) == []

        before = page.evaluate(f"[{PANELS}, {KEYS}, {WIDTH}, {HEIGHT}].join(' | ')")
        reload(page)
        until(page, f"[{PANELS}, {KEYS}, {WIDTH}, {HEIGHT}].join(' | ') === {before!r}")
        page.locator("[data-panel=xy] canvas").scroll_into_view_if_needed()  # the plots above keep their room
        until(page, f"{OWN} === 2 && {INK} > 20")
        page.keyboard.press("w")
        click(page, "button", "Default layout", f"{PANELS} === 'attitude plots values health alarms events'")


def plots_are_moved_and_sized(page: Page) -> None:
    height = page.evaluate(HEIGHT)
    drag(page, page.locator(".plot[data-key=RateOfTurn] .plot-title"), 0, -height)
    until(page, f"{KEYS} === '{CHANGED}'")
    drag(page, page.locator(".plot[data-key=RateOfTurn] .plot-edge"), 0, 60)
    until(page, f"Math.abs({HEIGHT} - {height + 60}) < 4")
    drawn(page)
    drawn(page)  # a plot has its height a frame later than the pointer
    sized = page.evaluate(HEIGHT)
    press(page, "w", f"{SHEET} !== null")  # the list of the workspace has the same for the keyboard
    click(page, "button", "Make Rate of turn taller", f"{HEIGHT} === {sized + 24}")
    click(page, "button", "Automatic height of Rate of turn", f"Math.abs({HEIGHT} - {height}) < 4")


def panels_are_arranged(page: Page) -> None:
    width = page.evaluate(WIDTH)
    page.get_by_label("Place of Events").select_option("main")
    until(page, f"{PANELS} === 'attitude plots events values health alarms'")
    drag(page, page.get_by_role("separator", name="Width of the side column"), -120, 0)
    until(page, f"Math.abs({WIDTH} - {width + 120}) < 3")
    row = page.locator("[data-row=health] .grip")
    to, at = page.locator("[data-row=values]").bounding_box(), row.bounding_box()
    assert to is not None
    assert at is not None
    drag(page, row, 0, to["y"] - at["y"] - 5)
    until(page, f"{PANELS} === 'attitude plots events health values alarms'")
    press(page, "Escape", f"{SHEET} === null")
    page.locator("[data-panel=values] h2").dblclick()
    until(page, f"document.querySelector('.maximised')?.clientWidth === {DESKTOP[0]}")
    press(page, "Escape", "document.querySelector('.maximised') === null")


def signals_are_plotted(page: Page) -> None:
    """In two actions, and by dragging: under the plots, and onto one, which gets a second axis."""
    page.keyboard.press("s")  # 1
    click(page, "button", "Plot Acceleration on a new plot", f"{OWN} === 1")  # 2
    page.get_by_role("treeitem", name="Rate of turn").drag_to(page.locator(".stack .more-quantities"))
    until(page, f"{OWN} === 2")
    own = page.locator(".stack .plot", has=page.locator(".remove-plot")).first
    page.get_by_role("treeitem", name="Rate of turn").drag_to(own)
    until(page, "document.querySelector('.y-gutter.right') !== null")
    page.get_by_role("treeitem", name="Magnetic field").drag_to(own)
    until(page, f"{TREE}.querySelector('[role=status]').innerText.includes('Put it on a new plot')")
    assert serious(page, TREE, colours=False) == []


def test_clicks_measure_and_lead_to_the_bytes(open_page: Callable[..., Page]) -> None:
    """Two clicks measure, cursors are dragged, one key measures; one action leads to the bytes, and one back."""
    with story_of() as story:
        page = opened(story, open_page, DESKTOP)
        left, right, y = area(page)
        page.mouse.click(where(page, 0.3), y)
        page.keyboard.down("Shift")
        page.mouse.click(where(page, 0.6), y)
        page.keyboard.up("Shift")
        click(page, "button", "Pause", COUNTED)
        assert serious(page, MEASURED) == []
        drawn(page)  # the window as paused
        span, end, b = page.evaluate("[imuscope.view.value.span, imuscope.view.value.end, imuscope.measure.value]")
        left, right, y = area(page)
        x = right - (end - b) / span * (right - left)
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x - 30, y, steps=4)
        page.mouse.up()
        moved = page.evaluate("imuscope.measure.value")
        assert moved == pytest.approx(b - 30 * span / (right - left), abs=2 * span / (right - left))
        page.get_by_role("button", name="Snap to samples").click()
        until(
            page,
            """imuscope.store.channels.value.some(({info, ring}) => info.name === 'Acceleration'
                && Array.from({length: ring.length}, (_, i) => ring.time(i)).includes(imuscope.measure.value))""",
        )
        press(page, "Escape", f"{MEASURED} === null")
        page.get_by_role("button", name="Live", exact=True).click()
        press(page, "b", COUNTED)
        press(page, "b", f"{MEASURED} === null")

        page.mouse.click(where(page, 0.4), area(page)[2], button="right")
        until(page, BYTES)
        assert any(one.startswith("GET /api/devices/1/frames?") for one in story.requests)
        assert serious(page, "document.querySelector('dialog')") == []
        click(page, "button", "Show in plot", f"{DIALOG} === null && imuscope.cursor.value?.kind === 'pinned'")


def test_a_thumb_arranges_plots_and_measures(open_page: Callable[..., Page]) -> None:
    with story_of() as story:
        page = opened(story, open_page, PHONE)
        a_thumb_measures_and_reads_bytes(page)
        show(page, "XY plot", "Histogram", phone=True)
        until(page, f"/same sample times/.test({ABOUT})")
        until(page, f"{OUTLINES} === 3")
        assert fits(page)
        for panel in (XY, HISTOGRAM):
            assert small_targets(page, panel) == []
        page.locator(".xy").scroll_into_view_if_needed()
        until(page, f"{INK} > 20")
        a_thumb_plots_signals(page)
        a_thumb_arranges(page)


def a_thumb_measures_and_reads_bytes(page: Page) -> None:
    y = area(page)[2]
    page.touchscreen.tap(where(page, 0.3), y)
    finger = page.context.new_cdp_session(page)
    place = {"x": where(page, 0.6), "y": y}
    finger.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [place]})
    until(page, "imuscope.measure.value !== undefined")
    finger.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    until(page, COUNTED)
    assert page.evaluate("document.scrollingElement.scrollWidth") <= PHONE[0]
    assert small_targets(page, MEASURED) == []
    press(page, "p", BYTES)
    width = "document.querySelector('dialog').scrollWidth - document.querySelector('dialog').clientWidth"
    assert page.evaluate(width) <= 0
    press(page, "Escape", f"{DIALOG} === null")


def a_thumb_plots_signals(page: Page) -> None:
    page.get_by_role("button", name="All signals…").click()
    page.get_by_role("treeitem", name="Acceleration").first.click()
    click(page, "button", "New plot", f"{OWN} === 1", exact=True)
    assert fits(page)
    assert small_targets(page, TREE) == []
    click(page, "button", "Close", f"{TREE} === null", exact=True)
    page.locator(".stack .remove-plot").first.click()
    until(page, f"{OWN} === 0")


def a_thumb_arranges(page: Page) -> None:
    page.locator(".arrange-phone").tap()
    until(page, f"{SHEET} !== null")
    page.get_by_role("button", name="Move Acceleration down").tap()
    until(page, f"{KEYS} === '{CHANGED}'")
    assert fits(page)
    assert small_targets(page, SHEET) == []
    page.get_by_label("Place of Values").select_option("hidden")
    until(page, "document.querySelector('[data-panel=values]') === null")
    page.get_by_label("Maximize Plots").tap()
    until(page, f"document.querySelector('.maximised')?.clientWidth === {PHONE[0]}")
    page.get_by_role("button", name="Restore panel").tap()
    until(page, "document.querySelector('.maximised') === null")
