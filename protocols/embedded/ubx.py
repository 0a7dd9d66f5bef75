"""u-blox UBX messages: framing and identification.

    B5 62   CLASS   ID   LENGTH (2)   PAYLOAD   CK_A CK_B
    0  1    2       3    4            6

LENGTH counts the payload, little-endian. CK_A and CK_B are two running sums modulo 256 over CLASS to the end of the
payload. A receiver's messages pass through the ports of an Inertial Sense device between its own packets; here they
are found, checked and named, so that they are counted and shown. Their content is not read.

A length beyond MAX_PAYLOAD_BYTES is rejected: the search continues after the two sync characters.

Source: u-blox F9 HPG 1.32 Interface Description (UBX-22008968), 3.2 and 3.8; names of other generations from pyubx2.
"""

from collections.abc import Mapping
from typing import Final, Literal

import numpy as np

from imuscope.protocols.embedded.ubx_content import table, values_of
from imuscope.protocols.events import ParsedMessage
from imuscope.protocols.framing.checksums import fletcher16

Wait = Literal["wait"]
WAIT: Final = "wait"

SYNC = b"\xb5\x62"
MAX_PAYLOAD_BYTES = 8192  # RXM-RAWX of 255 measurements has 8176 bytes

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

NAMES: Mapping[tuple[int, int], str] = {
    (number, int(word, 16)): f"{name}-{words[i + 1]}"
    for number, name in CLASSES.items()
    for words in [table().get(name, [])]
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
    if length > MAX_PAYLOAD_BYTES:
        return None
    if at + size > len(data):
        return None if final else WAIT
    frame = data[at : at + size]
    if fletcher16(np.frombuffer(frame, np.uint8), 2, size - 2) == int.from_bytes(frame[-2:], "little"):
        name = name_of(frame[2], frame[3])
        fields = values_of(name, frame[6:-2]) or {"class": frame[2], "id": frame[3], "length": length}
        return ParsedMessage(at, size, "ubx", name, frame.hex(), fields)
    return ParsedMessage(at, len(SYNC), "ubx", "", "") if frame[2] in CLASSES else None
