"""A session with a device of any family, on a manual clock."""

import asyncio
from contextlib import AbstractAsyncContextManager
from typing import Any

from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from tests.server.devices.session_harness import SessionHarness, started
from tests.support.fakes import FakeLink, TwoWayLink

STEP_S = 0.1


class FamilyHarness(SessionHarness):
    """A device, a link that takes what is written to it, and a session with the real protocols."""

    def __init__(self, reading: DecodeOptions, link: type[FakeLink] = TwoWayLink) -> None:
        super().__init__(all_protocols(), reading, link=link)

    async def run(self, device: Any, seconds: float) -> None:
        """Output of a device during some seconds, in chunks of 100 ms."""
        for _ in range(round(seconds / STEP_S)):
            self.clock.move(STEP_S)
            if data := device.advance(self.clock.ns - self.began):
                await self.receive(data)
            self.session.tick(self.clock())
            self.session.access.decode()
        await asyncio.sleep(0.001)


def family(reading: DecodeOptions, link: type[FakeLink] = TwoWayLink) -> AbstractAsyncContextManager[FamilyHarness]:
    """A session that has started; closed at the end."""
    return started(FamilyHarness(reading, link))
