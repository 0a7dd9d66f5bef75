"""Simulators of the other families, from bytes to the page: senders, protection, refused frames.

The protocols are the real ones; link and clock are moved by the test.
"""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from types import MappingProxyType
from typing import Any

import pytest

from imuscope.protocols.events import batches
from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server import wire
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.links.base import LinkError
from imuscope.server.wire import codec as wire_codec
from tests.server.devices.family_harness import FamilyHarness, family
from tests.support.decode_options import decode_options
from tests.support.each_row import each_row
from tests.support.fakes import FakeFile, FakeLink, TwoWayLink
from tests.support.faulty_line import FaultyLine

KEY = bytes(range(32))


@asynccontextmanager
async def playing(
    reading: DecodeOptions = DecodeOptions(),  # noqa: B008
    link: type[FakeLink] = TwoWayLink,
) -> AsyncIterator[FamilyHarness]:
    async with family(reading, link) as stage:
        yield stage
        report = "".join(
            wire_codec.encode_text(wire.Events(list(stage.telemetry.log)))
            + wire_codec.encode_text(wire.Devices([stage.info]))
        )
        assert KEY.hex() not in report


# -- who it is ---------------------------------------------------------------------------------------------------------


async def test_an_imx_is_identified_and_its_first_fix_is_one_event() -> None:
    async with playing() as stage:
        await stage.run(IsbSimulator(), 6)
        assert (stage.info.name, stage.info.product, stage.info.serial_number) == ("IMX-5", "IMX-5.0.4", "62000")
        assert (stage.info.firmware, stage.info.status, stage.info.protection) == ("2.7.1", "live", "")
        [step] = stage.events("clock")
        assert step.text.startswith("The device has received the date")
        assert stage.link.sent == []  # it has identified itself
        health = stage.health
        assert (health.rejects_by, health.verified, health.unverified) == ({}, None, None)
        assert health.rate == pytest.approx(100, abs=3)
        for channel in stage.telemetry.store.all:
            arrival, time = channel.ring.read()[:2]
            assert abs(time - arrival)[time == time].max() < 0.2, (
                channel.info.name
            )  # never 1980, nor a spike at the fix


async def test_an_imx_that_streams_already_is_queried_once_for_each_connection() -> None:
    async with playing() as stage:
        device = IsbSimulator()
        device.advance(1_000_000_000)
        stage.clock.move(1.0)
        await stage.run(device, 1)
        assert stage.link.sent == [PROTOCOLS["isb"].device.identify_request]
        assert stage.info.product == ""
        stage.link.send(device.receive(stage.link.sent[0], stage.clock.ns - stage.began))
        await stage.run(device, 0.5)
        assert (stage.info.name, stage.link.sent) == ("IMX-5", [PROTOCOLS["isb"].device.identify_request])
        stage.link.die(LinkError("gone", "gone.", "?"))
        await asyncio.sleep(0.001)
        stage.session.retry()
        await asyncio.sleep(0.001)
        await stage.run(device, 1)
        assert len(stage.link.sent) == 2


@each_row("link", [FakeFile, FakeLink])
async def test_files_and_one_way_links_are_not_sent_an_identify_request(link: type[FakeLink]) -> None:
    """The `write` of FakeLink raises."""
    async with playing(link=link) as stage:
        device = IsbSimulator()
        device.advance(1_000_000_000)
        stage.clock.move(1.0)
        await stage.run(device, 1)
        assert stage.info.status == "live"
        assert getattr(stage.link, "written", []) == []


async def test_families_without_an_identify_request_are_sent_nothing() -> None:
    async with playing() as stage:
        await stage.run(XbusSimulator(measuring=True), 1)
        assert stage.info.status == "live"
        assert stage.link.sent == []


@each_row("device", [IsbSimulator, IdtpSimulator, XbusSimulator])
async def test_a_clock_jump_is_reported_once(device: Any) -> None:
    async with playing() as stage:
        await stage.run(device(clock_jump=(8.0, 10.0)), 10)
        kinds = [event.data["kind"] for event in stage.events("clock")]
        assert kinds == (["sync", "jump"] if device is IsbSimulator else ["jump"])


# -- how well it is protected ------------------------------------------------------------------------------------------


@each_row(
    ("mode", "reading", "words", "verified", "suffix"),
    [
        (0, DecodeOptions(), "Lite, CRC-8 of the header alone", True, ""),
        (1, DecodeOptions(), "Safety, CRC-32", True, ""),
        (2, decode_options(key=KEY), "Secure, verified", True, ""),
        (2, decode_options(unverified=True), "Secure, unverified: no key", False, "?"),
    ],
)
async def test_protection_in_words(mode: int, reading: DecodeOptions, words: str, verified: bool, suffix: str) -> None:
    async with playing(reading) as stage:
        await stage.run(IdtpSimulator(mode=mode, key=KEY), 2)
        assert (stage.info.name, stage.info.serial_number) == ("IDTP device 102", "102")
        assert stage.info.protection == words
        count = stage.health.verified if verified else stage.health.unverified
        assert count is not None
        assert count > 300
        assert (stage.health.unverified if verified else stage.health.verified) == 0
        infos = [channel.info for channel in stage.telemetry.store.all]
        assert {info.verified for info in infos} == {verified}
        assert f"Acceleration{suffix}" in {info.name for info in infos}


async def test_without_a_key_one_event_and_the_remedy() -> None:
    async with playing() as stage:
        await stage.run(IdtpSimulator(mode=2, key=KEY), 4)
        assert stage.info.status == "connecting"
        assert stage.info.message.startswith("Secure frames are arriving, but there is no key")
        assert stage.info.hint.startswith("Give the key")
        assert len(stage.info.notices) == 1
        assert [event.data for event in stage.events("device") if "reason" in event.data] == [{"reason": "no_key"}]
        assert stage.events("reject") == []
        assert stage.health.rejects_by == {"no_key": stage.health.rejects}
        assert stage.health.rejects > 700


@each_row(
    ("reading", "mode", "reason"),
    [(decode_options(key=b"other"), 2, "bad_hmac"), (decode_options(min_mode="secure"), 1, "below_min_mode")],
)
async def test_the_wrong_key_and_a_weak_mode_are_reported(reading: DecodeOptions, mode: int, reason: str) -> None:
    async with playing(reading) as stage:
        await stage.run(IdtpSimulator(mode=mode, key=KEY), 3)
        assert stage.info.status == "connecting"
        assert {event.data.get("reason") for event in stage.events("device")} >= {reason}
        assert stage.health.rejects_by.keys() == {reason}
        assert stage.info.hint


async def test_frames_beside_good_ones_that_fail_are_counted_by_reason_only() -> None:
    async with playing(decode_options("idtp", key=KEY)) as stage:
        await stage.run(FaultyLine("idtp", IdtpSimulator(mode=2, key=KEY), corrupt=0.1), 3)
        assert stage.info.status == "live"
        assert stage.health.rejects_by["bad_hmac"] > 0
        assert stage.info.notices == []


class Several:
    """Devices that share a link; each may stop after some seconds."""

    next_ns = 0

    def __init__(
        self, *devices: IdtpSimulator | FaultyLine, stop_s: Mapping[int, float] = MappingProxyType({})
    ) -> None:
        self.devices = devices
        self.stop_s = stop_s

    def advance(self, now_ns: int) -> bytes:
        texts = [(getattr(one, "device_id", 0), one.advance(now_ns)) for one in self.devices]
        return b"".join(data for number, data in texts if now_ns < self.stop_s.get(number, 1e9) * 1e9)


async def test_every_sender_is_a_device_of_its_own() -> None:
    async with playing() as stage:
        await stage.run(Several(IdtpSimulator(device_id=7, rate=50), IdtpSimulator(device_id=102, mode=0, rate=25)), 30)
        first, second = stage.session.infos
        assert (first.id, first.parent, first.name) == ("1", "", "IDTP device 7")
        assert (second.id, second.parent, second.name) == ("1.102", "1", "IDTP device 102")
        assert (first.serial_number, second.serial_number) == ("7", "102")
        assert (first.protection, second.protection) == ("Safety, CRC-32", "Lite, CRC-8 of the header alone")
        assert (first.status, second.status) == ("live", "live")
        assert [*stage.telemetry.bus.devices.latest] == ["1", "1.102"]
        channels = [channel.info for channel in stage.telemetry.store.all]
        for device in "1", "1.102":
            names = [info.name for info in channels if info.device == device]
            assert "Quaternion" in names
            assert len(names) == len(set(names))
        one, other = stage.session.health_of_all(stage.clock())
        assert one.rate == pytest.approx(50, abs=2)
        assert other.rate == pytest.approx(25, abs=1)
        assert one.bytes == other.bytes  # the link's
        assert one.uncertainty_ms is not None
        assert other.uncertainty_ms is not None


async def test_times_on_a_full_line_have_no_uncertainty_and_no_drift() -> None:
    """Regression: ± 0.3 ms was stated beside a queue of 13.7 ms in the device."""
    async with playing() as stage:
        line = Several(IdtpSimulator(device_id=7), IdtpSimulator(device_id=102, mode=0, rate=50))
        await stage.run(line, 5)
        stage.session.health_of_all(stage.clock())
        await stage.run(line, 10)
        for health in stage.session.health_of_all(stage.clock()):
            assert (health.uncertainty_ms, health.drift_ppm, health.drift_bound_ppm) == (None, None, None)
            assert health.time_presumes.startswith("the line is nearly full")


async def test_losses_of_one_of_several_devices_are_its_own() -> None:
    async with playing() as stage:
        lossy = FaultyLine("idtp", IdtpSimulator(device_id=9), drop=0.1)
        await stage.run(Several(IdtpSimulator(device_id=7), lossy), 3)
        first, second = stage.session.health_of_all(stage.clock())
        assert (first.gaps, first.lost) == (0, 0)
        assert second.lost > 20
        assert {event.device for event in stage.events("gap")} == {"1.9"}


async def test_refusals_on_a_shared_link_are_shown_with_each_device() -> None:
    async with playing() as stage:
        corrupted = FaultyLine("idtp", IdtpSimulator(device_id=9), corrupt=0.2)
        await stage.run(Several(IdtpSimulator(device_id=7), corrupted), 3)
        first, second = stage.session.health_of_all(stage.clock())
        assert first.rejects > 50
        assert (first.rejects, first.rejects_by) == (second.rejects, second.rejects_by)
        assert {event.device for event in stage.events("reject")} == {"1"}, "told once"


@each_row("stops", [7, 9])
async def test_one_of_several_falls_silent_and_comes_back(stops: int) -> None:
    async with playing() as stage:
        pair = Several(IdtpSimulator(device_id=7), IdtpSimulator(device_id=9), stop_s={stops: 2})
        await stage.run(pair, 6)
        states = {info.serial_number: info for info in stage.session.infos}
        other = 16 - stops
        assert (states[str(stops)].status, states[str(other)].status) == ("lost", "live")
        assert "others on its link continue" in states[str(stops)].message
        pair.stop_s = {}
        await stage.run(pair, 1)
        assert [info.status for info in stage.session.infos] == ["live", "live"]


async def test_all_devices_of_a_link_share_its_status() -> None:
    async with playing() as stage:
        await stage.run(Several(IdtpSimulator(device_id=7), IdtpSimulator(device_id=9)), 2)
        stage.link.die(LinkError("gone", "gone.", "?"))
        await asyncio.sleep(0.001)
        stage.session.tick(stage.clock())
        assert [(info.status, info.message) for info in stage.session.infos] == [("lost", "gone.")] * 2
        stage.session.retry()
        await stage.run(Several(IdtpSimulator(device_id=9), IdtpSimulator(device_id=7)), 2)
        assert [(info.status, info.serial_number) for info in stage.session.infos] == [("live", "7"), ("live", "9")]
    hub = stage.telemetry
    assert (dict(hub.bus.devices.latest), hub.store.all) == ({}, []), "they leave together"


async def test_devices_beyond_the_most_are_counted() -> None:
    async with playing() as stage:
        await stage.run(Several(*(IdtpSimulator(device_id=n, rate=10) for n in range(1, 19))), 1)
        assert len(stage.session.infos) == 16
        assert len([event for event in stage.events("device") if "most" in event.data]) == 1
        counts = {message.name: message.count for message in stage.health.messages}
        assert counts["other devices"] > 0


def test_datagrams_stand_alone() -> None:
    frame = IdtpSimulator().advance(0)[:64]
    for kind, accepted in (("udp", 0), ("serial", 1)):
        decoder = all_protocols().decoder("idtp", DecodeOptions(), kind)
        for half in (frame[:30], frame[30:]):
            decoder.feed(half, 0)
        assert len([*batches(decoder.drain())]) == accepted


async def test_messages_that_pass_through_are_counted_by_name() -> None:
    class Port:
        next_ns = 0

        def __init__(self) -> None:
            self.device = IsbSimulator()

        def advance(self, now_ns: int) -> bytes:
            ubx = bytes.fromhex("B562 0A04 0000")
            first = second = 0
            for byte in ubx[2:]:
                first = (first + byte) & 0xFF
                second = (second + first) & 0xFF
            return self.device.advance(now_ns) + b"$HCHDM,123.45,M*18\r\n" + ubx + bytes((first, second))

    async with playing() as stage:
        await stage.run(Port(), 2)
        counts = {message.name: message.count for message in stage.health.messages}
        assert counts["nmea HCHDM"] == 20  # one in each chunk of 100 ms
        assert counts["ubx MON-VER"] == 20
        assert stage.health.rejects == 0
        assert stage.health.unclaimed == 0
        assert stage.info.notices == []


# -- two protocols in one stream ---------------------------------------------------------------------------------------


async def test_a_mixed_stream_is_reported() -> None:
    class Mixed:
        next_ns = 0

        def __init__(self) -> None:
            self.devices = IsbSimulator(), IdtpSimulator()

        def advance(self, now_ns: int) -> bytes:
            return b"".join(device.advance(now_ns) for device in self.devices)

    async with playing(DecodeOptions("isb")) as stage:
        await stage.run(Mixed(), 12)
        [notice] = stage.info.notices
        assert "IDTP 2.1" in notice
        assert "Inertial Sense" in notice
        [event] = [event for event in stage.events("device") if "protocols" in event.data]
        assert event.data["protocols"] == ["isb", "idtp"]
        assert stage.info.status == "live"


async def test_a_stream_decoded_with_the_wrong_protocol() -> None:
    async with playing(DecodeOptions("xbus")) as stage:
        await stage.run(IdtpSimulator(), 7)
        assert stage.info.status == "connecting"
        assert stage.info.message.startswith("These bytes are IDTP 2.1, but are decoded as Xsens")
        assert stage.info.hint


@each_row("device", [IsbSimulator(), IdtpSimulator(), XbusSimulator("MTi-680G", measuring=True)])
async def test_a_stream_of_one_protocol_is_not_called_mixed(device: Any) -> None:
    async with playing() as stage:
        await stage.run(device, 6)
        assert stage.info.notices == []


# -- read in another way -----------------------------------------------------------------------------------------------


async def test_a_key_given_later_keeps_the_device_its_history_and_its_place() -> None:
    async with playing(decode_options(unverified=True)) as stage:
        device = IdtpSimulator(mode=2, key=KEY)
        await stage.run(device, 2)
        unverified = {channel.info.name: channel for channel in stage.telemetry.store.all}
        before = stage.health.unverified
        assert before
        stored = len(unverified["Quaternion?"].ring)
        await stage.session.read_as(stage.session.decode_options.replaced({"key": KEY.hex()}))
        assert stage.info.id == "1"
        await stage.run(device, 2)
        assert (stage.info.status, stage.info.protection) == ("live", "Secure, verified")
        assert (stage.health.unverified, stage.health.rejects) == (0, 0)
        assert stage.health.verified
        assert len(unverified["Quaternion?"].ring) == stored
        assert "Quaternion" in {channel.info.name for channel in stage.telemetry.store.all}
        assert stage.link.opened == 1, "the link stays open"


async def test_a_key_given_later_ends_the_refusals_and_their_advice() -> None:
    async with playing() as stage:
        device = IdtpSimulator(mode=2, key=KEY)
        await stage.run(device, 3)
        assert stage.health.rejects_by.keys() == {"no_key"}
        await stage.session.read_as(decode_options(key=KEY))
        await stage.run(device, 2)
        assert (stage.info.status, stage.info.notices, stage.info.hint) == ("live", [], "")
        assert stage.health.rejects_by == {}
