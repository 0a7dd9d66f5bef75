"""Chromium for the tests: find or install it.

    IMUSCOPE_CHROMIUM ─> on the path ─> usual places ─> Playwright's own download ─> the distribution's package

The first that starts is taken, a headless shell before all others: the same engine without menus and an address bar,
which take a quarter of the processor time of a page. Measurements are of a whole one (`required`). Only the last two
change anything on the machine, and only `provide` (called by tests/check.py) goes that far; a plain `pytest` takes what
`find` finds.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tests.support.timeouts import PATIENCE_S

if TYPE_CHECKING:
    from playwright.sync_api import Frame, Page

SHELLS = ("chromium-headless-shell", "chrome-headless-shell")
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PLACES = (
    "/usr/bin",
    "/usr/local/bin",
    "/snap/bin",
    "/opt/google/chrome",
    "/usr/lib/chromium",
    "/usr/lib/chromium-browser",
)
MAC = "/Applications/{0}.app/Contents/MacOS/{0}"

# No sandbox as root, where Chromium refuses to have one; no /dev/shm, which containers keep too small.
ARGUMENTS = ["--disable-dev-shm-usage", "--force-color-profile=srgb", "--font-render-hinting=none"]
REBOUND = "rebound.example"  # a name of somebody else that leads to this machine, as after DNS rebinding
ARGUMENTS.append(f"--host-resolver-rules=MAP {REBOUND} 127.0.0.1")
if hasattr(os, "geteuid") and os.geteuid() == 0:
    ARGUMENTS.append("--no-sandbox")
# What a browser without a window does for its address bar takes a second of a core for every page. This replaces what
# Playwright turns off, so that these are turned off here too.
NOT_WANTED = (
    *("WebUIOmniboxPopup", "WebUIOmniboxAimPopup", "WebUIOmniboxFullPopup"),
    *("AvoidUnnecessaryBeforeUnloadCheckSync", "DestroyProfileOnBrowserClose", "HttpsUpgrades"),
    *(
        "HttpsFirstBalancedModeAutoEnable",
        "LensOverlay",
        "MediaRouter",
        "PaintHolding",
        "ThirdPartyStoragePartitioning",
    ),
    *("AvoidCorsURLLoaderRestartOnRedirect", "OptimizationHints", "NetworkTimeServiceQuerying", "AimEnabled"),
    "PreconnectToSearch",
)
ARGUMENTS.append(f"--disable-features={','.join(NOT_WANTED)}")

NOT_THE_FIRST_MINUTE = "try { localStorage.setItem('imuscope.first-minute', 'dismissed') } catch {}"
"""Runs before a page: its line on simulators has been dismissed."""

# A screen of three frames a second, and of one more when `drawSoon` is called. Without a graphics card the processor
# paints, 40 ms for a frame: at the sixty that Chromium asks for, each page that a test opens takes a core and makes the
# others late.
SLOW_SCREEN = """(() => {
  const draw = window.requestAnimationFrame.bind(window);
  const waiting = new Map();
  let last = 0, due = 0;
  const all = now => {
    due = 0;
    const painters = [...waiting.values()];
    waiting.clear();
    for (const paint of painters) paint(now);
  };
  window.requestAnimationFrame = paint => {
    waiting.set(++last, paint);
    due ||= setTimeout(() => draw(all), 333);
    return last;
  };
  window.drawSoon = () => {
    clearTimeout(due);
    draw(all);
  };
  window.cancelAnimationFrame = id => { waiting.delete(id); };
})()"""


@cache
def find() -> Path | None:
    """A Chromium that is on this machine already and starts, or None; a headless shell if there is one."""
    return _first(is_shell=True)


def required() -> Path:
    """A Chromium that is on this machine, a whole one if there is one; the program ends if there is none."""
    path = _first(is_shell=False)
    if path is None:
        sys.exit("no Chromium on this machine: name one in IMUSCOPE_CHROMIUM")
    return path


def provide(send: Callable[[str], None]) -> Path | None:
    """A Chromium, downloaded if necessary; `say` is called with one line per step."""
    if path := find():
        send(f"Chromium: {path} ({version(path)})")
        return path
    send("Chromium: none on this machine; trying Playwright's own download")
    steps: list[tuple[str, list[list[str]]]] = [
        ("Playwright's download", [[sys.executable, "-m", "playwright", "install", "--only-shell", "chromium"]])
    ]
    if shutil.which("apt-get") and os.geteuid() == 0:
        install = ["apt-get", "install", "-y", "--no-install-recommends"]
        for package in ("chromium-headless-shell", "chromium"):
            steps.append((f"apt-get install {package}", [["apt-get", "update"], [*install, package]]))
    for name, commands in steps:
        failure = next(filter(None, map(_failure, commands)), "")
        find.cache_clear()
        if not failure and (path := find()):
            send(f"Chromium: {path} ({version(path)}), from {name}")
            return path
        send(f"Chromium: {name} did not give one that starts. {failure}".rstrip())
    send("Chromium: still none. Install it (package chromium, or google-chrome), or name one in IMUSCOPE_CHROMIUM")
    return None


def version(path: Path) -> str:
    """Version text of the browser; "" if it does not start (a missing library, a stub of a snap)."""
    try:
        answer = subprocess.run(
            [path, "--version"], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=PATIENCE_S
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return answer.stdout.strip() if answer.returncode == 0 else ""


# Asked in the page itself: each question from here takes 6 ms of a processor on its way, and thirty a second take more
# than the page does. The number of times is limited for a page that is navigated away or closed meanwhile.
_EVALUATE = """async argument => {
  const look = () => (EXPRESSION
  );
  let found;
  for (let n = 0; n < TIMES; n++) {
    try {
      const value = look();
      found = await (typeof value === "function" ? value(argument) : value);
      if (found) return [true, found];
    } catch (error) {
      found = String(error);
    }
    await new Promise(done => setTimeout(done, EVERY_MS));
  }
  return [false, String(found)];
}"""
_EVERY_S, _POLLED_S = 0.03, 3.0


def until(page: Page | Frame, expression: str, argument: Any = None, *, timeout_s: float = PATIENCE_S) -> Any:
    """Ask a page again and again until a JavaScript expression or function is true, and return what it gave.

    Playwright's own `wait_for_function` compiles text inside the page, which the page's security policy forbids.

    An expression that throws is not true yet: a document that is loading has no body, an element that the expression
    reads may not be drawn, and a page that navigates takes its context with it.

    Raises:
        TimeoutError: it never was; the message holds the expression and its last value or error.
    """
    from playwright.sync_api import Error, Page

    script = _EVALUATE.replace("TIMES", str(round(_POLLED_S / _EVERY_S))).replace(
        "EVERY_MS", str(round(1000 * _EVERY_S))
    )
    script = script.replace("EXPRESSION", expression)
    deadline = time.monotonic() + timeout_s
    while True:
        result: Any = None
        try:
            is_true, result = page.evaluate(script, argument)
            if is_true:
                return result
        except Error as error:
            if page.is_closed() if isinstance(page, Page) else page.is_detached():
                raise
            result = error
            time.sleep(_EVERY_S)
        if time.monotonic() > deadline:
            raise TimeoutError(f"not within {timeout_s:g} s: {expression} (last: {result!r})")


def _first(*, is_shell: bool) -> Path | None:
    """The one that is named, or the first that starts: of headless shells, or of the others, if there is one."""
    if (named := os.environ.get("IMUSCOPE_CHROMIUM")) and version(Path(named)):
        return Path(named)
    ordered = sorted(_candidates(), key=lambda path: ("headless" in path.name) is not is_shell)
    return next((path for path in ordered if version(path)), None)


def _candidates() -> Iterator[Path]:
    for name in (*SHELLS, *NAMES):
        if result := shutil.which(name):
            yield Path(result)
    for place in PLACES:
        for name in (*SHELLS, *NAMES):
            if (path := Path(place) / name).is_file():
                yield path
    for name in ("Google Chrome", "Chromium"):
        if (path := Path(MAC.format(name))).is_file():
            yield path
    home = Path(os.environ.get("PLAYWRIGHT_BROWSERS_PATH") or Path.home() / ".cache" / "ms-playwright")
    for pattern in ("chromium-*/chrome-linux*/chrome", "chromium_headless_shell-*/*/*headless[-_]shell"):
        yield from sorted(home.glob(pattern), reverse=True)


def _failure(command: list[str]) -> str:
    """Run a command without output; returns "" or its last line."""
    env = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    out = subprocess.PIPE
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT, text=True, timeout=300, env=env
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    lines = done.stdout.strip().splitlines() or [f"exit status {done.returncode}"]
    return lines[-1] if done.returncode else ""
