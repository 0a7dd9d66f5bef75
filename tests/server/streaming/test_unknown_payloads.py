"""Payloads without a definition: none are lost or decoded, and noise cannot fill memory with them."""

from __future__ import annotations

import numpy as np
import pytest

from imuscope.protocols.events import Batch, Reply
from imuscope.protocols.idtp.decoder import IdtpDecoder
from imuscope.protocols.idtp.frames import build as idtp_frame
from imuscope.protocols.isb.decoder import IsbDecoder
from imuscope.protocols.isb.frames import DATA
from imuscope.protocols.isb.frames import build as isb_frame
from imuscope.protocols.schema.fields import Field, Message
from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.protocols.xbus.frames import build as xbus_frame
from imuscope.server import wire
from imuscope.server.devices.device.device_demux import LinkDecoder, LinkDevices
from imuscope.server.devices.device.device_state import DeviceState
from imuscope.server.links.base import Chunk
from imuscope.server.streaming.telemetry import Telemetry
from imuscope.server.streaming.unknown_payloads import MAX_BYTES, MAX_KINDS, UnknownPayloadTracker
from tests.support.fakes import FakeClock


def played(decoder: object, *frames: bytes) -> tuple[Telemetry, list[wire.UnknownPayload]]:
    """Reports for frames that arrived 10 ms apart."""
    clock = FakeClock()
    telemetry = Telemetry.create(clock)
    portrait = DeviceState(telemetry.bus, wire.DeviceInfo("1", "d", "test", "file", "live"), str)
    senders = LinkDevices(telemetry.bus, portrait, str)
    reader = LinkDecoder(telemetry.bus, senders, decoder)  # type: ignore[arg-type]
    for frame in frames:
        clock.move(0.01)
        reader.feed(Chunk(frame, clock.ns))
        reader.drain()
    return telemetry, senders.unknown_payloads(clock())


def vendor(k: int, kind: int = 0x80) -> bytes:
    return idtp_frame(kind, bytes([6, 0, k, 3]), sequence=k, timestamp=10_000 * k, mode=1, device=7)


def test_a_vendor_type_of_idtp() -> None:
    telemetry, [raw] = played(IdtpDecoder(), *(vendor(k) for k in range(100)))
    assert (raw.name, raw.id, raw.count, raw.size, raw.hex, raw.verified) == ("0x80", 0x80, 100, 4, "06006303", True)
    assert raw.rate == pytest.approx(100, rel=0.05)
    assert [one.info.name for one in telemetry.store.all] == ["0x80Status"]  # the status of its frames; no byte of it
    assert [column.name for one in telemetry.store.all for column in one.info.columns] == ["value"]


def test_an_unknown_item_of_xbus() -> None:
    item = bytes([0x4F, 0xF0, 3, 1, 2, 3])
    telemetry, [raw] = played(XbusDecoder(), *(xbus_frame(0x36, item) for _ in range(3)))
    assert (raw.name, raw.id, raw.hex, raw.count) == ("0x4FF0", 0x4FF0, "010203", 3)
    assert telemetry.store.all == []


def test_a_data_set_whose_layout_is_not_public() -> None:
    telemetry, [raw] = played(IsbDecoder(), *(isb_frame(DATA, 89, bytes(range(8))) for _ in range(5)))
    assert (raw.name, raw.id, raw.hex, raw.count) == ("DID_RTK_DEBUG_2", 89, "0001020304050607", 5)
    assert [event for event in telemetry.log if event.kind == "reply"] == []  # it streams: no news each time


def test_a_long_payload_is_cut_and_its_size_reported() -> None:
    unknown_payloads = UnknownPayloadTracker("1")
    message = Message(1, "Blob", (Field("data", "bytes", (-1,)),), kind="reply")
    assert unknown_payloads.reply(Reply(message, {"data": bytes(1500)}, 0, 1508, 0))
    [raw] = unknown_payloads.report(0.0)
    assert (raw.size, len(raw.hex)) == (1500, 2 * MAX_BYTES)


def test_unverified_bytes_are_marked() -> None:
    frame = idtp_frame(0x80, b"abcd", sequence=1, timestamp=0, mode=2, device=7, key=b"k")
    _, [raw] = played(IdtpDecoder(show_unverified=True), frame)
    assert not raw.verified


def test_kinds_are_bounded() -> None:
    unknown_payloads = UnknownPayloadTracker("1")
    for number in range(2 * MAX_KINDS):
        message = Message(number, f"M{number}", (Field("data", "bytes", (2,)),))
        one = np.zeros(1, np.int64)
        unknown_payloads.batch(
            Batch(message, "", one, one, None, {"data": np.zeros((1, 2), np.uint8)}), np.full(1, np.nan)
        )
    assert len(unknown_payloads.report(0.0)) == MAX_KINDS


def test_other_replies_are_left_alone() -> None:
    message = Message(1, "DeviceID", (Field("device_id", ">u4"),), kind="reply")
    assert not UnknownPayloadTracker("1").reply(Reply(message, {"device_id": 3}, 0, 8, 0))


def test_the_calibration_that_a_recording_requests_is_no_unknown_payload() -> None:
    telemetry, payloads = played(XbusDecoder(), xbus_frame(0x91, bytes(256)), xbus_frame(0xAD, bytes(4)))
    assert [one.name for one in payloads] == ["GnssReceiverSettingsAck"]
    assert not any(event.kind == "reply" for event in telemetry.bus.events_since(0.0))


def test_unknown_payloads_are_sent_until_there_are_none() -> None:
    telemetry, payloads = played(IdtpDecoder(), vendor(1))
    messages: list[int] = []
    telemetry.bus.unknown_payloads.subscribe(lambda report: messages.append(len(report)))
    for report in ([], payloads, payloads, [], []):
        telemetry.bus.report_unknown_payloads(report)
    assert messages == [1, 1, 0]
