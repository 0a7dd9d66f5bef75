"""Which protocols are there, and which of them are these bytes?

`PROTOCOLS` is the one list: a protocol is one more row. `detect` asks each row how much of some bytes it can account
for; the score is that share, between 0 and 1, and `why` says it in words for the page and the port scan:

    "14 frames of Xbus (MTData2) in 1 022 of 1 024 B"
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from protocols.events import Batch, Decoder, Reply
from protocols.framing import Ints
from protocols.idtp.decoder import IdtpDecoder
from protocols.idtp.detect import detection_score as idtp_likeness
from protocols.idtp.driver import IdtpDriver
from protocols.idtp.frames import build as idtp_build
from protocols.idtp.inspect import IdtpFrameLister
from protocols.idtp.security import protection as idtp_protection
from protocols.isb.dates import utc_of as isb_utc
from protocols.isb.decoder import IsbDecoder
from protocols.isb.detect import detection_score as isb_likeness
from protocols.isb.device_info import identity as isb_identity
from protocols.isb.driver import IsbDriver
from protocols.isb.frames import DATA, get_data, stop
from protocols.isb.frames import build as isb_build
from protocols.isb.inspect import IsbFrameLister
from protocols.transactions import DeviceDriver
from protocols.xbus.dates import date_of as xbus_dated
from protocols.xbus.dates import utc_of as xbus_utc
from protocols.xbus.decoder import XbusDecoder
from protocols.xbus.detect import detection_score as xbus_likeness
from protocols.xbus.device_info import identity as xbus_identity
from protocols.xbus.driver import XbusDriver
from protocols.xbus.frames import build
from protocols.xbus.inspect import XbusFrameLister
from protocols.xbus.products import absent as xbus_absent


class FrameLister(Protocol):
    """Chunks in, lines of plain values out: offset and size, then protocol, id, message and fields, or reject."""

    def feed(self, data: bytes) -> None: ...

    def drain(self, *, stalled: bool = False) -> list[dict[str, Any]]: ...


@dataclass(frozen=True, slots=True)
class ProtocolInfo:
    """One protocol.

    Args:
        name: as on the command line ("xbus").
        title: for a person.
        decoder: makes a decoder; takes `direction` (schema.Direction), the side that is listened to.
        likeness: (score 0..1, words) of some bytes.
        listing: makes what turns a file into lines of plain values, for `imuscope inspect`.
        sample: a few valid bytes, with which `warm_up` runs everything once.
        settings: what decoder and listing can be told beside, by keyword: "key" (bytes), "min_mode" (0 to 2),
            "replay_check", "show_unverified" (bool), "schema" (idtp/custom_payloads.py), "time_unit",
            "rotation" (idtp/decoder.py).
        datagrams: whether the decoder can be told, by that keyword, that every chunk is a datagram.
        identity: what an answer tells of the device: "product", "serial_number", "firmware", those that it tells.
        greeting: what may be sent to any device of the protocol, whatever it does, to learn who it is; b"" for nothing.
        protection: what protects the frames of a batch, in words; None where a protocol has one answer for all.
        sender: what to call who sends (Batch.device) where a stream names its senders.
        driver: how its devices are configured; None where they are not.
        utc: UTC of each sample of a batch as far as the device says it, ns since the Unix epoch (UNKNOWN of dates.py
            where it does not); None where it does not at all.
        dated: when a log began, by what stands at its head.
        absent: flags of its status words, by name, which a product does not have.
    """

    name: str
    title: str
    decoder: Callable[..., Decoder]
    likeness: Callable[[bytes], tuple[float, str]]
    listing: Callable[..., FrameLister]
    sample: bytes
    settings: frozenset[str] = frozenset()
    datagrams: bool = False
    identity: Callable[[Reply], Mapping[str, str]] = lambda reply: {}
    greeting: bytes = b""
    protection: Callable[[Batch], str] | None = None
    sender: str = ""
    driver: DeviceDriver | None = None
    utc: Callable[[Batch], Ints | None] = lambda batch: None
    dated: Callable[[Reply], int | None] = lambda reply: None
    absent: Callable[[str], tuple[str, ...]] = lambda product: ()


@dataclass(frozen=True, slots=True)
class Detection:
    """How much some bytes look like a protocol."""

    protocol: str
    score: float
    why: str


PROTOCOLS: dict[str, ProtocolInfo] = {
    row.name: row
    for row in (
        ProtocolInfo(
            "xbus",
            "Xsens MTi (Xbus)",
            XbusDecoder,
            xbus_likeness,
            XbusFrameLister,
            build(0x36, bytes.fromhex("1020020001")) + build(0x3E),
            identity=xbus_identity,
            driver=XbusDriver(),
            utc=xbus_utc,
            dated=xbus_dated,
            absent=xbus_absent,
        ),
        ProtocolInfo(
            "isb",
            "Inertial Sense IMX, GPX (ISB 2.x)",
            IsbDecoder,
            isb_likeness,
            IsbFrameLister,
            2 * isb_build(DATA, 58, bytes(36)) + stop(),
            identity=isb_identity,
            greeting=get_data(1, period=0),  # device information, once; streams go on as they are
            driver=IsbDriver(),
            utc=isb_utc,
        ),
        ProtocolInfo(
            "idtp",
            "IDTP 2.1",
            IdtpDecoder,
            idtp_likeness,
            IdtpFrameLister,
            idtp_build(4, bytes(36), sequence=1, mode=1) + idtp_build(6, bytes(16), sequence=3),
            frozenset(("key", "min_mode", "replay_check", "show_unverified", "schema", "time_unit", "rotation")),
            datagrams=True,
            protection=idtp_protection,
            sender="IDTP device",
            driver=IdtpDriver(),
        ),
    )
}


def detect(data: bytes) -> list[Detection]:
    """How much `data` look like each protocol, best first. A few hundred bytes are enough to be sure."""
    guesses = [Detection(row.name, *row.likeness(data)) for row in PROTOCOLS.values()]
    return sorted(guesses, key=lambda one: one.score, reverse=True)


def permissive_decoder(protocol: str) -> Decoder:
    """A decoder that takes frames as they are: for looking at bytes, not for trusting them."""
    row = PROTOCOLS[protocol]
    wanted = {"show_unverified": True, "replay_check": False}
    return row.decoder(**{name: value for name, value in wanted.items() if name in row.settings})


def count_messages(data: bytes) -> Counter[str]:
    """How many messages of each protocol are in some bytes: two protocols in one stream are a mistake worth telling.

    Messages that pass through any port (NMEA, u-blox, RTCM 3) are nobody's own and not counted.
    """
    count: Counter[str] = Counter()
    for name in PROTOCOLS:
        decoder = permissive_decoder(name)
        decoder.feed(data, 0)
        for event in decoder.drain(stalled=True):
            if isinstance(event, Batch):
                count[name] += len(event)
            elif isinstance(event, Reply) and event.message.id >= 0:  # a decoder's own remark is no message
                count[name] += 1
    return count


def warm_up() -> Counter[str]:
    """Run every decoder once on a tiny input, so that everything is compiled before the first device speaks.

    Returns:
        How many events each protocol gave: none would mean that nothing was warmed.
    """
    events: Counter[str] = Counter()
    for row in PROTOCOLS.values():
        decoder = row.decoder()
        decoder.feed(row.sample, 0)
        events[row.name] = len(decoder.drain(stalled=True))
    return events
