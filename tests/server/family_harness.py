"""A session with a device of any family, on a manual clock."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from imuscope.server import wire
from imuscope.server.devices.decode_options import DecodeOptions
from imuscope.server.devices.protocol_set import all_protocols
from imuscope.server.devices.session import Session
from imuscope.server.links.base import LinkSettings
from imuscope.server.streaming.telemetry import Telemetry
from tests.server.fakes import FakeClock, FakeLink

STEP_S = 0.1


class FamilyWire(FakeLink):
    """A fake link that can be written to."""

    def __init__(self, source: str, settings: LinkSettings) -> None:
        super().__init__(source, settings)
        self.written: list[bytes] = []

    async def write(self, data: bytes) -> None:
        self.written.append(data)


class FamilyHarness:
    """A device, a link and a session with the real protocols."""

    def __init__(self, reading: DecodeOptions, link: type[FakeLink] = FamilyWire) -> None:
        self.clock = FakeClock()
        self.telemetry = Telemetry.create(self.clock)
        self.link: Any = link("/dev/ttySIM", LinkSettings(now_ns=self.clock.now_ns))
        self.session = Session("1", self.link, self.telemetry.bus, all_protocols(), reading)
        self._began = self.clock.ns

    async def run(self, device: Any, seconds: float) -> None:
        """Output of a device during some seconds, in chunks of 100 ms."""
        for _ in range(round(seconds / STEP_S)):
            self.clock.move(STEP_S)
            if data := device.advance(self.clock.ns - self._began):
                self.link.send(data)
                await asyncio.sleep(0)
                await asyncio.sleep(0)
            self.session.tick(self.clock())
            self.session.access.decode()
        await asyncio.sleep(0.001)

    @property
    def info(self) -> wire.DeviceInfo:
        return self.telemetry.bus.devices.latest["1"]

    @property
    def health(self) -> wire.DeviceHealth:
        return self.session.health(self.clock())

    def events(self, kind: str) -> list[wire.EventInfo]:
        return [event for event in self.telemetry.log if event.kind == kind]


@asynccontextmanager
async def family(reading: DecodeOptions, link: type[FakeLink] = FamilyWire) -> AsyncIterator[FamilyHarness]:
    """A session that has started; closed at the end."""
    stage = FamilyHarness(reading, link)
    stage.session.start()
    await asyncio.sleep(0.001)
    yield stage
    await stage.session.close()
