"""MIP packets: format, search in a stream, and construction.

    75 65   SET   LENGTH   field, field, …   SUM (2)
    0 1     2     3        4                 4 + LENGTH

    field:  SIZE  DESCRIPTOR  data (SIZE − 2 bytes)

LENGTH counts the bytes of all fields. SUM is Fletcher's, modulo 256, over everything before it. Numbers are big-endian.

Source: the vendor's public MIP SDK, src/c/mip/mip_packet.c and mip_field.c (../README.md).
"""

from collections.abc import Iterable, Iterator
from itertools import accumulate

from imuscope.plugin import BAD_CHECKSUM, BAD_SIZE, FRAME, TRUNCATED, Bytes, Ints

SYNC = b"\x75\x65"
HEADER, SUM = 4, 2
MAX_PACKET = HEADER + 255 + SUM
Part = tuple[int, bytes]
"""Descriptor and data of one field."""


def checksum(data: bytes) -> bytes:
    """Fletcher's sums of everything before them."""
    return bytes((sum(data) & 0xFF, sum(accumulate(data)) & 0xFF))


def build(number: int, parts: Iterable[Part]) -> bytes:
    """A packet of a descriptor set. ValueError: its fields are too long."""
    body = b"".join(bytes((len(data) + 2, descriptor)) + data for descriptor, data in parts)
    if len(body) > 255:
        raise ValueError(f"a packet holds 255 bytes of fields, given {len(body)}")
    frame = SYNC + bytes((number, len(body))) + body
    return frame + checksum(frame)


def parts_of(packet: bytes) -> Iterator[Part]:
    """The fields of a whole packet."""
    at, end = HEADER, HEADER + packet[3]
    while at < end:
        yield packet[at + 1], packet[at + 2 : at + packet[at]]
        at += packet[at]


def _status(packet: bytes) -> int:
    if packet[-SUM:] != checksum(packet[:-SUM]):
        return BAD_CHECKSUM
    at, end = HEADER, len(packet) - SUM
    while at < end:
        if packet[at] < 2 or at + packet[at] > end:
            return BAD_SIZE
        at += packet[at]
    return FRAME


def scan(data: Bytes, at: int, final: bool, table: Ints) -> tuple[int, int, int, int]:
    """See protocols/framing/stream_buffer.py."""
    raw = data.tobytes()
    done = failed = framed = 0
    while done < table.shape[1]:
        result = raw.find(SYNC, at)
        if result < 0:
            at = len(raw) - (not final and raw.endswith(SYNC[:1]) and at < len(raw))
            break
        at, left = result, len(raw) - result
        size = HEADER + raw[at + 3] + SUM if left >= HEADER else MAX_PACKET
        if size > left:
            if not final:
                break
            status, size = TRUNCATED, size if left >= HEADER else 0
        elif size == HEADER + SUM:
            status = BAD_SIZE
        else:
            status = _status(raw[at : at + size])
        number = raw[at + 2] if left > 2 else 0
        table[:, done] = (at, size, at + HEADER, max(size - HEADER - SUM, 0), number, 0, status)
        done += 1
        if status == FRAME:
            framed += size
            at += size
        else:
            failed += 1
            at += len(SYNC)
    return done, at, failed, framed
