"""Bytes that nobody has described: none vanish, none become numbers, and noise cannot fill memory with them."""

from __future__ import annotations

import numpy as np
import pytest

from protocols.events import Batch, Reply
from protocols.idtp.decoder import IdtpDecoder
from protocols.idtp.frames import build as idtp_frame
from protocols.isb.decoder import IsbDecoder
from protocols.isb.frames import DATA
from protocols.isb.frames import build as isb_frame
from protocols.schema import Field, Message
from protocols.xbus.decoder import XbusDecoder
from protocols.xbus.frames import build as xbus_frame
from server import wire
from server.devices.device_demux import LinkDevices, StreamDecoder
from server.devices.device_state import DeviceState
from server.links.base import Chunk
from server.streaming.hub import Hub
from server.streaming.unknown_payloads import MOST_BYTES, MOST_KINDS, UnknownPayloads
from tests.server.fakes import Clock


def played(decoder: object, *frames: bytes) -> tuple[Hub, list[wire.RawPayload]]:
    """What is told of frames that came 10 ms apart."""
    clock = Clock()
    hub = Hub(clock)
    portrait = DeviceState(hub, wire.DeviceInfo("1", "d", "test", "file", "live"), str)
    senders = LinkDevices(hub, portrait, str)
    reader = StreamDecoder(hub, senders, decoder)  # type: ignore[arg-type]
    for frame in frames:
        clock.move(0.01)
        reader.feed(Chunk(frame, clock.ns))
        reader.drain()
    return hub, senders.raws(clock())


def vendor(k: int, kind: int = 0x80) -> bytes:
    return idtp_frame(kind, bytes([6, 0, k, 3]), sequence=k, timestamp=10_000 * k, mode=1, device=7)


def test_a_vendor_type_of_idtp() -> None:
    hub, [raw] = played(IdtpDecoder(), *(vendor(k) for k in range(100)))
    assert (raw.name, raw.id, raw.count, raw.size, raw.hex, raw.verified) == ("0x80", 0x80, 100, 4, "06006303", True)
    assert raw.rate == pytest.approx(100, rel=0.05)
    assert [one.info.name for one in hub.channels.values()] == ["0x80Status"]  # the status of its frames; no byte of it
    assert [column.name for one in hub.channels.values() for column in one.info.columns] == ["value"]


def test_an_unknown_item_of_xbus() -> None:
    item = bytes([0x4F, 0xF0, 3, 1, 2, 3])
    hub, [raw] = played(XbusDecoder(), *(xbus_frame(0x36, item) for _ in range(3)))
    assert (raw.name, raw.id, raw.hex, raw.count) == ("0x4FF0", 0x4FF0, "010203", 3)
    assert list(hub.channels) == []


def test_a_data_set_whose_layout_is_not_public() -> None:
    hub, [raw] = played(IsbDecoder(), *(isb_frame(DATA, 89, bytes(range(8))) for _ in range(5)))
    assert (raw.name, raw.id, raw.hex, raw.count) == ("DID_RTK_DEBUG_2", 89, "0001020304050607", 5)
    assert [event for event in hub.log if event.kind == "reply"] == []  # it streams: no news each time


def test_a_long_payload_is_cut_and_its_size_told() -> None:
    raws = UnknownPayloads("1")
    message = Message(1, "Blob", (Field("data", "bytes", (-1,)),), kind="reply")
    assert raws.reply(Reply(message, {"data": bytes(1500)}, 0, 1508, 0))
    [raw] = raws.report(0.0)
    assert (raw.size, len(raw.hex)) == (1500, 2 * MOST_BYTES)


def test_unverified_bytes_are_told_apart() -> None:
    frame = idtp_frame(0x80, b"abcd", sequence=1, timestamp=0, mode=2, device=7, key=b"k")
    _, [raw] = played(IdtpDecoder(show_unverified=True), frame)
    assert not raw.verified


def test_kinds_are_bounded_and_what_is_beyond_is_counted() -> None:
    raws = UnknownPayloads("1")
    for number in range(2 * MOST_KINDS):
        message = Message(number, f"M{number}", (Field("data", "bytes", (2,)),))
        one = np.zeros(1, np.int64)
        raws.batch(Batch(message, "", one, one, None, {"data": np.zeros((1, 2), np.uint8)}), np.full(1, np.nan))
    assert len(raws.report(0.0)) == MOST_KINDS
    assert raws.beyond == MOST_KINDS


def test_other_replies_are_left_alone() -> None:
    message = Message(1, "DeviceID", (Field("device_id", ">u4"),), kind="reply")
    assert not UnknownPayloads("1").reply(Reply(message, {"device_id": 3}, 0, 8, 0))


def test_a_page_is_told_while_there_is_any_and_once_after() -> None:
    class Told:
        def __init__(self) -> None:
            self.kinds: list[str] = []

        def say_latest(self, kind: str, text: str) -> None:
            self.kinds.append(kind)

    hub, payloads = played(IdtpDecoder(), vendor(1))
    told = Told()
    hub.outboxes.add(told)  # type: ignore[arg-type]
    for report in ([], payloads, payloads, [], []):
        hub.report_raws(report)
    assert told.kinds == ["raws"] * 3
