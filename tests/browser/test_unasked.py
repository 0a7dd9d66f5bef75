"""Presses on a page that were meant for something else: every documented key, in every state of a page that did not
write. The device keeps what it is sent, and is sent nothing.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from playwright.sync_api import Page, Request

from imuscope.server.access.route_rules import RouteRules
from imuscope.server.extensions.analysis import EXTENSION as ANALYSIS
from imuscope.server.links.simulated_device import SimulatorOptions
from imuscope.server.links.simulated_line import LineFaults
from imuscope.server.links.simulator import SimulatorThread
from tests.browser.page_checks import drawn, go_to, opened, press
from tests.fault_injection.busy_page import ListeningDevice, received_by
from tests.support.chromium import until
from tests.support.server_process import ServerProcess

DEVICES = """change => { const {store} = window.imuscope;
  const devices = store.devices.value.map(one => ({...one, ...change}));
  store.receive({kind: "text", text: {op: "devices", devices}}); }"""
JOBS = """change => { const {store} = window.imuscope;
  const devices = [...store.jobs.value.values()].map(one => ({...one, ...change}));
  store.receive({kind: "text", text: {op: "jobs", devices}}); }"""
BUSY = {"id": 9, "device": "1", "title": "Write profile", "state": "running", "step": "", "message": "", "hint": ""}
BUSY |= {"snapshot": "", "values": {}, "outcomes": [], "started": 1.0, "ended": None}
GRAVITY = {"kind": "expression", "expression": "norm(Acceleration) > 1 m/s²"}
"""Of an alarm that is raised all the time."""
NAMES = {"←": "ArrowLeft", "→": "ArrowRight", "−": "-", "Esc": "Escape", "/": "/"}
RULES = RouteRules()
RULES.add((), ANALYSIS.read_only_posts)
OWN_FILES = re.compile(r"/api/(recordings|recorder|workspaces)\b")
"""Requests that change something of the server's own, and nothing of a device."""


@contextmanager
def listening() -> Iterator[SimulatorThread]:
    options = SimulatorOptions("xbus", faults=LineFaults(baud=115_200))
    thread = SimulatorThread(lambda at: ListeningDevice("MTi-630", start_ns=at, rate=50, measuring=True), options)
    thread.start()
    try:
        yield thread
    finally:
        thread.stop()


def documented_keys(page: Page) -> list[str]:
    """The keys of the page's own list, as they are pressed one after the other; those that lead away come last."""
    press(page, "?", "document.querySelector('dialog[open] kbd') !== null")
    printed = page.evaluate("[...document.querySelectorAll('dialog kbd')].map(one => one.textContent)")
    press(page, "Escape", "document.querySelector('dialog') === null")
    assert len(printed) > 30
    keys: list[str] = []
    for text in sorted(printed, key=lambda one: one.startswith("G ")):
        first, last = (text.split(" … ") * 2)[:2]
        shift = "Shift+" if first.startswith("Shift ") else ""
        one = first.removeprefix("Shift ")
        if last.isdigit():
            keys += [f"{shift}Digit{number}" for number in range(1, int(last) + 1)]
        else:
            keys += [shift + NAMES.get(part, part.replace("Ctrl", "Control")) for part in one.split()]
    return [*keys, "Enter"]


def pressed_everywhere(page: Page, keys: list[str], place: str) -> None:
    """Press every key as it comes, and again with whatever the key before it has opened closed."""
    for closes in (True, False):
        go_to(page, place)
        for key in keys:
            page.keyboard.press(key if len(key) > 1 or key in "+-,./[]?" else key.lower())
            if closes:
                page.keyboard.press("Escape")
        page.keyboard.press("Escape")
        drawn(page)


def test_no_key_of_a_page_that_did_not_write_reaches_the_device(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    with listening() as device:
        server = serve(device.slave)
        page = opened(server, open_page, still=True, scale=0.5)
        changes: list[str] = []

        def note(request: Request) -> None:
            place = request.url.removeprefix(server.url.rstrip("/"))
            if RULES.is_command(request.method, place) and not OWN_FILES.match(place):
                changes.append(f"{request.method} {place}")

        page.on("request", note)
        # as fast as these come, a marker may be for a recording that has just ended, which the console would report
        page.route("**/api/recordings/mark", lambda route: route.fulfill(json={}))
        keys = documented_keys(page)
        server.request("POST", "/api/alarms", {"name": "Gravity", "condition": GRAVITY})
        until(page, "document.querySelector('.alarm-row .tag') !== null")
        new = {"LocationID": {"location_id": 7}}
        server.request("POST", "/api/devices/1/apply", {"changes": new, "confirmed": True, "confirm_s": 600.0})
        until(page, "document.querySelector('.pending-rollback b')?.textContent > 0")
        received = received_by(device)
        states: dict[str, tuple[str, dict[str, object]]] = {
            "countdown": (DEVICES, {}),
            "not confirmed": (DEVICES, {"unconfirmed_since": 1.8e9}),
            "lost": (DEVICES, {"status": "lost", "is_open": False, "message": "Gone.", "hint": "Plug it in."}),
            "a job runs": (JOBS, {"running": BUSY, "pending_rollback": None}),
        }
        for state, (script, change) in states.items():
            page.evaluate(script, change)
            for place in ("#/", "#/configure/1", "#/configure/1/compare/~factory"):
                pressed_everywhere(page, keys, place)
                assert (state, place, changes, received_by(device)[len(received) :]) == (state, place, [], b"")
