"""A link is closed and opened again, at another rate: what a change of the device's rate needs."""

from __future__ import annotations

import asyncio
import termios
from typing import Any

import pytest

from server.links import LinkError, open_link
from server.links.serial import SerialLink, try_rate
from tests.links.link_fixtures import fails, gather, joined, settings


def run(coroutine: Any) -> Any:
    return asyncio.run(coroutine)


def test_a_serial_link_takes_another_rate_and_keeps_it() -> None:
    async def check() -> None:
        link = open_link("twin:xbus?baud=115200", settings())
        await link.open()
        await gather(link, 200)
        await link.check_rate(921_600)
        await link.relink(921_600)
        assert (link.baud, link.capacity) == (921_600, 92_160)
        noise = joined(await gather(link, 200))
        assert b"\xfa\xff\x36" not in noise  # the device speaks at the old rate
        await link.relink(115_200)
        await gather(link, until=lambda data: b"\xfa\xff\x36" in data)
        await link.relink()
        assert link.baud == 115_200
        await link.close()

    run(check())


class Adapter:
    """A port whose driver refuses a rate, or chooses another without a word."""

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


def test_a_rate_that_the_adapter_has_not_is_refused_and_the_old_one_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    port = Adapter(refuses=4_000_000)
    with pytest.raises(LinkError, match="cannot be set to 4000000 Bd: out of range"):
        try_rate(port, "/dev/ttyUSB0", 4_000_000)
    assert port.baudrate == 115_200
    monkeypatch.setattr(termios, "tcgetattr", lambda fd: [0, 0, 0, 0, termios.B9600, termios.B9600, []])
    with pytest.raises(LinkError, match="the driver chose another"):
        try_rate(port, "/dev/ttyUSB0", 921_600)
    assert port.baudrate == 115_200


def test_a_network_has_no_rate() -> None:
    async def check() -> None:
        link = open_link("udp://127.0.0.1:0", settings())
        error = await fails(link.relink(921_600))
        assert error.kind == "refused"
        assert "cannot be set from here" in error.message

    run(check())


def test_a_closed_port_says_so() -> None:
    async def check() -> None:
        link = open_link("/dev/ttyNOT", settings())
        assert isinstance(link, SerialLink)
        error = await fails(link.check_rate(9600))
        assert error.kind == "gone"

    run(check())
