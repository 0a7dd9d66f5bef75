"""u-blox UBX messages: framing and identification.

    B5 62   CLASS   ID   LENGTH (2)   PAYLOAD   CK_A CK_B
    0  1    2       3    4            6

LENGTH counts the payload, little-endian. CK_A and CK_B are two running sums modulo 256 over CLASS to the end of the
payload. A receiver's messages pass through the ports of an Inertial Sense device between its own packets; here they
are found, checked and named, so that they are counted and shown. Their content is not read.

A length beyond LONGEST is rejected: the search continues after the two sync characters.

Source: u-blox F9 HPG 1.32 Interface Description (UBX-22008968), 3.2 and 3.8; names of other generations from pyubx2.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

import numpy as np

from imuscope.protocols.checksums import fletcher16
from imuscope.protocols.nmea import ParsedMessage

Wait = Literal["wait"]
WAIT: Final = "wait"

SYNC = b"\xb5\x62"
LONGEST = 8192  # RXM-RAWX of 255 measurements has 8176 bytes

CLASSES: Mapping[int, str] = {
    0x01: "NAV",
    0x02: "RXM",
    0x04: "INF",
    0x05: "ACK",
    0x06: "CFG",
    0x09: "UPD",
    0x0A: "MON",
    0x0B: "AID",
    0x0D: "TIM",
    0x10: "ESF",
    0x13: "MGA",
    0x21: "LOG",
    0x27: "SEC",
    0x28: "HNR",
    0x29: "NAV2",
}

_NAMES = {
    "NAV": "01 POSECEF 02 POSLLH 03 STATUS 04 DOP 05 ATT 06 SOL 07 PVT 09 ODO 10 RESETODO 11 VELECEF 12 VELNED "
    "13 HPPOSECEF 14 HPPOSLLH 17 PVAT 20 TIMEGPS 21 TIMEUTC 22 CLOCK 23 TIMEGLO 24 TIMEBDS 25 TIMEGAL "
    "26 TIMELS 27 TIMEQZSS 28 NMI 30 SVINFO 31 DGPS 32 SBAS 34 ORB 35 SAT 36 COV 39 GEOFENCE 3B SVIN "
    "3C RELPOSNED 3D EELL 40 EKFSTATUS 42 SLAS 43 SIG 45 DAHEADING 60 AOPSTATUS 61 EOE 62 PL 63 TIMENAVIC "
    "64 TIMETRUSTED",
    "RXM": "10 RAW 11 SFRB 13 SFRBX 14 MEASX 15 RAWX 20 SVSI 30 ALM 31 EPH 32 RTCM 33 SPARTN 34 COR 36 SPARTN-KEY "
    "40 POSREQ 41 PMREQ 59 RLM 61 IMES 72 PMP 73 QZSSL6 74 TM 80 MEASD12 82 MEASC12 84 MEAS20 86 MEAS50",
    "INF": "00 ERROR 01 WARNING 02 NOTICE 03 TEST 04 DEBUG",
    "ACK": "00 NAK 01 ACK",
    "CFG": "00 PRT 01 MSG 02 INF 04 RST 06 DAT 07 TP 08 RATE 09 CFG 0E FXN 11 RXM 12 EKF 13 ANT 16 SBAS 17 NMEA "
    "1B USB 1D TMODE 1E ODO 22 NVS 23 NAVX5 24 NAV5 29 ESFGWT 31 TP5 32 PM 34 RINV 39 ITFM 3B PM2 "
    "3D TMODE2 3E GNSS 41 OTP 47 LOGFILTER 4C ESFA 4D ESFG 53 TXSLOT 56 ESFALG 57 PWR 5C HNR 60 ESRC "
    "61 DOSC 62 SMGR 64 SPT 69 GEOFENCE 70 DGNSS 71 TMODE3 82 ESFWT 84 FIXSEED 85 DYNSEED 86 PMS 88 SENIF "
    "8A VALSET 8B VALGET 8C VALDEL 8D SLAS 93 BATCH",
    "UPD": "14 SOS",
    "MON": "02 IO 04 VER 06 MSGPP 07 RXBUF 08 TXBUF 09 HW 0B HW2 21 RXR 27 PATCH 28 GNSS 2B PT2 2E SMGR 2F SPT "
    "31 SPAN 35 PMP 36 COMMS 37 HW3 38 RF 39 SYS",
    "TIM": "01 TP 03 TM2 04 SVIN 06 VRFY 11 DOSC 12 TOS 13 SMEAS 15 VCOCAL 16 FCHG 17 HOC",
    "ESF": "02 MEAS 03 RAW 04 CAL 10 STATUS 13 RESETALG 14 ALG 15 INS",
    "MGA": "00 GPS 02 GAL 03 BDS 05 QZSS 06 GLO 10 SF 20 ANO 21 FLASH 40 INI 60 ACK 80 DBD",
    "LOG": "03 ERASE 04 STRING 07 CREATE 08 INFO 09 RETRIEVE 0B RETRIEVEPOS 0D RETRIEVESTRING 0E FINDTIME "
    "0F RETRIEVEPOSEXTRA 10 RETRIEVEBATCH 11 BATCH",
    "SEC": "01 SIGN 03 UNIQID 09 SIG 0A OSNMA 10 SIGLOG",
    "HNR": "00 PVT 01 ATT 02 INS",
    "NAV2": "01 POSECEF 02 POSLLH 03 STATUS 04 DOP 07 PVT 09 ODO 11 VELECEF 12 VELNED 17 PVAT 20 TIMEGPS "
    "21 TIMEUTC 22 CLOCK 23 TIMEGLO 24 TIMEBDS 25 TIMEGAL 26 TIMELS 27 TIMEQZSS 32 SBAS 35 SAT 36 COV "
    "3B SVIN 3D EELL 42 SLAS 43 SIG 61 EOE 63 TIMENAVIC",
}
NAMES: Mapping[tuple[int, int], str] = {
    (number, int(word, 16)): f"{name}-{words[i + 1]}"
    for number, name in CLASSES.items()
    for words in [_NAMES.get(name, "").split()]
    for i, word in enumerate(words)
    if i % 2 == 0
}


def name_of(group: int, number: int) -> str:
    """Name of a message: "NAV-PVT", or by number if the table lacks it."""
    known = NAMES.get((group, number))
    return known or f"{CLASSES.get(group, f'0x{group:02X}')}-0x{number:02X}"


def message_at(data: bytes, at: int, *, final: bool) -> ParsedMessage | Wait | None:
    """The message that begins at `at`, at SYNC's first byte.

    Args:
        final: no data follows; incomplete messages will never be completed.

    Returns:
        the message, with an empty name if its checksum failed; WAIT while it may still become one.
    """
    head = data[at : at + 6]
    if not head.startswith(SYNC) and head != SYNC[:1]:
        return None
    length = int.from_bytes(head[4:6], "little") if len(head) == 6 else 0
    size = length + 8
    if length > LONGEST:
        return None
    if at + size > len(data):
        return None if final else WAIT
    frame = data[at : at + size]
    if fletcher16(np.frombuffer(frame, np.uint8), 2, size - 2) == int.from_bytes(frame[-2:], "little"):
        fields = {"class": frame[2], "id": frame[3], "length": length}
        return ParsedMessage(at, size, "ubx", name_of(frame[2], frame[3]), frame.hex(), fields)
    return ParsedMessage(at, len(SYNC), "ubx", "", "") if frame[2] in CLASSES else None
