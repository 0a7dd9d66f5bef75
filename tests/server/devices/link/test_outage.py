"""Samples lost in an outage are counted if the device counts them, and unknown otherwise."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.devices.link.session import Session
from imuscope.server.links.base import LinkError, LinkSettings
from imuscope.server.streaming.telemetry import Telemetry
from tests.support import virtual_time
from tests.support.each_row import each_row
from tests.support.fakes import NOW_NS, FakeClock, FakeLink


def dropout(away_s: float, *, restarted: bool = False, protocol: str = "xbus") -> tuple[Any, Any]:
    """A device streams, its link is interrupted, and it streams again; the reported gap and the health."""
    device: Any = {"xbus": XbusSimulator(measuring=True), "idtp": IdtpSimulator(), "isb": IsbSimulator()}[protocol]
    results: list[Any] = []

    async def run() -> None:
        clock = FakeClock()
        telemetry, link = Telemetry.create(clock), FakeLink("tcp://robot:4000", LinkSettings(now_ns=clock.now_ns))
        link.kind = "tcp"
        session = Session("1", link, telemetry.bus, all_protocols(), DecodeOptions(protocol))
        session.start()

        async def stream(device: Any, seconds: float) -> None:
            for _ in range(round(seconds / 0.05)):
                clock.move(0.05)
                if data := device.advance(clock.ns - NOW_NS):
                    link.send(data)
                await asyncio.sleep(0)
                await asyncio.sleep(0)
                session.access.decode()

        await stream(device, 3)
        link.die(LinkError("gone", "It closed the connection.", ""))
        await asyncio.sleep(0.001)
        device.advance(clock.ns - NOW_NS + int(away_s * 1e9))  # not received
        clock.move(away_s)
        session.retry()
        await asyncio.sleep(0.001)
        await stream(XbusSimulator(measuring=True, start_ns=clock.ns - NOW_NS) if restarted else device, 1)
        results.append(next(event for event in telemetry.log if event.kind == "gap"))
        results.append(session.health(clock()))
        await session.close()

    virtual_time.run(run())
    return results[0], results[1]


@each_row(("protocol", "counter"), [("xbus", "PacketCounter"), ("idtp", "sequence")])
def test_losses_during_a_reconnect_are_counted_by_the_device(protocol: str, counter: str) -> None:
    gap, health = dropout(4.0, protocol=protocol)
    assert (gap.data["counter"], gap.data["by"]) == (counter, "link")
    sent = {"xbus": 100, "idtp": 200}[protocol]  # frames a second
    assert gap.samples == pytest.approx(4 * sent, rel=0.03)
    assert gap.text == f"{gap.samples} samples lost ({1e3 * (gap.t1 - gap.t0):.0f} ms): the link was down."
    assert (health.gaps, health.lost) == (1, gap.samples)


def test_losses_during_a_reconnect_are_unknown_without_a_counter() -> None:
    for gap, health in (dropout(4.0, restarted=True), dropout(4.0, protocol="isb")):
        assert (gap.samples, gap.data["counter"], health.lost) == (0, "", 0)
        assert gap.text.endswith("the link was down. The number of lost samples is not known.")
