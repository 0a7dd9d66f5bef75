"""RTCM 3 messages: framing and identification.

    D3   000000 LL LLLLLLLL   PAYLOAD (L bytes)   CRC (3)          the payload begins with its number, 12 bits
    0    1         2          3

L has ten bits, so a message has at most 1029 bytes. The CRC is CRC-24Q over everything before it, most significant byte
first. Corrections from a base station pass through the ports of an Inertial Sense device; here they are found, checked
and named. D3 alone is one byte in 256, so a candidate that fails its check is common and not reported.

`RtcmFramer` splits a stream of nothing but corrections (a caster's); there, bytes that belong to no message are a loss,
and counted.

Source: RTCM 10403.3, section 4 (transport layer) and table 3.5-1 (messages).
"""

from collections.abc import Mapping

import numpy as np

from imuscope.protocols.embedded.ubx import WAIT, Wait
from imuscope.protocols.events import ParsedMessage
from imuscope.protocols.framing.checksums import crc24q

SYNC = b"\xd3"
HEADER, TRAILER = 3, 3

_SYSTEMS = {107: "GPS", 108: "GLONASS", 109: "Galileo", 110: "SBAS", 111: "QZSS", 112: "BeiDou", 113: "NavIC"}
NAMES: Mapping[int, str] = {
    1001: "GPS L1 observables",
    1002: "GPS L1 observables, extended",
    1003: "GPS L1/L2 observables",
    1004: "GPS L1/L2 observables, extended",
    1005: "Reference station position",
    1006: "Reference station position and antenna height",
    1007: "Antenna descriptor",
    1008: "Antenna descriptor and serial number",
    1009: "GLONASS L1 observables",
    1010: "GLONASS L1 observables, extended",
    1011: "GLONASS L1/L2 observables",
    1012: "GLONASS L1/L2 observables, extended",
    1013: "System parameters",
    1019: "GPS ephemeris",
    1020: "GLONASS ephemeris",
    1029: "Text",
    1033: "Receiver and antenna descriptors",
    1041: "NavIC ephemeris",
    1042: "BeiDou ephemeris",
    1044: "QZSS ephemeris",
    1045: "Galileo F/NAV ephemeris",
    1046: "Galileo I/NAV ephemeris",
    1230: "GLONASS code-phase biases",
    4072: "u-blox reference station PVT",
    **{10 * row + kind: f"{name} MSM{kind}" for row, name in _SYSTEMS.items() for kind in range(1, 8)},
}


def message_at(data: bytes, at: int, *, final: bool) -> ParsedMessage | Wait | None:
    """The message that begins at `at`, at SYNC; see ubx.message_at."""
    left = len(data) - at
    if left >= 2 and data[at + 1] & 0xFC:
        return None
    length = (data[at + 1] & 3) << 8 | data[at + 2] if left >= HEADER else 0
    size = HEADER + length + TRAILER
    if size > left:
        return None if final else WAIT
    frame = data[at : at + size]
    if crc24q(np.frombuffer(frame, np.uint8), 0, size - TRAILER) != int.from_bytes(frame[-TRAILER:], "big"):
        return None
    number = frame[3] << 4 | frame[4] >> 4 if length >= 2 else -1
    fields = {"number": number, "title": NAMES.get(number, ""), "length": length}
    return ParsedMessage(at, size, "rtcm3", str(number) if length >= 2 else "empty", frame.hex(), fields)


class RtcmFramer:
    """Whole messages from a stream of corrections in pieces of any size.

    Attributes:
        rejected: number of stretches of bytes that belong to no message: each is at least one message lost or damaged.
    """

    def __init__(self) -> None:
        self.rejected = 0
        self._rest = b""
        self._lost = False  # the last bytes belonged to no message

    def feed(self, data: bytes) -> list[ParsedMessage]:
        """The messages completed by these bytes, with their hex as `line`; offsets are meaningless here."""
        self._rest += data
        messages: list[ParsedMessage] = []
        at = 0
        while at < len(self._rest):
            one = message_at(self._rest, at, final=False) if self._rest[at] == SYNC[0] else None
            if one == WAIT:
                break
            if isinstance(one, ParsedMessage):
                messages.append(one)
                at += one.size
                self._lost = False
                continue
            self.rejected += not self._lost
            self._lost = True
            at += 1
        self._rest = self._rest[at:]
        return messages


def epoch_ms(number: int, frame: bytes) -> int | None:
    """Time of week of the observations in a message, ms; None for a message without, or with GLONASS's time of day."""
    timed = 1001 <= number <= 1004 or (1071 <= number <= 1137 and not 1081 <= number <= 1087 and 1 <= number % 10 <= 7)
    if not timed or len(frame) < HEADER + 7:
        return None
    return int.from_bytes(frame[HEADER + 3 : HEADER + 7], "big") >> 2
