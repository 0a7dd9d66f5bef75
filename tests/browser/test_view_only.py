"""The page with a view token: all that is enabled is pressed, and nothing asks for what the server refuses."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page, Response

from tests.browser.page_checks import DESKTOP, go_to
from tests.conftest import READY
from tests.support.chromium import SLOW_SCREEN, until
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

VIEW = "v" * 20

# Enabled controls, each with what tells it from others of the page: its frame and its words, without figures.
CONTROLS = """() => {
  const words = text => (text ?? "").replace(/[\\d.,:−-]+/g, "#").trim().slice(0, 50);
  window.controls = new Map();
  for (const one of document.querySelectorAll("button, summary, select, textarea, input, [role=tab]")) {
    if (!one.checkVisibility({checkVisibilityCSS: true}) || one.matches(":disabled, [readonly], [type=file]")) continue;
    if (document.querySelector("dialog[open]") && !one.closest("dialog[open]")) continue;
    const frame = one.closest("dialog, aside, form, section, header");
    const label = one.getAttribute("aria-label") ?? one.labels?.[0]?.textContent ?? one.textContent;
    const title = words(frame?.getAttribute("aria-label") ?? frame?.className);
    const name = [frame?.tagName, title, one.tagName, words(label)].join(" | ");
    if (!window.controls.has(name)) window.controls.set(name, one);
  }
  return [...window.controls.keys()];
}"""

# A field is typed into and left, a list gets its last entry, and everything else is clicked.
PRESS = """async name => {
  const one = window.controls.get(name);
  const say = kind => one.dispatchEvent(new Event(kind, {bubbles: true}));
  const isText = one.tagName === "TEXTAREA" || (one.tagName === "INPUT" && !["checkbox", "radio"].includes(one.type));
  if (one.tagName === "SELECT") one.selectedIndex = one.options.length - 1;
  if (one.tagName === "INPUT" && isText && one.type !== "range") one.value = one.type === "number" ? "5" : "x1";
  if (isText || one.tagName === "SELECT") { say("input"); say("change"); if (one.form) one.form.requestSubmit?.(); }
  else one.click();
  for (let n = 0; n < 2; n++) { window.drawSoon?.(); await new Promise(done => setTimeout(done, 15)); }
}"""
PLACES = (
    *("#/", "#/configure/1", "#/configure/1/RestoreFactoryDef", "#/configure/1/compare", "#/configure/1/restore"),
    *("#/configure/1/corrections", "#/recordings", "#/recordings/RECORDING"),
)


LAST = re.compile(r"Close|Cancel|theme|Dismiss")
"""What hides others is pressed after them."""
FOREIGN = re.compile(r"#D scene|Rerun|ASIDE \| Settings \| SELECT")
"""Viewers of others, which run programs of others; and another device, whose page has nothing to press."""


def walked(page: Page, place: str, note: Callable[[str], Any]) -> int:
    """Press everything that a place offers, and what comes to be offered by that; how much it was."""
    pressed: set[str] = set()
    visited: set[str] = set()
    go_to(page, place)
    until(page, "document.querySelector('.app:not([aria-busy])') !== null")
    while True:
        offered = [name for name in page.evaluate(CONTROLS) if not FOREIGN.search(name)]
        left = sorted(
            (name for name in offered if name not in pressed),
            key=lambda name: (bool(LAST.search(name)), name in visited),
        )
        visited.update(offered)
        if not left:
            if not page.evaluate("document.querySelector('dialog[open]') !== null"):
                return len(pressed)
            page.keyboard.press("Escape")
            until(page, "document.querySelector('dialog[open]') === null")
            continue
        pressed.add(left[0])
        note(f"{place}: {left[0]}")
        page.evaluate(PRESS, left[0])
        page.wait_for_timeout(20)  # its request, if it makes one, is reported meanwhile
        if not page.evaluate("location.hash").startswith(place.rstrip("/")[:12]):
            go_to(page, place)


def test_nothing_is_offered_that_the_server_would_refuse(
    tmp_path: Path, serve: Callable[..., ServerProcess], browser: Browser
) -> None:
    """Record, Remove, Calibrate, Connect and forty others were active, and the refusal came after the press."""
    settings = tmp_path / "imuscope.toml"
    settings.write_text(f'view_token = "{VIEW}"\n')
    server = serve("sim:xbus?product=MTi-680G", arguments=("--config", str(settings)))
    block_until(lambda: server.request("GET", "/api/devices")[0]["status"] == "live", "the device sends")
    server.request("POST", "/api/devices/1/read", {})
    recording = server.request("POST", "/api/recordings/start", {})["id"]
    block_until(lambda: server.request("GET", "/api/devices/1/values")["info"]["taken"], "its settings are read")
    server.request("POST", "/api/recordings/stop", {})
    now, refused = [""], []

    def note(response: Response) -> None:
        if response.status == 403:
            refused.append(f"{now[0]} -> {response.request.method} {response.url.removeprefix(server.url)}")

    with browser.new_context(
        viewport={"width": DESKTOP[0], "height": DESKTOP[1]}, reduced_motion="reduce", device_scale_factor=0.5
    ) as context:
        context.add_init_script(SLOW_SCREEN)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_S * 1000)
        page.on("response", note)
        context.on("page", lambda popup: popup.close())
        page.goto(f"{server.url}?token={VIEW}")
        until(page, READY)
        places = (place.replace("RECORDING", recording) for place in PLACES)
        total = sum(walked(page, place, lambda name: now.__setitem__(0, name)) for place in places)
    assert not refused, "\n".join(refused)
    assert total > 150
