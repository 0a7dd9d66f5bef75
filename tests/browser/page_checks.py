"""Looks at a page: accessibility, targets for a finger, room at a width, and where everything stands."""

from collections.abc import Callable
from typing import Any, Literal

from playwright.sync_api import Locator, Page

from tests.conftest import READY
from tests.support.chromium import until
from tests.support.server_process import ROOT, ServerProcess

AXE = ROOT / "web" / "node_modules" / "axe-core" / "axe.min.js"
DESKTOP, PHONE = (1440, 900), (390, 844)
ClickedRole = Literal["button", "link"]
SILENT = "udp://:0"
"""A link on which nothing comes. A server without any source shows three simulators, which take a third of a core."""

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


# While a page is looked at nothing is drawn: drawing took most of the time.
AUDIT = """async (options) => {
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
    messages = []
    themes: dict[str, dict[str, Any]] = {"dark": {}, "light": CONTRAST} if colours else {"dark": NO_CONTRAST}
    for theme, options in themes.items():
        page.emulate_media(color_scheme=theme, reduced_motion="reduce")  # type: ignore[arg-type]
        until(page, f"document.documentElement.dataset.theme === {theme!r}")
        until(page, STILL)
        results = page.evaluate(AUDIT.replace("PLACE", place), options)
        messages += [
            f"{theme}: {rule['id']}: {rule['help']}: {node['html'][:120]}"
            for rule in results["violations"]
            if rule["impact"] in ("serious", "critical")
            for node in rule["nodes"]
        ]
    return messages


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
      const tag = element.cloneNode(false);
      for (const name of ["width", "height"]) tag.removeAttribute(name); // a canvas has these once it is drawn
      return `${tag.outerHTML.slice(0, 90)} ${place}`;
    });
}"""


# Add up in `shift` how far what is on the page moves by itself.
WATCH = """() => {
  window.shift = 0;
  new PerformanceObserver(list => { for (const entry of list.getEntries()) window.shift += entry.value; })
    .observe({type: "layout-shift"});
}"""


def small_targets(page: Page, place: str = "document") -> list[str]:
    """Controls in a place that a finger may miss."""
    return list(page.evaluate(TARGETS.replace("document.querySelectorAll", f"{place}.querySelectorAll")))


def fits(page: Page, *, width: int = PHONE[0], place: str = "document.scrollingElement") -> bool:
    """Whether the page, or a place on it, does not scroll sideways at this width."""
    if page.viewport_size and page.viewport_size["width"] != width:
        page.set_viewport_size({"width": width, "height": page.viewport_size["height"]})
        drawn(page)
    return bool(page.evaluate(f"{place}.scrollWidth <= {width}"))


def opened(
    server: ServerProcess, open_page: Callable[..., Page], size: tuple[int, int] = DESKTOP, **options: Any
) -> Page:
    """The page of `server` with samples on it."""
    page = open_page(server.url, width=size[0], height=size[1], touch=size == PHONE, **options)
    until(page, READY)
    return page


def go_to(page: Page, place: str) -> None:
    """To another place of the page, as soon as it is drawn."""
    page.evaluate("place => { location.hash = place; }", place)
    drawn(page)


def press(page: Page, key: str, then: str) -> None:
    """Press a key, and wait until its effect holds."""
    page.keyboard.press(key)
    until(page, then)


def click(page: Page, role: ClickedRole, name: str, then: str, *, exact: bool = False) -> None:
    """Click a control, and wait until its effect holds."""
    page.get_by_role(role, name=name, exact=exact).click()
    until(page, then)


def drawn(page: Page) -> None:
    """Wait until the page has been drawn as it is now."""
    page.evaluate("""async () => {
      for (let n = 0; n < 2; n++) {
        const frame = new Promise(requestAnimationFrame);
        window.drawSoon?.();  // where the screen is slow
        await frame;
      }
    }""")


def reload(page: Page) -> None:
    """Reload a page once its address holds the view, which it follows within a fraction of a second."""
    until(page, "window.imuscopeAddress?.()")
    page.reload()


def drag(page: Page, handle: Locator, dx: float, dy: float) -> None:
    """Move something with the mouse."""
    box = handle.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=4)
    page.mouse.up()


def show(page: Page, *panels: str, phone: bool = False) -> None:
    """Show panels from the list of the workspace."""
    if phone:
        page.locator(".arrange-phone").tap()
    else:
        page.keyboard.press("w")
    for panel in panels:
        page.get_by_role("button", name=f"Show {panel}", exact=True).click()
    if phone:
        page.get_by_text("Done", exact=True).tap()
    else:
        page.keyboard.press("Escape")


def first_five_plots(page: Page) -> list[tuple[int, int]]:
    """Upper and lower edges of the first plots, once they are drawn, px."""
    until(page, "document.querySelectorAll('#plots .plot canvas').length >= 5")
    drawn(page)
    drawn(page)  # the attitude gives them room in the frame after they have asked for it
    boxes = page.evaluate(
        """[...document.querySelectorAll('#plots .plot')].slice(0, 5).map(one => {
          const {top, bottom} = one.getBoundingClientRect();
          return [Math.round(top), Math.round(bottom)];
        })"""
    )
    return [(top, bottom) for top, bottom in boxes]
