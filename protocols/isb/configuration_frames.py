"""Effect of a packet or a sentence to an Inertial Sense device on its configuration, in plain Python: for the holder
of a shared port, which imports no numpy.

A device has no state for this: it is configured by each write of a data set that holds settings, by a request for a
data set at a period, and by the end of streams; in text by $STPB, $STPC, $PERS, $SRST, and by $ASCE with messages.
Other writes are input (velocities, corrections).

Source: Inertial Sense binary protocol, "ISB Packet"; inertial-sense-sdk 2.7.1, data_sets.h;
NMEA document of the same maker.
"""

from __future__ import annotations

from typing import Literal

GET_DATA, SET_DATA = 3, 5
STOPS = (6, 7, 8)
SYS_CMD, RMC = 7, 9
SETTINGS = frozenset((SYS_CMD, 8, RMC, 12, 19, 61, 64, 73, 81, 87, 90, 94, 121, 125, 126))
SENTENCES = frozenset((b"STPB", b"STPC", b"PERS", b"SRST"))
PERIOD = 6 + 6  # where the period of a request is: after the header, and data set, size and offset


def effect_of(packet: bytes) -> Literal["", "begin", "change", "end"]:
    """The effect of a whole packet or sentence (server/holder/client_frames.py, Effect)."""
    if packet[:1] == b"$":
        word, is_set = packet[1:5], packet[5:6] == b","
        return "change" if word in SENTENCES or (word == b"ASCE" and is_set) else ""
    kind = packet[2] & 0x0F
    if kind == SET_DATA:
        return "change" if packet[3] in SETTINGS else ""
    if kind == GET_DATA:
        return "change" if any(packet[PERIOD : PERIOD + 2]) else ""
    return "change" if kind in STOPS else ""
