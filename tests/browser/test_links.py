"""A lost link is shown on the page within a second and recovers by itself.

A pseudo-terminal behind a symbolic link stands for a USB adapter that is pulled out and plugged in again; a TCP
listener that closes for a device server that restarts.
"""

from __future__ import annotations

import os
import pty
import socket
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page

from tests.bench.serial_device import frame
from tests.chromium import until
from tests.server_process import ServerProcess
from tests.timeouts import PATIENCE_S

RATE = 100.0
STATUS = "window.imuscope?.store.devices.value[0]?.status"
COUNT = """() => { const c = window.imuscope?.store.channels.value.find(c => c.info.name === "Acceleration");
                   return c ? c.ring.length : 0; }"""


class Sender:
    """Send 100 frames a second through `write` until stopped or until the other end closes."""

    def __init__(self, write: Callable[[bytes], object]) -> None:
        self._write = write
        self._stop = threading.Event()
        self.index = 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        began = time.monotonic()
        while not self._stop.wait(max(0.0, began + self.index / RATE - time.monotonic())):
            try:
                self._write(frame(self.index, RATE))
            except OSError:
                return
            self.index += 1

    def stop(self) -> None:
        self._stop.set()
        self._thread.join(PATIENCE_S)


class ReplugAdapter:
    """A serial port that can be pulled out: a symbolic link to a pseudo-terminal."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.source = f"serial://{path}?baud=115200"
        self._plugged = False

    def plug(self) -> None:
        self._plugged = True
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        self.path.symlink_to(os.ttyname(slave))
        self._slave = slave
        self._sender = Sender(lambda data: os.write(self._master, data))

    def pull(self) -> None:
        if not self._plugged:
            return
        self._plugged = False
        self._sender.stop()
        self.path.unlink()
        os.close(self._slave)
        os.close(self._master)


class Peer:
    """A device server on TCP that can be switched off."""

    def __init__(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as door:
            self.port = door.getsockname()[1]
        self.source = f"tcp://127.0.0.1:{self.port}"

    def plug(self) -> None:
        self._door = socket.create_server(("127.0.0.1", self.port))
        self._off = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        self._door.settimeout(0.1)
        while not self._off.is_set():
            try:
                connection, _ = self._door.accept()
            except TimeoutError:
                continue
            with connection:
                sender = Sender(connection.sendall)
                self._off.wait()
                sender.stop()

    def pull(self) -> None:
        self._off.set()
        self._thread.join(PATIENCE_S)
        self._door.close()


@pytest.fixture(params=["serial", "tcp"])
def plug(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[ReplugAdapter | Peer]:
    """A device that is there, and can be made to go."""
    device = ReplugAdapter(tmp_path / "ttyUSB0") if request.param == "serial" else Peer()
    device.plug()
    yield device
    device.pull()


def test_a_killed_link_shows_within_a_second_and_recovers(
    plug: ReplugAdapter | Peer, serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    page = open_page(serve(plug.source).url)
    until(page, f"{STATUS} === 'live' && ({COUNT})() > 50")
    waited = []
    while not waited or min(waited) >= 1.0:  # a busy machine is late by chance, a timer each time
        assert len(waited) < 4, waited
        plug.pull()
        began = time.monotonic()
        # No longer live, with a visible text.
        until(page, f"{STATUS} !== 'live'")
        until(page, "/\\blost\\b/i.test(document.body.innerText)")
        waited.append(time.monotonic() - began)
        held = page.evaluate(COUNT)
        plug.plug()
        until(page, f"{STATUS} === 'live' && ({COUNT})() > {held} + 50")
    links = page.evaluate("window.imuscope.store.events.value.filter(event => event.kind === 'link').length")
    assert links >= 2, "the loss and the return are events"


def test_nothing_else_stops_when_one_link_dies(
    tmp_path: Path, serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    device = ReplugAdapter(tmp_path / "ttyUSB0")
    device.plug()
    page = open_page(serve(device.source, "sim:xbus").url)
    both = """() => window.imuscope?.store.devices.value.map(device => window.imuscope.store.channels.value
        .filter(c => c.info.device === device.id).reduce((n, c) => n + c.ring.length, 0))"""
    until(page, f"(({both})() ?? []).filter(n => n > 100).length === 2")
    device.pull()
    until(page, "window.imuscope.store.devices.value.some(device => device.status === 'lost')")
    for _ in range(2):  # the last samples of the dead link may come after its status
        before = page.evaluate(both)
        until(page, f"({both})()[1] > {before[1] + 100}")
    assert page.evaluate(both)[0] == before[0]


def test_a_server_that_restarts_is_found_again(
    tmp_path: Path, serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    server = serve("sim:xbus")
    page = open_page(server.url)
    until(page, f"({COUNT})() > 20")
    port = server.url.rsplit(":", 1)[1]
    server.stop()
    until(page, "window.imuscope.store.connection.value !== 'open'")
    serve("sim:xbus", arguments=("--port", port))
    until(page, f"window.imuscope.store.connection.value === 'open' && ({COUNT})() > 20")


def test_a_simulator_that_is_pulled_is_shown_within_a_second_and_comes_back(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    """`unplug_s` closes the pseudo-terminal under the session, as a hand at the plug does; the other streams on."""
    page = open_page(serve("sim:xbus?unplug_s=4&away_s=2", "sim:xbus?seed=2").url)
    until(page, "window.imuscope?.store.channels.value.filter(c => c.info.name === 'Acceleration').length === 2")
    page.evaluate("""() => {
        const is = id => ({info}) => info.device === id && info.name === "Acceleration";
        window.ringOf = id => window.imuscope.store.channels.value.find(is(id)).ring;
    }""")
    # Timed in the page: from the last sample that came to the word on the screen, and how long the other went on
    # meanwhile. A busy machine is late by chance; what waits for a timer is late each time.
    seen: list[list[float]] = []
    while not any(waited < 1.0 and went_on > 0.5 for waited, went_on, _ in seen):
        assert len(seen) < 4, seen
        told = page.evaluate("""async () => {
            const {store} = window.imuscope, a_while = () => new Promise(done => setTimeout(done, 20));
            const is_said = () => /\\blost\\b/i.test(document.body.innerText);
            const is_lost = () => store.devices.value[0].status === "lost" && is_said();
            while (!is_lost()) await a_while();
            const waited = store.serverNow() - ringOf("1").newest, other = ringOf("2").newest;
            while (is_lost()) await a_while();
            return [waited, ringOf("2").newest - other, ringOf("1").length];
        }""")
        assert told[0] > 0
        seen.append(told)
        until(page, f"{STATUS} === 'live' && ringOf('1').length > {told[2]} + 100")
    apart = """() => { const ring = ringOf("1");
        return ring.breaks.map(row => ring.times[row & ring.mask] - ring.times[(row - 1) & ring.mask]); }"""
    assert max(page.evaluate(apart)) > 1.5, "no line is drawn over the time it was away"


def test_a_capture_that_begins_again_is_not_joined_to_its_end(
    captures: Path, serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    """Played in a loop the device's clock goes back at each turn; a stroke used to be drawn there."""
    page = open_page(serve(f"{captures}/xbus/mti_float32.bin?loop=1").url)
    until(page, "window.imuscope?.store.events.value.filter(event => event.kind === 'clock').length > 3")
    joined = page.evaluate(
        """() => { const {store} = window.imuscope;
                   const {ring} = store.channels.value.find(c => c.info.name === "Acceleration");
                   const cut = new Set(ring.breaks);
                   const turns = store.events.value.filter(e => e.kind === "clock").map(e => e.time);
                   const over = turns.filter(time => time > ring.time(0) && time <= ring.newest);
                   let joined = 0;  // strokes that lead over a turn
                   for (let row = ring.first + 1; row < ring.first + ring.length; row++) {
                       const [before, at] = [row - 1, row].map(row => ring.times[row & ring.mask]);
                       if (!cut.has(row) && over.some(time => before < time && time <= at)) joined++;
                   }
                   return [over.length, joined]; }"""
    )
    assert joined[0] > 2
    assert joined[1] == 0
