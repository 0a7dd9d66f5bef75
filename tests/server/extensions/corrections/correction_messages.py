"""RTCM messages as a caster sends them."""

import numpy as np

from imuscope.protocols.framing.checksums import crc24q


def message(number: int, epoch: int = 0, length: int = 40) -> bytes:
    """An RTCM 3 message: its number, station 0, an epoch, and filling."""
    body = _head(number, epoch)
    payload = body.ljust(length, b"\x5a")
    frame = b"\xd3" + len(payload).to_bytes(2, "big") + payload
    return frame + crc24q(np.frombuffer(frame, np.uint8), 0, len(frame)).to_bytes(3, "big")


def _head(number: int, epoch: int) -> bytes:
    """12 bits of number, 12 of station, 30 of epoch, and two more."""
    return (number << 44 | 7 << 32 | epoch << 2).to_bytes(7, "big")


STREAM = message(1005) + message(1077, 1000, 300) + message(1087, 5, 120) + message(1230, 0, 12)


NUMBERS = {"1005": 1, "1077": 1, "1087": 1, "1230": 1}
