"""Inertial Sense binary packets, protocol 2.x: delimiting, search in a stream and building.

    EF 49   FLAGS   ID   SIZE (2)   PAYLOAD (SIZE bytes)   A  B
    0  1    2       3    4          6

FLAGS: the low nibble is the packet's type, the high nibble flags. ID is the data set (DID) of a DATA, SET or STOP_DID
packet and 0 in all others. SIZE counts the payload, little-endian like everything here. A and B are the two sums of
Fletcher-16, modulo 256, over all bytes before them, preamble included.

    type  1 ACK  2 NACK  3 GET_DATA  4 DATA  5 SET_DATA  6 STOP_BROADCASTS_ALL_PORTS  7 STOP_DID_BROADCAST
          8 STOP_BROADCASTS_CURRENT_PORT
    flag  0x20  DATA and SET begin with an offset (u16) into the data set, and SIZE counts it:
                EF 49  24 04  0E 00   14 00   12 bytes of theta   A B
          0x10  "extended payload": defined by the vendor, unused; shown, otherwise ignored

A candidate is a packet only within these limits; otherwise it is rejected even if its checksum agrees, as soon as the
deciding bytes have arrived:

    bad_type   the type is not 1 to 8
    bad_size   the whole packet is longer than 2048 bytes, a DATA or SET carries more than 1024 bytes of data, reaches
               beyond 2048 (offset + SIZE; but for the calibration sets 42, 43 and 44), or is too short for its offset,
               or a GET asks for more than 1024

After any failure the search resumes one byte later: a decoder that skips a false length loses good packets.

Source: Inertial Sense binary protocol, "ISB Packet"; inertial-sense-sdk 2.7.1, ISComm.h; the limits are its parser's.
"""

import struct
from collections.abc import Mapping

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.framing.checksums import fletcher16
from imuscope.protocols.framing.stream_buffer import (
    BAD_CHECKSUM,
    BAD_SIZE,
    BAD_TYPE,
    BODY,
    FRAME,
    ID,
    LENGTH,
    OFFSET,
    SENDER,
    SIZE,
    STATUS,
    TRUNCATED,
)
from imuscope.protocols.native.kernels import BYTES, FLAG, FOUR, INT, TABLE, compiled, unsigned

FIRST, SECOND = 0xEF, 0x49
HEADER, TRAILER = 6, 2
MAX_PACKET = 2048
MAX_DATA = 1024
MAX_REACH = 2048

ACK, NACK, GET_DATA, DATA, SET_DATA, STOP_ALL_PORTS, STOP_DID, STOP_CURRENT_PORT = range(1, 9)
TYPES: Mapping[int, str] = {
    ACK: "ACK",
    NACK: "NACK",
    GET_DATA: "GET_DATA",
    DATA: "DATA",
    SET_DATA: "SET_DATA",
    STOP_ALL_PORTS: "STOP_BROADCASTS_ALL_PORTS",
    STOP_DID: "STOP_DID_BROADCAST",
    STOP_CURRENT_PORT: "STOP_BROADCASTS_CURRENT_PORT",
}
TYPE_MASK, EXTENDED, WITH_OFFSET = 0x0F, 0x10, 0x20

FLAGS = SENDER  # this protocol has no sender; the row of the scan's table holds the packet's flags byte


@compiled(INT, BYTES, INT)
def _u2(data: Bytes, at: int) -> int:
    return int(data[at]) | int(data[at + 1]) << 8


@compiled(INT, BYTES, INT, INT)
def _verdict(data: Bytes, at: int, left: int) -> int:
    """Reject reason for the candidate at `at`, from its header and the first bytes of its payload."""
    if left < 3:
        return FRAME
    kind = int(data[at + 2]) & TYPE_MASK
    if kind < ACK or kind > STOP_CURRENT_PORT:
        return BAD_TYPE
    if left < HEADER:
        return FRAME
    size = _u2(data, at + 4)
    if size + HEADER + TRAILER > MAX_PACKET:
        return BAD_SIZE
    if kind == GET_DATA:
        return BAD_SIZE if size >= 4 and left >= HEADER + 4 and _u2(data, at + 8) > MAX_DATA else FRAME
    if kind != DATA and kind != SET_DATA:
        return FRAME
    if int(data[at + 2]) & WITH_OFFSET == 0:
        return BAD_SIZE if size > MAX_DATA else FRAME
    if size < 2 or size - 2 > MAX_DATA:
        return BAD_SIZE
    if left >= HEADER + 2 and _u2(data, at + HEADER) + size > MAX_REACH:
        did = int(data[at + 3])
        if did != 42 and did != 43 and did != 44:
            return BAD_SIZE
    return FRAME


@compiled(FOUR, BYTES, INT, FLAG, TABLE)
def scan(data: Bytes, at: int, final: bool, table: Ints) -> tuple[int, int, int, int]:
    """Find candidates in `data[at:]`; see protocols/framing/stream_buffer.py for the table and the rule.

    BODY and LENGTH are those of the payload without its offset; FLAGS is the packet's flags byte.
    """
    end = len(data)
    n = 0
    failed = 0
    framed = 0
    while at < end and n < table.shape[1]:
        here = unsigned(at)
        if int(data[here]) != FIRST:
            at += 1
            continue
        left = end - at
        if left >= 2 and int(data[here + unsigned(1)]) != SECOND:
            at += 1
            continue
        status = FRAME
        size = 0
        if left >= HEADER:
            size = (int(data[here + unsigned(4)]) | int(data[here + unsigned(5)]) << 8) + HEADER + TRAILER
        if size == 0 or size > MAX_DATA or int(data[here + unsigned(2)]) != DATA:  # the usual case skips the full check
            status = _verdict(data, at, left)
        if status == FRAME:
            if size == 0 or size > left:
                if not final:
                    break
                if left < 2:  # the start of a preamble is not a candidate yet
                    at += 1
                    continue
                status = TRUNCATED
            else:
                sums = fletcher16(data, at, at + size - TRAILER)
                last = unsigned(at + size - 1)
                if sums & 0xFF != int(data[last - unsigned(1)]) or sums >> 8 != int(data[last]):
                    status = BAD_CHECKSUM
        if status in (BAD_TYPE, BAD_SIZE):
            size = 0  # the claimed size may not have arrived yet, and is meaningless
        flags = int(data[here + unsigned(2)]) if left >= 3 else 0
        skip = 0
        if flags & WITH_OFFSET and (flags & TYPE_MASK == DATA or flags & TYPE_MASK == SET_DATA):
            skip = 2
        column = unsigned(n)
        table[OFFSET, column] = at
        table[SIZE, column] = size
        table[BODY, column] = at + HEADER + skip
        table[LENGTH, column] = size - HEADER - TRAILER - skip
        table[ID, column] = int(data[here + unsigned(3)]) if left >= 4 else -1
        table[FLAGS, column] = flags
        table[STATUS, column] = status
        n += 1
        if status == FRAME:
            framed += size
            at += size
        else:
            failed += 1
            at += 1
    return n, at, failed, framed


def build(kind: int, did: int = 0, payload: bytes = b"", *, offset: int | None = None, flags: int = 0) -> bytes:
    """One packet.

    Args:
        kind: DATA, SET_DATA, …
        payload: without the offset.
        offset: position of `payload` in the data set; None and, as in the vendor's code, 0 send no offset. An explicit
            `flags=WITH_OFFSET` sends an offset of 0 too.
        flags: further bits of the high nibble.

    Raises:
        ValueError: numbers out of range, or a packet that no receiver would accept.
    """
    if kind not in TYPES or not 0 <= did <= 0xFF or flags & TYPE_MASK or not 0 <= flags <= 0xF0:
        raise ValueError(f"type is 1 to 8, data set 0 to 255, flags a high nibble; given {kind}, {did}, {flags:#x}")
    has_data = kind in (DATA, SET_DATA)
    if offset or (flags & WITH_OFFSET and has_data):  # in any other packet that flag is meaningless
        if not has_data or not 0 <= (offset or 0) <= 0xFFFF:
            raise ValueError(f"only DATA and SET_DATA have an offset, 0 to 65535; given {offset} with {TYPES[kind]}")
        flags |= WITH_OFFSET
        payload = struct.pack("<H", offset or 0) + payload
    if len(payload) > MAX_PACKET - HEADER - TRAILER:
        raise ValueError(f"a payload has at most {MAX_PACKET - HEADER - TRAILER} bytes, given {len(payload)}")
    packet = struct.pack("<BBBBH", FIRST, SECOND, kind | flags, did, len(payload)) + payload
    return packet + struct.pack("<H", fletcher16_of(packet))


def fletcher16_of(packet: bytes) -> int:
    """The checksum that follows `packet`."""
    low = high = 0
    for byte in packet:
        low = (low + byte) & 0xFF
        high = (high + low) & 0xFF
    return high << 8 | low


def get_data(did: int, *, size: int = 0, offset: int = 0, period: int = 1) -> bytes:
    """Request a data set, every `period` times its source period; 0 requests it once and stops it. Size 0: all of
    it.
    """
    return build(GET_DATA, 0, struct.pack("<HHHH", did, size, offset, period))


def set_data(did: int, data: bytes, offset: int = 0) -> bytes:
    """Write `data` into a data set from byte `offset` on."""
    return build(SET_DATA, did, data, offset=offset)


def stop(*, all_ports: bool = False) -> bytes:
    """Stop all broadcasts, on the port this is sent to or on all."""
    return build(STOP_ALL_PORTS if all_ports else STOP_CURRENT_PORT)
