"""Hints about a link fit the kind of link."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from imuscope.protocols.idtp.frames import LITE, SAFETY, build
from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.server.devices.decode.decode_options import DecodeOptions, url_options
from imuscope.server.devices.decode.protocol_detection import unknown_hint
from imuscope.server.devices.link.session import Session
from imuscope.server.links.base import LinkError, LinkSettings
from imuscope.server.links.source_url import open_link
from tests.protocols.idtp.idtp_frames import with_version
from tests.server.devices.family_harness import FamilyHarness
from tests.support import virtual_time
from tests.support.each_row import each_row
from tests.support.fakes import FakeLink


class Datagrams(FakeLink):
    """A UDP link."""

    kind = "udp"

    def __init__(self, source: str, settings: LinkSettings) -> None:
        super().__init__("udp://:5005", settings)


class AdviceText:
    """A link that sends bytes of no protocol."""

    next_ns = 0

    def advance(self, now_ns: int) -> bytes:
        return b"the quick brown fox " * 20


class Newer:
    """An IDTP 3.1 device."""

    next_ns = 0

    def __init__(self) -> None:
        self.sent = 0

    def advance(self, now_ns: int) -> bytes:
        self.sent += 1
        return with_version(build(0, bytes(12), sequence=self.sent, timestamp=self.sent, mode=SAFETY), 0x31)


def stage_after(device: Any, reading: DecodeOptions, link: type[FakeLink], seconds: float = 2) -> Session:
    results: list[Session] = []

    async def run() -> None:
        stage = FamilyHarness(reading, link)
        stage.session.start()
        await asyncio.sleep(0.001)
        await stage.run(device, seconds)
        results.append(stage.session)
        await stage.session.close()

    virtual_time.run(run())
    return results[0]


def test_no_baud_rate_is_suggested_for_udp() -> None:
    assert stage_after(AdviceText(), DecodeOptions(), Datagrams).info.hint == unknown_hint("udp")
    assert "baud" not in unknown_hint("udp")
    assert "baud" in unknown_hint("serial")


@each_row("reading", [DecodeOptions(), DecodeOptions("idtp")])
def test_another_version_is_named(reading: DecodeOptions) -> None:
    session = stage_after(Newer(), reading, Datagrams)
    messages = [session.info.message, *(event.text for event in session._sink._log)]
    assert any("IDTP 3.1" in one for one in messages), messages


@each_row(("mode", "link", "warned"), [(LITE, Datagrams, 1), (SAFETY, Datagrams, 0), (LITE, FakeLink, 0)])
def test_lite_frames_over_a_network_are_reported_as_unprotected(mode: int, link: type[FakeLink], warned: int) -> None:
    session = stage_after(IdtpSimulator(mode=mode), DecodeOptions(), link)
    assert sum("their values are not protected" in notice for notice in session.info.notices) == warned
    assert sum("are not protected" in event.text for event in session._sink._log) == warned


def test_the_options_that_any_source_has_are_named() -> None:
    """A misspelt option of udp:// was answered with: It takes no options."""
    with pytest.raises(LinkError) as caught:
        open_link("udp://:5000?keys=00")
    words = caught.value.hint.partition("Any source has ")[2].removesuffix(".")
    assert words.replace(" and ", ", ").split(", ") == url_options()
