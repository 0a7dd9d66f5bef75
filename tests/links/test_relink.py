"""Closing and reopening a link at another rate, as required by a rate change of the device."""

from __future__ import annotations

import fcntl
import os
import termios

import pytest

from imuscope.server.links import LinkError, open_link
from imuscope.server.links.serial import SerialLink, try_rate
from imuscope.server.links.simulator import SimulatorLink
from tests.links.link_fixtures import dies, fails, gather, joined, settings


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
    others = [os.openpty()]
    while os.ttyname(others[-1][1]) != name:  # the first free one; another test may have been quicker
        others.append(os.openpty())
        assert len(others) < 50
    await link.reopen(115_200)
    fcntl.flock(others[-1][1], fcntl.LOCK_EX | fcntl.LOCK_NB)
    assert link._simulator.slave != name
    await gather(link, until=lambda data: b"\xfa\xff\x36" in data)
    await link.close()
    for end in sum(others, ()):
        os.close(end)


class FakeAdapter:
    """A port whose driver refuses a rate or silently chooses another."""

    fd = -1

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
