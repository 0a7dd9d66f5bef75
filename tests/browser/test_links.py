"""A lost link is shown on the page, recovers by itself, and stops nothing else.

A pseudo-terminal behind a symbolic link stands for a USB adapter that is pulled out and plugged in again. Other links
are tested with the server alone, in tests/fault_injection/test_links.py.
"""

import os
import pty
import tty
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from playwright.sync_api import Page

from tests.bench.support.serial_device import frame
from tests.support.chromium import until
from tests.support.server_process import ServerProcess
from tests.support.waiting import block_until

BURST, MIN_CHECKED = 4, 50  # samples
COUNT = """device => { const c = window.imuscope?.store.channels.value.find(c => c.info.device === device
                       && c.info.name === "Acceleration");
                       return c ? c.ring.length : 0; }"""
LINKS = "window.imuscope.store.events.value.filter(one => one.kind === 'link' && one.device === '1').length"
TURNS = "window.imuscope.store.events.value.filter(one => one.kind === 'clock' && one.device === '2')"
RING = """(id => window.imuscope.store.channels.value
    .find(({info}) => info.device === id && info.name === 'Acceleration').ring)"""


class ReplugAdapter:
    """A serial port that can be pulled out: a symbolic link to a pseudo-terminal. Its device sends when told to."""

    index = 0

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
            os.write(self._master, b"".join(frame(self.index + n, 100.0) for n in range(BURST)))
        self.index += BURST

    def pull(self) -> None:
        self.path.unlink()
        os.close(self._slave)
        os.close(self._master)


def test_lost_links_and_servers_come_back_while_others_go_on(
    captures: Path, tmp_path: Path, serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    """A port that is pulled out, a capture that begins again, and a server that restarts, on one page."""
    adapter = ReplugAdapter(tmp_path / "ttyUSB0")
    adapter.plug()
    sources = (adapter.source, f"{captures}/xbus/mti_float32.bin?loop=1", "sim:xbus?rate=50&seed=2")
    server = serve(*sources)
    page = open_page(server.url)

    def streams(than: int) -> None:
        def has_come() -> bool:
            adapter.send()
            return bool(page.evaluate(COUNT, "1") > than)

        block_until(has_come, "samples of the port")

    streams(MIN_CHECKED)
    before = page.evaluate(LINKS)
    adapter.pull()
    until(page, f"{LINKS} > {before} && window.imuscope.store.devices.value[0].status === 'lost'")
    until(page, "/lost/i.test(document.querySelector('.device .why .tag.bad')?.innerText)")
    for rest in (True, False):  # what came just before the loss is shown with the next samples of others
        held, other = page.evaluate(COUNT, "1"), page.evaluate(COUNT, "3")
        until(page, f"({COUNT})('3') > {other + 20}")
        assert rest or page.evaluate(COUNT, "1") == held
    adapter.plug()
    streams(held + MIN_CHECKED)
    until(page, f"{LINKS} > {before + 1}")  # the loss and the return are events
    adapter.pull()

    a_capture_that_begins_again_is_not_joined_to_its_end(page)
    assert page.evaluate(f"{RING}('3').breaks.length") == 0

    port, newest = server.url.rsplit(":", 1)[1], page.evaluate(f"{RING}('3').newest")
    server.stop()
    until(page, "window.imuscope.store.connection.value !== 'open'")
    serve(sources[2], arguments=("--port", port))
    until(page, "window.imuscope.store.connection.value === 'open'")
    until(page, f"window.imuscope.store.channels.value.some(({{ring}}) => ring.newest > {newest} + 1)")


def a_capture_that_begins_again_is_not_joined_to_its_end(page: Page) -> None:
    """Played in a loop the device's clock goes back at each turn; a stroke used to be drawn there."""
    until(page, f"{TURNS}.length > 3")
    joined = page.evaluate(
        f"""() => {{ const ring = {RING}("2"), cut = new Set(ring.breaks);
                   const over = {TURNS}.map(e => e.time).filter(time => time > ring.time(0) && time <= ring.newest);
                   let joined = 0;  // strokes that lead over a turn
                   for (let row = ring.first + 1; row < ring.first + ring.length; row++) {{
                       const [before, at] = [row - 1, row].map(row => ring.times[row & ring.mask]);
                       if (!cut.has(row) && over.some(time => before < time && time <= at)) joined++;
                   }}
                   return [over.length, joined]; }}"""
    )
    assert joined[0] > 2
    assert joined[1] == 0
