"""The page's own standard (design, section 10), in a real browser with the twin streaming.

No serious finding of axe-core in either theme and at either width; 360 px without sideways scrolling; targets that a
finger can hit; nothing that moves while digits change; every control by keyboard; a reload that has its past at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page

from tests.chromium import until
from tests.conftest import READY
from tests.server_process import ROOT, ServerProcess

AXE = ROOT / "web" / "node_modules" / "axe-core" / "axe.min.js"
DESKTOP, PHONE = (1440, 900), (390, 844)

# Controls a person can see, with how far a finger may miss their middle and still hit them, px to each side.
TARGETS = """() => {
  const reach = (element, x, y, dx, dy) => {
    for (let step = 44; step > 0; step--) {
      const hit = document.elementFromPoint(x + dx * step, y + dy * step);
      if (hit && (hit === element || element.contains(hit))) return step;
    }
    return 0;
  };
  const found = [];
  const controls = "button, a[href], input, select, summary, [role=button], [role=tab], [role=switch]";
  for (const element of document.querySelectorAll(controls)) {
    if (!element.checkVisibility({checkOpacity: true, checkVisibilityCSS: true}) || element.disabled) continue;
    if (getComputedStyle(element).pointerEvents === "none") continue; // for the keyboard: what lies under it is touched
    element.scrollIntoView({block: "center", inline: "nearest"});
    const box = element.getBoundingClientRect();
    if (box.width === 0 || box.height === 0) continue;
    const x = box.x + box.width / 2, y = box.y + box.height / 2;
    if (document.elementFromPoint(x, y) === null) continue;
    const width = Math.max(box.width, reach(element, x, y, -1, 0) + 1 + reach(element, x, y, 1, 0));
    const height = Math.max(box.height, reach(element, x, y, 0, -1) + 1 + reach(element, x, y, 0, 1));
    if (width < 43.5 || height < 43.5)
      found.push(`${element.outerHTML.slice(0, 90)}: ${width.toFixed(1)} × ${height.toFixed(1)}`);
  }
  return found;
}"""


def opened(server: ServerProcess, open_page: Callable[..., Page], size: tuple[int, int], **options: Any) -> Page:
    """The page of `server` with samples on it."""
    page = open_page(server.url, width=size[0], height=size[1], touch=size == PHONE, **options)
    until(page, READY)
    page.wait_for_timeout(500)
    return page


# While a page is looked at nothing is drawn: drawing took most of the time.
LOOK = """async (options) => {
  const draw = window.requestAnimationFrame, held = [];
  window.requestAnimationFrame = frame => held.push(frame);
  try { return await axe.run(PLACE, {resultTypes: ["violations"], ...options}); }
  finally { window.requestAnimationFrame = draw; held.forEach(frame => draw(frame)); }
}"""


def serious(page: Page, place: str = "document") -> list[str]:
    """What axe-core finds in the page as it stands that keeps somebody from using it; its colours in both themes."""
    if page.evaluate("window.axe === undefined"):
        page.evaluate(AXE.read_text())
    told = []
    for theme, options in (("dark", {}), ("light", {"runOnly": ["color-contrast"]})):
        page.emulate_media(color_scheme=theme, reduced_motion="reduce")  # type: ignore[arg-type]
        page.wait_for_timeout(200)
        found = page.evaluate(LOOK.replace("PLACE", place), options)
        told += [
            f"{theme}: {rule['id']}: {rule['help']}: {node['html'][:120]}"
            for rule in found["violations"]
            if rule["impact"] in ("serious", "critical")
            for node in rule["nodes"]
        ]
    return told


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_axe_finds_nothing_serious(
    server: ServerProcess, open_page: Callable[..., Page], size: tuple[int, int]
) -> None:
    assert serious(opened(server, open_page, size)) == []


def test_360_px_do_not_scroll_sideways(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = opened(server, open_page, (360, 740))
    assert page.evaluate("document.scrollingElement.scrollWidth") <= 360
    page.mouse.wheel(400, 0)
    assert page.evaluate("scrollX") == 0


def test_a_finger_hits_every_control(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = opened(server, open_page, PHONE)
    small = page.evaluate(TARGETS)
    assert not small, "\n".join(small)


# Where every box on the page is, but for those that are as wide as the digits in them, the lines of the event list (a
# busy machine is told of late reads and lost samples, each a line more; that list scrolls by itself), and the names of
# lanes: the twin clips at a kerb, and a flag that is raised for the first time gets its name in the room kept for it.
BOXES = """() => {
  const text = ["SPAN", "B", "I", "DD", "SUP", "SUB", "KBD", "CODE", "BR"];
  return [...document.querySelectorAll("body *")]
    .filter(element => !text.includes(element.tagName) && !element.closest("svg, .news, .lanenames"))
    .map(element => {
      const {x, y, width, height} = element.getBoundingClientRect();
      const place = [x, y, width, height].map(value => value.toFixed(1));
      return `${element.cloneNode(false).outerHTML.slice(0, 90)} ${place}`;
    });
}"""


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_nothing_moves_while_values_change(
    server: ServerProcess, open_page: Callable[..., Page], size: tuple[int, int]
) -> None:
    page = opened(server, open_page, size)
    page.wait_for_timeout(2500)  # what a device sends seldom has appeared, and the first events have
    page.evaluate("""() => {
      window.shift = 0;
      new PerformanceObserver(list => { for (const entry of list.getEntries()) window.shift += entry.value; })
        .observe({type: "layout-shift"});
    }""")
    before = page.evaluate(BOXES)
    for _ in range(6):
        page.wait_for_timeout(400)
        after = page.evaluate(BOXES)
        moved = [f"{one}  ->  {other}" for one, other in zip(before, after, strict=False) if one != other]
        assert len(before) == len(after), "elements came or went"
        assert not moved, "\n".join(moved[:20])
    assert page.evaluate("window.shift") < 0.01


def test_a_reload_has_its_past_at_once(serve: Callable[..., ServerProcess], open_page: Callable[..., Page]) -> None:
    page = open_page(serve("twin:xbus").url)
    held = """() => {
      const ring = window.imuscope?.store.channels.value.find(c => c.info.name === "Acceleration")?.ring;
      return ring?.length ? ring.time(ring.length - 1) - ring.time(0) : 0;
    }"""
    until(page, f"({held})() > 4")
    page.reload()
    # Samples that are older than the page that shows them: waiting does not bring these. Live ones may come first.
    before = """() => {
      const {store} = window.imuscope, ring = store.channels.value.find(c => c.info.name === "Acceleration")?.ring;
      const born = store.serverNow() - performance.now() / 1000;
      return ring?.length ? born - ring.time(0) : -Infinity;
    }"""
    until(page, "window.imuscope?.store.connection.value === 'open'")
    until(page, f"({before})() > 3")


def view_of(page: Page) -> dict[str, Any]:
    """What the page is looking at."""
    return page.evaluate("window.imuscope.view.value")  # type: ignore[no-any-return]


def test_every_view_control_has_its_key(page: Page) -> None:
    until(page, "window.imuscope.view.value.device !== undefined")
    assert view_of(page)["live"]
    page.keyboard.press("Space")
    paused = view_of(page)
    assert not paused["live"]
    page.keyboard.press("ArrowLeft")
    back = view_of(page)
    assert back["end"] == pytest.approx(paused["end"] - paused["span"] / 10, abs=0.05 * paused["span"])
    page.keyboard.press("+")
    assert view_of(page)["span"] < back["span"]
    page.keyboard.press("-")
    page.keyboard.press("End")
    assert view_of(page)["live"]
    span = view_of(page)["span"]
    page.keyboard.press("]")
    assert view_of(page)["span"] > span
    page.keyboard.press("[")
    assert view_of(page)["span"] == span
    base = view_of(page)["timeBase"]
    page.keyboard.press("t")
    assert view_of(page)["timeBase"] != base
    page.keyboard.press("t")
    page.keyboard.press("?")
    page.wait_for_selector("[role=dialog], dialog[open]")
    page.keyboard.press("Escape")
    page.wait_for_selector("[role=dialog], dialog[open]", state="hidden")


def test_tab_reaches_controls_and_shows_where_it_is(page: Page) -> None:
    seen = set()
    for _ in range(12):
        page.keyboard.press("Tab")
        ring = page.evaluate("""() => {
          const element = document.activeElement, style = getComputedStyle(element);
          return [element.outerHTML.slice(0, 80), style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 2];
        }""")
        seen.add(ring[0])
        assert ring[1], f"no focus ring on {ring[0]}"
    assert len(seen) > 5


def test_still_when_asked_to_be(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = opened(server, open_page, DESKTOP, still=True)
    moving = page.evaluate("document.getAnimations().filter(a => a.playState === 'running').length")
    assert moving == 0


def test_a_lane_says_what_it_means_to_pointer_keyboard_and_finger(
    server: ServerProcess, open_page: Callable[..., Page]
) -> None:
    """A finger's question was answered and wiped away at once, as the finger was lifted."""
    page = open_page(server.url, width=390, height=844, touch=True)
    until(page, READY)
    until(page, "document.querySelectorAll('.lanenames button').length > 2")
    page.evaluate("document.querySelector('.lanebox').scrollIntoView({block: 'center'})")
    page.wait_for_timeout(300)
    box = page.locator(".lanebox").bounding_box()
    assert box
    page.touchscreen.tap(200, box["y"] + 17 * 1.5)
    until(page, "document.querySelector('.lanesay').innerText.length > 20")
    wide = open_page(server.url)
    until(wide, READY)
    until(wide, "document.querySelectorAll('.lanenames button').length > 2")
    wide.locator(".lanenames button").nth(1).focus()
    until(wide, "document.querySelector('.lanesay').innerText.length > 20")
    by_key = wide.inner_text(".lanesay b").split(":")[0]
    wide.locator(".lanenames button").nth(1).blur()
    until(wide, "document.querySelector('.lanesay').innerText === ''")
    box = wide.locator(".lanebox").bounding_box()
    assert box
    wide.mouse.move(box["x"] + 600, box["y"] + 17 * 1.5)
    until(wide, f"document.querySelector('.lanesay b')?.innerText.startsWith({by_key!r})")
