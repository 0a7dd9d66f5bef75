"""The search for the rate, on pseudo-terminals that have one: at another rate a port hears what a receiver would."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from server.links import Try, open_link
from server.links.baud_scan import RATES, find_baud, scan
from server.links.detection_text import describe_bytes
from server.links.serial import SerialSettings, open_port
from tests.links.link_fixtures import device, fails, frame, gather, joined, left_behind, pty, settings


def run(coroutine: Any) -> Any:
    return asyncio.run(coroutine)


@pytest.mark.parametrize("baud", [115_200, 921_600, 460_800, 57_600])
def test_the_rate_is_found_and_every_try_is_told(baud: int) -> None:
    async def check() -> None:
        with device(baud) as bench:
            tries: list[Try] = []
            link = open_link(bench.slave, settings())
            await link.open(tries.append)
            try:
                assert link.baud == baud
                assert link.capacity == baud / 10
                assert [one.what.replace(" ", "") for one in tries] == [f"{rate}Bd" for rate in RATES[: len(tries)]]
                assert "Xbus frame" in tries[-1].outcome
                for wrong in tries[:-1]:
                    assert wrong.outcome.endswith(("B, no frame in them", "0 B")), wrong.outcome
                data = joined(await gather(link, 500))
                assert describe_bytes(data).certain
            finally:
                await link.close()

    run(check())


def test_a_pseudo_terminal_without_a_rate_is_recognised_at_once() -> None:
    async def check() -> None:
        with pty() as port:

            async def talk() -> None:
                for i in range(1000):
                    port.write(frame(i, i))
                    await asyncio.sleep(0.005)

            talking = asyncio.create_task(talk())
            tries: list[Try] = []
            link = open_link(port.path, settings())
            await link.open(tries.append)
            assert link.baud == 115_200
            assert len(tries) == 1
            talking.cancel()
            await link.close()

    run(check())


def test_silence_at_every_rate_is_said_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("server.links.baud_scan.WINDOW_S", 0.02)
    monkeypatch.setattr("server.links.baud_scan.LONG_WINDOW_S", 0.05)

    async def check() -> None:
        with pty() as port:
            before = left_behind()
            tries: list[Try] = []
            error = await fails(open_link(port.path, settings()).open(tries.append))
            assert error.kind == "refused"
            assert "0 B at every rate: is the device powered?" in error.message
            assert {one.outcome for one in tries} == {"0 B"}
            assert len(tries) == len(RATES) + 1
            assert left_behind() == before

    run(check())


def test_noise_at_every_rate_is_said_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("server.links.baud_scan.WINDOW_S", 0.02)
    monkeypatch.setattr("server.links.baud_scan.LONG_WINDOW_S", 0.02)

    async def check() -> None:
        with pty() as port:

            async def talk() -> None:
                while True:
                    port.write(b"nothing that is known ")
                    await asyncio.sleep(0.005)

            talking = asyncio.create_task(talk())
            tries: list[Try] = []
            error = await fails(open_link(port.path, settings()).open(tries.append))
            talking.cancel()
            assert error.kind == "refused"
            assert "no known message" in error.message
            assert "?baud=" in error.hint
            assert any(one.outcome.endswith("B, no frame in them") for one in tries)

    run(check())


def test_a_plug_pulled_during_the_search() -> None:
    async def check() -> None:
        with pty() as port:
            before = left_behind()[1]
            link = open_link(port.path, settings())
            opening = asyncio.create_task(fails(link.open()))
            await asyncio.sleep(0.1)
            port.pull()
            assert (await opening).kind == "gone"
            assert left_behind()[1] == before

    run(check())


def test_a_rate_that_the_adapter_refuses_is_no_reason_to_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("server.links.baud_scan.RATES", (115_200, 921_600, 57_600))

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

    async def check() -> None:
        with device(57_600) as bench:
            port = open_port(bench.slave, SerialSettings())
            tries: list[Try] = []
            try:
                found = await scan(Stubborn(port), (115_200, 921_600, 57_600), tries.append)
                assert found[-1].baud == 57_600
                assert "not possible on this port" in tries[1].outcome
            finally:
                port.close()

    run(check())


def test_find_baud_leaves_the_port_at_the_rate() -> None:
    async def check() -> None:
        with device(921_600) as bench:
            port = open_port(bench.slave, SerialSettings())
            try:
                assert await find_baud(port, bench.slave) == 921_600
                assert port.baudrate == 921_600
            finally:
                port.close()

    run(check())
