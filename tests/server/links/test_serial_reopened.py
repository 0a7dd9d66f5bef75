"""Closing and reopening a link at another rate, as required by a rate change of the device."""

import contextlib
import fcntl
import os
import subprocess
import sys
import termios
from collections.abc import Iterator
from pathlib import Path

import pytest

from imuscope.server.links.base import LinkError
from imuscope.server.links.serial import SerialLink, try_rate
from imuscope.server.links.simulator import SimulatorLink
from imuscope.server.links.source_url import open_link
from tests.server.links.link_fixtures import Pty, dies, fails, gather, joined, settings
from tests.support.each_row import each_row
from tests.support.waiting import block_until


async def test_a_serial_link_takes_another_rate_and_keeps_it() -> None:
    link = open_link("sim:xbus?baud=115200", settings())
    await link.open()
    await gather(link, 200)
    await link.check_rate(921_600)
    await link.reopen(921_600)
    assert (link.baud, link.capacity) == (921_600, 92_160)
    noise = joined(await gather(link, 200))
    assert b"\xfa\xff\x36" not in noise  # the device uses the old rate
    await link.reopen(115_200)
    await gather(link, until=lambda data: b"\xfa\xff\x36" in data)
    await link.reopen()
    assert link.baud == 115_200
    await link.close()


async def test_a_pseudo_terminal_that_reuses_the_name_is_left_alone() -> None:
    """An unplugged simulator took it: its own process found it in use, or without half of its bytes."""
    link = open_link("sim:xbus?baud=115200&unplug_s=86400&away_s=0", settings())
    assert isinstance(link, SimulatorLink)
    await link.open()
    assert link._simulator is not None
    name = link._simulator.slave
    link._simulator.unplug()
    await dies(link)
    assert link._serial is not None
    await link._serial.close()
    with terminals_up_to(name) as others:
        await link.reopen(115_200)
        fcntl.flock(others[-1], fcntl.LOCK_EX | fcntl.LOCK_NB)
        assert link._simulator.slave != name
        await gather(link, until=lambda data: b"\xfa\xff\x36" in data)
        await link.close()


@each_row("closed_first", [False, True])
@each_row("through_link", [False, True])
async def test_a_terminal_with_the_number_of_a_closed_one_is_left_alone(
    tmp_path: Path, through_link: bool, closed_first: bool
) -> None:
    """Regression: a server whose port had been closed took the next terminal of that number, of another test or of a
    person's shell, locked it and read what was typed.
    """
    port = Pty()
    place = str(tmp_path / f"imu{closed_first}") if through_link else port.path
    if through_link:
        os.symlink(port.path, place)
    link = open_link(f"{place}?baud=115200", settings())
    await link.open()
    await link.close()
    await link.open()  # the same terminal, which was closed at this end alone
    if closed_first:  # and tried again later, as after an error
        await link.close()
    port.pull()
    if not closed_first:
        await dies(link)
        await link.close()
    with terminals_up_to(port.path) as others:
        error = await fails(link.open())
        assert error.kind == "gone"
        assert f"{place} was closed, and may now be the terminal of another program." in error.message
        fcntl.flock(others[-1], fcntl.LOCK_EX | fcntl.LOCK_NB)
        fcntl.flock(others[-1], fcntl.LOCK_UN)
        if through_link:  # made again by the program of the port
            os.unlink(place)
            os.symlink(port.path, place)
            await link.open()
            await link.close()
        other = open_link(f"{place}?baud=115200", settings())
        await other.open()  # a source that a person has added
        await other.close()


async def test_a_terminal_of_a_shell_is_not_opened_as_a_port() -> None:
    master, terminal = os.openpty()
    place = os.ttyname(terminal)
    words = [sys.executable, "-c", f"import fcntl, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); {READY}"]
    with subprocess.Popen(words, stdin=terminal, stdout=subprocess.PIPE, start_new_session=True) as shell:
        assert shell.stdout is not None
        assert shell.stdout.readline() == b"ready\n"
        try:
            error = await fails(open_link(f"{place}?baud=115200", settings()).open())
        finally:
            os.write(master, b"\n")
    assert error.kind == "busy"
    assert error.message == f"{place} is the terminal of {Path(sys.executable).name} (process {shell.pid})."
    link = open_link(f"{place}?baud=115200", settings())
    await link.open()  # its session has ended
    await link.close()
    os.close(terminal)
    os.close(master)


READY = "print('ready', flush=True); input()"


@contextlib.contextmanager
def terminals_up_to(name: str) -> Iterator[list[int]]:
    """New pseudo-terminals, the last one at `name`, which is that of one that was closed."""
    ends: list[int] = []

    def is_reached() -> bool:
        ends.extend(os.openpty())
        if len(ends) > 100 and os.ttyname(ends[-1]) != name:  # another test has it, which was quicker
            os.close(ends.pop())
            os.close(ends.pop())
        return os.ttyname(ends[-1]) == name

    try:
        block_until(is_reached, "the number of a terminal that was closed")
        yield ends
    finally:
        for end in ends:
            os.close(end)


class FakeAdapter:
    """A port whose driver refuses a rate or silently chooses another."""

    fd = os.open(os.devnull, os.O_RDONLY)

    def __init__(self, refuses: int = 0) -> None:
        self._baud = 115_200
        self._refuses = refuses

    @property
    def baudrate(self) -> int:
        return self._baud

    @baudrate.setter
    def baudrate(self, baud: int) -> None:
        if baud == self._refuses:
            raise ValueError("out of range")
        self._baud = baud


def test_an_unsupported_rate_is_refused_and_the_old_one_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    port = FakeAdapter(refuses=4_000_000)
    with pytest.raises(LinkError, match="cannot be set to 4000000 Bd: out of range"):
        try_rate(port, "/dev/ttyUSB0", 4_000_000)
    assert port.baudrate == 115_200
    monkeypatch.setattr(termios, "tcgetattr", lambda fd: [0, 0, 0, 0, termios.B9600, termios.B9600, []])
    with pytest.raises(LinkError, match="the driver set another rate"):
        try_rate(port, "/dev/ttyUSB0", 921_600)
    assert port.baudrate == 115_200


async def test_a_network_has_no_rate() -> None:
    link = open_link("udp://127.0.0.1:0", settings())
    error = await fails(link.reopen(921_600))
    assert error.kind == "refused"
    assert "cannot be set from here" in error.message


async def test_a_closed_port_is_reported() -> None:
    link = open_link("/dev/ttyNOT", settings())
    assert isinstance(link, SerialLink)
    error = await fails(link.check_rate(9600))
    assert error.kind == "gone"
