"""The baud scan on pseudo-terminals with a baud rate: at another rate, a port receives what a real receiver would."""

from __future__ import annotations

import asyncio
import termios
from typing import Any

import pytest

from imuscope.server.links.base import Attempt, LinkError, ScanWindows
from imuscope.server.links.baud_scan import ENOUGH_BYTES, find_baud, likely_rates, scan
from imuscope.server.links.detection_text import describe_bytes
from imuscope.server.links.serial import SerialSettings, open_port, try_rate
from imuscope.server.links.source_url import open_link
from tests.server.links.link_fixtures import device, fails, frame, gather, joined, left_behind, pty, settings
from tests.support.each_row import each_row
from tests.support.waiting import until

SHORT = ScanWindows(0.02, 0.05)


@each_row("baud", [115_200, 921_600, 460_800, 57_600])
async def test_the_rate_is_found_and_every_attempt_reported(baud: int) -> None:
    with device(baud) as bench:
        attempts: list[Attempt] = []
        link = open_link(bench.slave, settings())
        await link.open(attempts.append)
        try:
            assert link.baud == baud
            assert link.capacity == baud / 10
            assert [one.what.replace(" ", "") for one in attempts] == [
                f"{rate}Bd" for rate in likely_rates()[: len(attempts)]
            ]
            assert "Xbus frame" in attempts[-1].outcome
            for wrong in attempts[:-1]:
                assert wrong.outcome.endswith(("B, no frame in them", "0 B")), wrong.outcome
            data = joined(await gather(link, 500))
            assert describe_bytes(data).certain
        finally:
            await link.close()


async def test_a_pseudo_terminal_without_a_rate_is_recognised_at_once() -> None:
    with pty() as port:

        async def talk() -> None:
            for i in range(1000):
                port.write(frame(i, i))
                await asyncio.sleep(0.005)

        talking = asyncio.create_task(talk())
        attempts: list[Attempt] = []
        link = open_link(port.path, settings())
        await link.open(attempts.append)
        assert link.baud == 115_200
        assert len(attempts) == 1
        talking.cancel()
        await link.close()


async def test_silence_at_every_rate_is_reported() -> None:
    with pty() as port:
        before = left_behind()
        attempts: list[Attempt] = []
        error = await fails(open_link(port.path, settings(windows=SHORT)).open(attempts.append))
        assert error.kind == "refused"
        assert "0 B at every rate: is the device powered?" in error.message
        assert {one.outcome for one in attempts} == {"0 B"}
        assert len(attempts) == len(likely_rates()) + 1
        assert left_behind() == before


async def test_noise_at_every_rate_is_reported() -> None:
    with pty() as port:

        async def talk() -> None:
            while True:
                port.write(b"nothing that is known ")
                await asyncio.sleep(0.005)

        talking = asyncio.create_task(talk())
        attempts: list[Attempt] = []
        error = await fails(open_link(port.path, settings(windows=SHORT)).open(attempts.append))
        talking.cancel()
        assert error.kind == "refused"
        assert "no known message" in error.message
        assert "?baud=" in error.hint
        assert any(one.outcome.endswith("B, no frame in them") for one in attempts)


def test_a_starting_device_is_found_at_a_rate_where_it_was_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise at the other rates ended the search, though the right rate had been silent when it was listened at."""

    class Starting:
        """A port at which an MTi has started by the time the second rate is set."""

        fd = -1
        baudrate = 115_200

        def reset_input_buffer(self) -> None:
            pass

    port = Starting()
    received: list[int] = []

    def read(fd: int) -> bytes:
        received.append(port.baudrate)
        if port.baudrate == 115_200:
            return joined_frames if 57_600 in received else b""
        return b"\x55" * ENOUGH_BYTES

    joined_frames = b"".join(frame(i, i) for i in range(40))
    monkeypatch.setattr("imuscope.server.links.baud_scan._read", read)
    results = asyncio.run(scan(port, (115_200, 57_600, 9_600), windows=SHORT))
    assert [(one.baud, one.result.recognised) for one in results] == [
        (115_200, False),
        (57_600, False),
        (9_600, False),
        (115_200, True),
    ]


async def test_a_plug_pulled_during_the_search() -> None:
    with pty() as port:
        before = left_behind()[1]
        link = open_link(port.path, settings())
        usual = termios.tcgetattr(port.master)[5]
        opening = asyncio.create_task(fails(link.open()))
        await until(lambda: termios.tcgetattr(port.master)[5] != usual, "the first rate is tried")
        port.pull()
        assert (await opening).kind == "gone"
        assert left_behind()[1] == before


@pytest.mark.parametrize("call", ["tcsetattr", "tcflush"])
async def test_a_plug_pulled_while_its_port_is_opened(call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What pyserial raised was no OSError, and passed through the link."""
    usual = getattr(termios, call)
    with pty() as port:

        def pull_first(*arguments: Any) -> None:
            port.pull()
            usual(*arguments)

        monkeypatch.setattr(termios, call, pull_first)
        assert (await fails(open_link(port.path, settings()).open())).kind == "gone"


def test_a_plug_pulled_while_a_rate_is_tried() -> None:
    with pty() as port:
        opened = open_port(port.path, SerialSettings(baud=115_200))
        port.pull()
        with pytest.raises(LinkError, match="is gone"):
            try_rate(opened, port.path, 57_600)
        opened.close()


async def test_a_rate_refused_by_the_adapter_does_not_stop_the_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imuscope.server.links.baud_scan.likely_rates", lambda: (115_200, 921_600, 57_600))

    class Stubborn:
        """A port that does not do 921 600."""

        def __init__(self, port: Any) -> None:
            self.port, self.fd = port, port.fd

        @property
        def baudrate(self) -> int:
            return int(self.port.baudrate)

        @baudrate.setter
        def baudrate(self, value: int) -> None:
            if value == 921_600:
                raise ValueError("Invalid baud rate")
            self.port.baudrate = value

        def reset_input_buffer(self) -> None:
            self.port.reset_input_buffer()

    with device(57_600) as bench:
        port = open_port(bench.slave, SerialSettings())
        attempts: list[Attempt] = []
        try:
            result = await scan(Stubborn(port), (115_200, 921_600, 57_600), attempts.append)
            assert result[-1].baud == 57_600
            assert "not possible on this port" in attempts[1].outcome
        finally:
            port.close()


async def test_find_baud_leaves_the_port_at_the_rate() -> None:
    with device(921_600) as bench:
        port = open_port(bench.slave, SerialSettings())
        try:
            assert await find_baud(port, bench.slave) == 921_600
            assert port.baudrate == 921_600
        finally:
            port.close()
