"""Packets and sentences of Inertial Sense as the holder of a shared port needs them, which imports no numpy: in plain
Python, their size from the header or the end, and their effect on the configuration.

A device has no state for this: it is configured by each write of a data set that holds settings, by a request for a
data set at a period, and by the end of streams; in text by $STPB, $STPC, $PERS, $SRST, and by $ASCE with messages.
Other writes are input (velocities, corrections).

Source: Inertial Sense binary protocol, "ISB Packet"; inertial-sense-sdk 2.7.1, data_sets.h; NMEA 0183, and the NMEA
document of the same maker.
"""

from __future__ import annotations

TYPE_CHECKING = False  # a holder has no room for typing
if TYPE_CHECKING:
    from typing import Literal

PREAMBLE = b"\xef\x49"
HEADER, TRAILER = 6, 2
MAX_PACKET = 2048
TYPES = range(1, 9)
MAX_SENTENCE = 512  # $ASCE with 20 messages has 170 characters


def frame_size(data: bytes, at: int) -> int:
    """Size of the packet or sentence that begins at `at`; 0: too few bytes; −1: none begins there."""
    if data[at : at + 1] == b"$":
        return _sentence_size(data, at)
    head = data[at : at + 2]
    if head != PREAMBLE[: len(head)]:
        return -1
    if len(data) - at < HEADER:
        return 0
    size = (data[at + 4] | data[at + 5] << 8) + HEADER + TRAILER
    return size if data[at + 2] & 0x0F in TYPES and size <= MAX_PACKET else -1


def _sentence_size(data: bytes, at: int) -> int:
    sentence = data[at : at + MAX_SENTENCE]
    end = sentence.find(b"\n") + 1
    text = sentence[:end].rstrip(b"\r\n") if end else sentence.rstrip(b"\r")
    if not text.isascii() or not text.decode("ascii").isprintable():
        return -1
    return end or (0 if len(sentence) < MAX_SENTENCE else -1)


GET_DATA, SET_DATA = 3, 5
STOPS = (6, 7, 8)
SYS_CMD, RMC = 7, 9
SETTINGS = frozenset((SYS_CMD, 8, RMC, 12, 19, 61, 64, 73, 81, 87, 90, 94, 121, 125, 126))
SENTENCES = frozenset((b"STPB", b"STPC", b"PERS", b"SRST"))
PERIOD = 6 + 6  # where the period of a request is: after the header, and data set, size and offset


def effect_of(packet: bytes) -> Literal["", "begin", "change", "end"]:
    """The effect of a whole packet or sentence (server/extensions/shares/holder/client_frames.py, Effect)."""
    if packet[:1] == b"$":
        word, is_set = packet[1:5], packet[5:6] == b","
        return "change" if word in SENTENCES or (word == b"ASCE" and is_set) else ""
    kind = packet[2] & 0x0F
    if kind == SET_DATA:
        return "change" if packet[3] in SETTINGS else ""
    if kind == GET_DATA:
        return "change" if any(packet[PERIOD : PERIOD + 2]) else ""
    return "change" if kind in STOPS else ""
