"""One session with a link and a clock that the test moves."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from imuscope.server.devices.decode_options import DecodeOptions
from imuscope.server.devices.protocol_detection import ProtocolSet
from imuscope.server.devices.session import Session
from imuscope.server.links.base import LinkSettings
from imuscope.server.streaming.telemetry import Telemetry
from tests.server.fakes import SPEECH, FakeClock, FakeLink


class SessionHarness:
    """Telemetry, a fake link and a session that runs."""

    def __init__(self, protocol: str = "fake", protocols: ProtocolSet = SPEECH) -> None:
        self.clock = FakeClock()
        self.telemetry = Telemetry.create(self.clock)
        self.link = FakeLink("/dev/ttyFAKE", LinkSettings(now_ns=self.clock.now_ns))
        self.session = Session("1", self.link, self.telemetry.bus, protocols, DecodeOptions(protocol))

    async def settle(self, seconds: float = 0.0) -> None:
        """Let the tasks run; then time passes in ticks of 0.1 s."""
        await asyncio.sleep(0.001)
        self.session.access.decode()
        ticks = round(seconds / 0.1)
        for _ in range(ticks):
            self.clock.move(0.1)
            self.session.tick(self.clock())
            self.session.access.decode()
        await asyncio.sleep(0.001)

    async def send(self, *chunks: bytes, every: float = 0.01) -> None:
        for chunk in chunks:
            self.clock.move(every)
            self.link.send(chunk)
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            self.session.access.decode()
        await self.settle()

    @property
    def status(self) -> str:
        return self.telemetry.bus.devices.latest["1"].status

    def events(self, kind: str) -> list[Any]:
        return [event for event in self.telemetry.log if event.kind == kind]

    def channel(self, name: str) -> Any:
        return next(one for one in self.telemetry.store.all if one.info.name == name)


@asynccontextmanager
async def playing(protocol: str = "fake") -> AsyncIterator[SessionHarness]:
    """A session that has started; its device is gone when it is closed."""
    stage = SessionHarness(protocol)
    stage.session.start()
    await stage.settle()
    yield stage
    await stage.session.close()
    assert stage.telemetry.bus.devices.latest == {}
