"""A page of another origin in the user's browser can neither read nor change anything.

Two dangers that only a real browser shows whole: what a page of another origin can send without being asked (forms,
"simple" requests, beacons, WebSockets), and a name that its owner lets resolve to this machine (DNS rebinding), under
which the page would be of one origin with the server.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Page

from tests.support.chromium import REBOUND
from tests.support.server_process import ServerProcess
from tests.support.timeouts import get
from tests.support.waiting import block_until

ATTACK = """async ([target, socketTarget, device]) => {
  const seen = {};
  const note = async (name, attempt) => {
    try { seen[name] = await attempt(); } catch (error) { seen[name] = String(error.name); }
  };
  const paths = ["/api/recordings/start", "/api/recordings/mark", "/api/devices", `/api/devices/${device}/retry`,
                 `/api/devices/${device}/run`, `/api/devices/${device}/raw`, "/api/ports/scan"];
  const body = '{"source": "udp://:0", "name": "Reset", "text": "gotcha"}';
  for (const path of paths) {
    for (const kind of ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x", ""])
      await note(`${kind} to ${path}`, async () => {
        const headers = kind ? {"content-type": kind} : {};
        const how = {method: "POST", mode: "no-cors", credentials: "include", headers, body};
        return (await fetch(target + path, how)).type;
      });
    await note(`json to ${path}`, async () => (await fetch(target + path,
      {method: "POST", credentials: "include", headers: {"content-type": "application/json"}, body})).status);
    await note(`nothing to ${path}`, async () => (await fetch(target + path, {method: "POST", mode: "no-cors"})).type);
    navigator.sendBeacon(target + path, new Blob([body], {type: "text/plain"}));
  }
  await note("delete", async () => (await fetch(`${target}/api/devices/${device}`, {method: "DELETE"})).status);
  await note("read", async () => (await fetch(`${target}/api/devices`)).text());
  for (const [name, path, protocol] of [["live", "/ws", "imuscope.v1"], ["foxglove", "/foxglove", "foxglove.sdk.v1"],
                                        ["rerun", "/rerun/live", undefined], ["viser", "/viser", "viser-v1.1.1"]])
    await note(`socket ${name}`, () => new Promise(resolve => {
      const socket = new WebSocket(socketTarget + path, protocol ? [protocol] : []);
      socket.onopen = () => resolve("open");
      socket.onmessage = () => resolve("message");
      socket.onerror = () => resolve("refused");
    }));
  const frame = document.createElement("iframe");
  frame.name = "sink";
  document.body.append(frame);
  const form = document.createElement("form");
  const action = target + "/api/recordings/start";
  Object.assign(form, {method: "post", action, target: "sink", enctype: "text/plain"});
  const loaded = new Promise(resolve => frame.addEventListener("load", resolve, {once: true}));
  document.body.append(form);
  form.submit();
  await Promise.race([loaded, new Promise(resolve => setTimeout(resolve, 3000))]);
  return seen;
}"""


class _Blank(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("content-type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><title>Strangers</title><body></body>")

    def log_message(self, *_: Any) -> None:
        pass


@pytest.fixture
def stranger() -> Iterator[str]:
    """Address of a web server of another origin."""
    with ThreadingHTTPServer(("127.0.0.1", 0), _Blank) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/"
        server.shutdown()


@pytest.fixture
def visitor(browser: Browser) -> Iterator[Page]:
    """A page that may complain: all that it tries is refused."""
    page = browser.new_page()
    yield page
    page.close()


def state(server: ServerProcess) -> tuple[Any, ...]:
    """All that a request could have changed."""
    devices = [(one["id"], one["source"], one["status"]) for one in get(f"{server.url}/api/devices").json()]
    exchange = get(f"{server.url}/api/devices/{devices[0][0]}/traffic").json()
    recorder = get(f"{server.url}/api/recorder").json()
    return devices, exchange, recorder, get(f"{server.url}/api/recordings").json()


def test_a_page_of_another_origin_can_neither_read_nor_act(
    serve: Callable[..., ServerProcess], stranger: str, visitor: Page
) -> None:
    server = serve("sim:xbus?rate=10")
    block_until(lambda: get(f"{server.url}/api/devices").json()[0]["status"] == "live", "the device streams")
    [device] = get(f"{server.url}/api/devices").json()
    before = state(server)

    visitor.goto(stranger)
    observed = visitor.evaluate(ATTACK, [server.url, server.url.replace("http", "ws"), device["id"]])
    assert state(server) == before
    sockets = {name: what for name, what in observed.items() if name.startswith("socket")}
    assert set(sockets.values()) == {"refused"}
    assert observed["read"] == "TypeError"  # sent, as any page's may be, but never shown to the page
    assert not [name for name, what in observed.items() if isinstance(what, int)]  # no answer was readable
    assert {"opaque", "refused", "TypeError"} >= set(observed.values())

    # The same page under a name of its owner that leads here: of one origin with the server, if the server let it.
    rebound = f"http://{REBOUND}:{urlsplit(server.url).port}"
    visitor.goto(rebound)
    observed = visitor.evaluate(ATTACK, [rebound, rebound.replace("http", "ws"), device["id"]])
    assert state(server) == before
    assert {what for name, what in observed.items() if name.startswith("socket")} == {"refused"}
    assert {what for name, what in observed.items() if name.startswith("json") or name == "delete"} == {403}
    assert "bad-host" in observed["read"]
