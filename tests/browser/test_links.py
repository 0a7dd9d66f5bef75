"""A lost link is shown on the page, recovers by itself, and stops nothing else.

A pseudo-terminal behind a symbolic link stands for a USB adapter that is pulled out and plugged in again; a TCP
listener that closes for a device server that restarts.
"""

from __future__ import annotations

import os
import pty
import socket
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from playwright.sync_api import Page

from tests.bench.serial_device import frame
from tests.chromium import until
from tests.server_process import ServerProcess
from tests.timeouts import PATIENCE_S
from tests.waiting import block_until

BURST, ENOUGH = 4, 50  # samples
COUNT = """device => { const c = window.imuscope?.store.channels.value.find(c => c.info.device === device
                       && c.info.name === "Acceleration");
                       return c ? c.ring.length : 0; }"""
LINKS = "window.imuscope.store.events.value.filter(one => one.kind === 'link' && one.device === DEVICE).length"


class Frames:
    """A device that sends when it is told to."""

    index = 0

    def burst(self) -> bytes:
        sent = b"".join(frame(self.index + n, 100.0) for n in range(BURST))
        self.index += BURST
        return sent


class ReplugAdapter(Frames):
    """A serial port that can be pulled out: a symbolic link to a pseudo-terminal."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.source = f"serial://{path}?baud=115200"

    def plug(self) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)  # what nobody reads is lost, as on a cable
        self.path.symlink_to(os.ttyname(self._slave))

    def send(self) -> None:
        with suppress(BlockingIOError):
            os.write(self._master, self.burst())

    def pull(self) -> None:
        self.path.unlink()
        os.close(self._slave)
        os.close(self._master)


class Peer(Frames):
    """A device server on TCP that can be switched off."""

    def __init__(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as door:
            self.port = door.getsockname()[1]
        self.source = f"tcp://127.0.0.1:{self.port}"
        self._connection: socket.socket | None = None

    def plug(self) -> None:
        self._door = socket.create_server(("127.0.0.1", self.port))
        self._door.settimeout(PATIENCE_S)

    def send(self) -> None:
        if self._connection is None:
            self._connection, _ = self._door.accept()
        self._connection.sendall(self.burst())

    def pull(self) -> None:
        if self._connection is not None:
            self._connection.close()
        self._connection = None
        self._door.close()


def test_lost_links_are_shown_and_recover_while_others_go_on(
    tmp_path: Path, serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    adapter, peer = ReplugAdapter(tmp_path / "ttyUSB0"), Peer()
    adapter.plug()
    peer.plug()
    page = open_page(serve(adapter.source, peer.source, "sim:xbus?rate=20&seed=2").url)

    def streams(device: str, plug: ReplugAdapter | Peer, than: int) -> None:
        def has_come() -> bool:
            plug.send()
            return bool(page.evaluate(COUNT, device) > than)

        block_until(has_come, f"samples of device {device}")

    for device, plug in (("1", adapter), ("2", peer)):
        streams(device, plug, ENOUGH)
        links = LINKS.replace("DEVICE", repr(device))
        before = page.evaluate(links)
        plug.pull()
        until(page, f"{links} > {before}")
        until(page, f"window.imuscope.store.devices.value.find(one => one.id === {device!r}).status === 'lost'")
        until(page, "/\\blost\\b/i.test(document.body.innerText)")
        held, other = page.evaluate(COUNT, device), page.evaluate(COUNT, "3")
        until(page, f"({COUNT})('3') > {other + 20}")
        assert page.evaluate(COUNT, device) == held
        plug.plug()
        streams(device, plug, held + ENOUGH)
        until(page, f"{links} > {before + 1}")  # the loss and the return are events
        plug.pull()


def test_a_simulator_that_is_pulled_leaves_a_gap_and_a_server_that_restarts_is_found_again(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    """`unplug_s` closes the pseudo-terminal under the session, as a hand at the plug does; the other streams on."""
    sources = ("sim:xbus?rate=50&unplug_s=4&away_s=2", "sim:xbus?rate=50&seed=2")
    server = serve(*sources)
    page = open_page(server.url)
    until(page, "window.imuscope?.store.channels.value.filter(c => c.info.name === 'Acceleration').length === 2")
    page.evaluate("""() => {
        const is = id => ({info}) => info.device === id && info.name === "Acceleration";
        window.ringOf = id => window.imuscope.store.channels.value.find(is(id)).ring;
    }""")
    status = "window.imuscope.store.devices.value[0].status"
    until(page, f"{status} === 'lost' && /\\blost\\b/i.test(document.body.innerText)")
    apart = """() => { const ring = ringOf("1");
        return Math.max(0, ...ring.breaks.map(row =>
            ring.times[row & ring.mask] - ring.times[(row - 1) & ring.mask])); }"""
    until(page, f"({apart})() > 1.5")  # no line is drawn over the time it was away
    assert page.evaluate("ringOf('2').length > ringOf('1').length")
    assert page.evaluate("ringOf('2').breaks.length") == 0

    port, newest = server.url.rsplit(":", 1)[1], page.evaluate("ringOf('2').newest")
    server.stop()
    until(page, "window.imuscope.store.connection.value !== 'open'")
    serve(*sources, arguments=("--port", port))
    until(page, "window.imuscope.store.connection.value === 'open'")
    until(page, f"ringOf('2').newest > {newest} + 1")


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
