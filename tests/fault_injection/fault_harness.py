"""Harness shared by the fault tests. a device with everything that came of it, and its books.

The books are what "nothing lost" means here: the bytes that the device sent are the bytes that were recorded, in order;
the samples that a browser could have are those that were in them, or the missing ones are counted.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.devices.link.session import Session
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.links.base import LinkSettings, steady_clock
from imuscope.server.links.source_url import open_link
from imuscope.server.streaming.telemetry import Telemetry
from imuscope.server.wire import DeviceHealth, DeviceInfo, EventInfo
from tests.bench.support.serial_device import frame

COUNTER = "PacketCounter"


class FaultHarness:
    """One device of a server without its HTTP side, in the test's own loop; links, decoders and clock are real."""

    def __init__(self, source: str, by_id: Path) -> None:
        now_ns = steady_clock()
        self.telemetry = Telemetry.create(lambda: now_ns() / 1e9)
        self.sessions = Sessions(
            self.telemetry.bus, open_link, all_protocols(), LinkSettings(now_ns=now_ns, by_id=by_id)
        )
        self.received: list[bytes] = []
        self.session: Session = self.sessions.add(source)
        self.session.listeners.chunks(lambda came, way: self.received.extend(one.data for one in came if way == "rx"))
        self.sessions.start()

    @property
    def bytes(self) -> bytes:
        """All received bytes."""
        return b"".join(self.received)

    @property
    def info(self) -> DeviceInfo:
        return self.session.info

    @property
    def health(self) -> DeviceHealth:
        return self.session.health(self.telemetry.bus.now())

    @property
    def samples(self) -> int:
        """That were decoded, of the device's own message."""
        self.session.access.decode()
        return sum(one.count for one in self.health.messages if one.name == "MTData2")

    def events(self, kind: str) -> list[EventInfo]:
        return [event for event in self.telemetry.log if event.kind == kind]

    def status(self, expected: str) -> Callable[[], bool]:
        return lambda: self.info.status == expected


@asynccontextmanager
async def stage(source: str, by_id: Path = Path("/nowhere")) -> AsyncIterator[FaultHarness]:
    """A device, closed as the server closes it."""
    made = FaultHarness(source, by_id)
    try:
        yield made
    finally:
        await made.sessions.close()


def frames(start: int, stop: int, rate: float = 1000.0) -> bytes:
    """MTData2 frames with a continuing packet counter."""
    return b"".join(frame(n, rate) for n in range(start, stop))


def notice_of(info: DeviceInfo) -> tuple[str, str]:
    """User-facing text: one sentence and a hint."""
    assert info.message.endswith((".", "?")), info.message
    assert info.hint, info.message
    return info.message, info.hint
