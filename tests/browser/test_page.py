"""The page's design standard (design, section 10), in a real browser with a streaming simulator.

No serious finding of axe-core in either theme and at either width; 360 px without sideways scrolling; targets that a
finger can hit; nothing that moves while digits change; a reload that has its past at once. Keys, bar and dialogs are
tested without a browser, in web/src/pages/top-bar.test.tsx and dialogs.test.tsx.
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
  const enough = 43.5;
  const isHit = (element, x, y) => {
    const hit = document.elementFromPoint(x, y);
    return hit !== null && (hit === element || element.contains(hit));
  };
  const reach = (element, x, y, dx, dy) => {
    for (let step = 44; step > 0; step--) if (isHit(element, x + dx * step, y + dy * step)) return step;
    return 0;
  };
  const across = (element, x, y, dx, dy) => {
    const half = 22; // most are hit as far as needed to both sides: the rest is measured
    if (isHit(element, x - dx * half, y - dy * half) && isHit(element, x + dx * half, y + dy * half)) return enough;
    return reach(element, x, y, -dx, -dy) + 1 + reach(element, x, y, dx, dy);
  };
  const found = [];
  const controls = "button, a[href], input, select, summary, [role=button], [role=tab], [role=switch]";
  for (const element of document.querySelectorAll(controls)) {
    if (!element.checkVisibility({checkOpacity: true, checkVisibilityCSS: true}) || element.disabled) continue;
    if (getComputedStyle(element).pointerEvents === "none") continue; // for the keyboard: what lies under it is touched
    const {width: wide, height: high} = element.getBoundingClientRect();
    if (wide === 0 || high === 0 || (wide >= enough && high >= enough)) continue; // what lies beside it adds nothing
    element.scrollIntoView({block: "center", inline: "nearest"});
    const box = element.getBoundingClientRect();
    const x = box.x + box.width / 2, y = box.y + box.height / 2;
    if (document.elementFromPoint(x, y) === null) continue;
    const width = box.width >= enough ? box.width : across(element, x, y, 1, 0);
    const height = box.height >= enough ? box.height : across(element, x, y, 0, 1);
    if (width < enough || height < enough)
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


def reload(page: Page) -> None:
    """Reload a page once its address holds the view, which it follows within a fraction of a second."""
    until(page, "window.imuscopeAddress?.()")
    page.reload()


# While a page is looked at nothing is drawn: drawing took most of the time.
LOOK = """async (options) => {
  const draw = window.requestAnimationFrame, held = [];
  window.requestAnimationFrame = frame => held.push(frame);
  try { return await axe.run(PLACE, {resultTypes: ["violations"], ...options}); }
  finally { window.requestAnimationFrame = draw; held.forEach(frame => draw(frame)); }
}"""


STILL = """document.getAnimations().every(
    one => one.playState !== 'running' || one.effect.getComputedTiming().iterations === Infinity)"""
CONTRAST = {"runOnly": ["color-contrast"]}
NO_CONTRAST = {"rules": {"color-contrast": {"enabled": False}}}


def serious(page: Page, place: str = "document", *, colours: bool = True) -> list[str]:
    """Findings of axe-core that keep someone from using the page.

    Args:
        colours: check contrast in both themes, which takes most of the time. False where the page has colours that
        are checked elsewhere.
    """
    if page.evaluate("window.axe === undefined"):
        page.evaluate(AXE.read_text())
    told = []
    themes: dict[str, dict[str, Any]] = {"dark": {}, "light": CONTRAST} if colours else {"dark": NO_CONTRAST}
    for theme, options in themes.items():
        page.emulate_media(color_scheme=theme, reduced_motion="reduce")  # type: ignore[arg-type]
        until(page, f"document.documentElement.dataset.theme === {theme!r}")
        until(page, STILL)
        found = page.evaluate(LOOK.replace("PLACE", place), options)
        told += [
            f"{theme}: {rule['id']}: {rule['help']}: {node['html'][:120]}"
            for rule in found["violations"]
            if rule["impact"] in ("serious", "critical")
            for node in rule["nodes"]
        ]
    return told


def test_axe_finds_nothing_serious_and_it_is_still_when_asked_to_be(
    server: ServerProcess, open_page: Callable[..., Page]
) -> None:
    page = opened(server, open_page, DESKTOP, still=True)
    moving = page.evaluate("document.getAnimations().filter(a => a.playState === 'running').length")
    assert moving == 0
    assert serious(page) == []


def test_everything_is_reachable_on_a_phone(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    """Nothing serious from axe, a finger hits every control, and 360 px do not scroll sideways."""
    page = opened(server, open_page, PHONE)
    assert serious(page, colours=False) == []
    small = page.evaluate(TARGETS)
    assert not small, "\n".join(small)
    page.evaluate("scrollTo(0, 0)")
    page.set_viewport_size({"width": 360, "height": 740})
    assert page.evaluate("document.scrollingElement.scrollWidth") <= 360
    page.mouse.wheel(400, 0)
    assert page.evaluate("scrollX") == 0


@pytest.mark.parametrize("place", ["", "configure"], ids=["live", "configure"])
def test_the_panels_of_a_tablet_lie_over_the_page(
    server: ServerProcess, open_page: Callable[..., Page], place: str
) -> None:
    """At its edge, from the bar to the foot of the window; nothing moves below it."""
    page = opened(server, open_page, (1000, 800))
    page.evaluate(f"location.hash = '#/{place}'")
    box = "(e => e && (({x, y, right, bottom}) => [x, y, right, bottom])(e.getBoundingClientRect()))"
    middle = f"{box}(document.querySelector('main'))"
    until(page, f"{middle} !== null && document.querySelector('.bar [aria-controls=rail]') !== null")
    before = page.evaluate(middle)
    for name in ("rail", "side"):
        toggle = page.locator(f".bar [aria-controls={name}]:visible").first
        toggle.click()
        x, y, right, bottom = until(page, f"{box}(document.querySelector('.{name}.open'))")
        assert (x if name == "rail" else right) == (0 if name == "rail" else 1000)
        assert (y, bottom) == (page.locator(".bar").evaluate("e => e.getBoundingClientRect().bottom"), 800)
        assert page.evaluate(middle) == before
        toggle.click()


# Where every box on the page is, but for those that are as wide as the digits in them, the lines of the event list (a
# busy machine is told of late reads and lost samples, each a line more; that list scrolls by itself), and the names of
# lanes: the simulator clips at a kerb, and a flag that is raised for the first time gets its name in the room kept for
# it.
BOXES = """() => {
  const text = ["SPAN", "B", "I", "DD", "SUP", "SUB", "KBD", "CODE", "BR"];
  return [...document.querySelectorAll("body *")]
    .filter(element => !text.includes(element.tagName) && !element.closest("svg, .event-list, .lane-names"))
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
    page.wait_for_timeout(2500)  # rare messages of a device and the first events have appeared
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


def test_a_reload_restores_history_at_once(server: ServerProcess, open_page: Callable[..., Page]) -> None:
    page = open_page(server.url)
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


def test_tab_reaches_controls_and_shows_the_focus(page: Page) -> None:
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


def test_a_lane_describes_itself_to_pointer_keyboard_and_touch(
    server: ServerProcess, open_page: Callable[..., Page]
) -> None:
    """A finger's question was answered and wiped away at once, as the finger was lifted."""
    page = open_page(server.url, width=390, height=844, touch=True)
    until(page, READY)
    until(page, "document.querySelectorAll('.lane-names button').length > 2")
    page.evaluate("document.querySelector('.lane-box').scrollIntoView({block: 'center'})")
    page.wait_for_timeout(300)
    box = page.locator(".lane-box").bounding_box()
    assert box
    page.touchscreen.tap(200, box["y"] + 17 * 1.5)
    until(page, "document.querySelector('.lane-description').innerText.length > 20")
    wide = open_page(server.url)
    until(wide, READY)
    until(wide, "document.querySelectorAll('.lane-names button').length > 2")
    wide.locator(".lane-names button").nth(1).focus()
    until(wide, "document.querySelector('.lane-description').innerText.length > 20")
    by_key = wide.inner_text(".lane-description b").split(":")[0]
    wide.locator(".lane-names button").nth(1).blur()
    until(wide, "document.querySelector('.lane-description').innerText === ''")
    box = wide.locator(".lane-box").bounding_box()
    assert box
    wide.mouse.move(box["x"] + 600, box["y"] + 17 * 1.5)
    until(wide, f"document.querySelector('.lane-description b')?.innerText.startsWith({by_key!r})")
