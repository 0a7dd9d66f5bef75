"""Which protocols are there, and which of them are these bytes?

`PROTOCOLS` is the one list: a protocol is one more row. `guess` asks each row how much of some bytes it can account
for; the score is that share, between 0 and 1, and `why` says it in words for the page and the port scan:

    "14 frames of Xbus (MTData2) in 1 022 of 1 024 B"
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from protocols.events import Decoder
from protocols.idtp.decoder import IdtpDecoder
from protocols.idtp.frames import build as idtp_build
from protocols.idtp.likeness import likeness as idtp_likeness
from protocols.idtp.listing import IdtpListing
from protocols.isb.decoder import IsbDecoder
from protocols.isb.frames import DATA, stop
from protocols.isb.frames import build as isb_build
from protocols.isb.likeness import likeness as isb_likeness
from protocols.isb.listing import IsbListing
from protocols.xbus.decoder import XbusDecoder
from protocols.xbus.frames import build
from protocols.xbus.likeness import likeness as xbus_likeness
from protocols.xbus.listing import XbusListing


class Listing(Protocol):
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
        sample: a few valid bytes, with which `warm` runs everything once.
        settings: what decoder and listing can be told beside, by keyword: "key" (bytes), "min_mode" (0 to 2),
            "replay_check" (bool).
    """

    name: str
    title: str
    decoder: Callable[..., Decoder]
    likeness: Callable[[bytes], tuple[float, str]]
    listing: Callable[..., Listing]
    sample: bytes
    settings: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Guess:
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
            XbusListing,
            build(0x36, bytes.fromhex("1020020001")) + build(0x3E),
        ),
        ProtocolInfo(
            "isb",
            "Inertial Sense IMX, GPX (ISB 2.x)",
            IsbDecoder,
            isb_likeness,
            IsbListing,
            2 * isb_build(DATA, 58, bytes(36)) + stop(),
        ),
        ProtocolInfo(
            "idtp",
            "IDTP 2.1",
            IdtpDecoder,
            idtp_likeness,
            IdtpListing,
            idtp_build(4, bytes(36), sequence=1, mode=1) + idtp_build(6, bytes(16), sequence=3),
            frozenset(("key", "min_mode", "replay_check")),
        ),
    )
}


def guess(data: bytes) -> list[Guess]:
    """How much `data` look like each protocol, best first. A few hundred bytes are enough to be sure."""
    guesses = [Guess(row.name, *row.likeness(data)) for row in PROTOCOLS.values()]
    return sorted(guesses, key=lambda one: one.score, reverse=True)


def warm() -> Counter[str]:
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
