"""A short stretch of another protocol in a stream is detected; chance matches are not."""

import functools
import random

from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.registry.mixed_protocols import MIN_FRAMES, MixedProtocolDetector
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from tests.support.each_row import each_row

S = 1_000_000_000


@functools.cache
def spoken(protocol: str, seconds: float, seed: int = 0) -> bytes:
    make = {"xbus": XbusSimulator, "isb": IsbSimulator, "idtp": IdtpSimulator}[protocol]
    return make(seed=seed).advance(int(seconds * S))  # type: ignore[operator, no-any-return]


def examine(own: str, data: bytes, size: int) -> MixedProtocolDetector:
    mixture = MixedProtocolDetector(own)
    for at in range(0, len(data), size):
        mixture.feed(data[at : at + size])
    mixture.feed(b"", final=True)
    return mixture


@each_row("size", [1, 997, 1 << 20])
@each_row("own", PROTOCOLS)
@each_row("other", PROTOCOLS)
def test_a_short_stretch_in_the_middle_is_seen(own: str, other: str, size: int) -> None:
    """Only the beginning and the end of a file were looked at, and of a fast replay what had just come by."""
    if own == other:
        return
    seconds = 0.05 if size == 1 else 8  # byte by byte takes a thousand times as long
    stretch = spoken(other, 2)[-1500:]
    data = spoken(own, seconds) + stretch + spoken(own, seconds, seed=1)
    mixture = examine(own, data, size)
    assert mixture.others == [other]
    alone = examine(own, stretch, size)
    assert mixture.count == alone.count, "the cut of the chunks changes nothing, and neither does what is around"


@each_row("own", PROTOCOLS)
def test_bytes_inside_a_frame_belong_to_it(own: str) -> None:
    """An Xbus frame inside the payload of an Inertial Sense packet is not a message of an MTi."""
    assert examine(own, spoken(own, 30), 1 << 16).others == []
    xbus, isb = PROTOCOLS["xbus"].frames.sample, PROTOCOLS["isb"].frames.sample
    from imuscope.protocols.idtp.frames import build as idtp
    from imuscope.protocols.isb.frames import DATA
    from imuscope.protocols.isb.frames import build as packet
    from imuscope.protocols.xbus.frames import build as frame

    hidden = {
        "xbus": b"".join(frame(0x90, isb) for _ in range(10)),
        "isb": b"".join(packet(DATA, 200, xbus) for _ in range(10)),
        "idtp": b"".join(idtp(4, (xbus + bytes(36))[:36], sequence=n, mode=1) for n in range(10)),
    }
    assert examine(own, hidden[own], 50).count == {}


def test_noise_is_not_a_protocol() -> None:
    noise = random.Random(1).randbytes(1 << 22)
    for own in PROTOCOLS:
        assert sum(examine(own, noise, 1 << 16).count.values()) < MIN_FRAMES
