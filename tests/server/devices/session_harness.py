"""One session with a link and a clock that the test moves."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, TypeVar

from imuscope.server import wire
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_detection import ProtocolSet
from imuscope.server.devices.decode.sequence_store import SequenceStore
from imuscope.server.devices.link.session import Session
from imuscope.server.links.base import LinkSettings
from imuscope.server.streaming.telemetry import Telemetry
from tests.support.fakes import SPEECH, FakeClock, FakeLink

Harness = TypeVar("Harness", bound="SessionHarness")


class SessionHarness:
    """Telemetry, a fake link and a session that runs."""

    def __init__(
        self,
        protocols: ProtocolSet = SPEECH,
        reading: DecodeOptions = DecodeOptions("fake"),  # noqa: B008 (it is frozen)
        *,
        link: type[FakeLink] = FakeLink,
        store: SequenceStore | None = None,
    ) -> None:
        self.clock = FakeClock()
        self.began = self.clock.ns
        self.telemetry = Telemetry.create(self.clock)
        self.link: Any = link("/dev/ttyFAKE", LinkSettings(now_ns=self.clock.now_ns))
        self.session = Session("1", self.link, self.telemetry.bus, protocols, reading, store)

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
            await self.receive(chunk)
            self.session.access.decode()
        await self.settle()

    async def receive(self, chunk: bytes) -> None:
        """A chunk arrives now; it is not decoded yet."""
        self.link.send(chunk)
        await asyncio.sleep(0)
        await asyncio.sleep(0)

    @property
    def info(self) -> wire.DeviceInfo:
        return self.telemetry.bus.devices.latest["1"]

    @property
    def health(self) -> wire.DeviceHealth:
        return self.session.health(self.clock())

    def events(self, kind: str) -> list[wire.EventInfo]:
        return [event for event in self.telemetry.log if event.kind == kind]

    def channel(self, name: str) -> Any:
        return next(one for one in self.telemetry.store.all if one.info.name == name)


@asynccontextmanager
async def started(stage: Harness) -> AsyncIterator[Harness]:
    """With its session, which is closed at the end."""
    stage.session.start()
    await stage.settle()
    yield stage
    await stage.session.close()


@asynccontextmanager
async def playing(protocol: str = "fake") -> AsyncIterator[SessionHarness]:
    """A session that has started; its device is gone when it is closed."""
    async with started(SessionHarness(reading=DecodeOptions(protocol))) as stage:
        yield stage
    assert stage.telemetry.bus.devices.latest == {}
