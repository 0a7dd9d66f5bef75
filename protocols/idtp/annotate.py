"""Annotation of a frame byte by byte, shown while it is composed.

    49 44 54 50 | 28 46 0F 00 | 01 00 00 00 | 66 00 | 0C 00 | 21 | 00 | 00 | E7 | 00 00 00 3F | …  | trailer
    preamble      timestamp     sequence      device  size    ver  mode type CRC   acc_x

Source: IDTP v2.1.0, section 4.1.
"""

from __future__ import annotations

from collections.abc import Iterator

from imuscope.protocols.commands.transactions import ByteRange
from imuscope.protocols.idtp.commands import reading_fields
from imuscope.protocols.idtp.custom_payloads import Schema
from imuscope.protocols.idtp.frames import HEADER, HEADER_SIZE, MODES, PREAMBLE, TRAILERS, TYPE_AT
from imuscope.protocols.idtp.payloads import row_of
from imuscope.protocols.schema.layouts import size_of, unpack

_WORDS = ((4, 4, "timestamp"), (8, 4, "sequence"), (12, 2, "device_id"), (14, 2, "payload_size"))
_TRAILER = ("", "CRC-32", "HMAC-SHA256")


def name_of(frame: bytes, schema: Schema) -> str:
    """The payload type's name, or its number; "" for other bytes."""
    if len(frame) < HEADER_SIZE or frame[:4] != PREAMBLE:
        return ""
    row = row_of(frame[TYPE_AT], frame[16] & 0xF == 0, schema)
    return row.name if row else f"0x{frame[TYPE_AT]:02X}"


def annotate(frame: bytes, schema: Schema) -> list[ByteRange]:
    """See imuscope.protocols.commands.transactions.DeviceDriver.annotate."""
    if not name_of(frame, schema):
        return [ByteRange(0, len(frame), "unknown")] if frame else []
    return list(_frame(frame, schema))


def _frame(frame: bytes, schema: Schema) -> Iterator[ByteRange]:
    _, _, _, _, size, version, mode, kind = HEADER.unpack_from(frame)
    yield ByteRange(0, 4, "preamble IDTP")
    for at, length, name in _WORDS:
        value = int.from_bytes(frame[at : at + length], "little")
        yield ByteRange(at, length, f"{name} = {value}", "" if name == "payload_size" else name)
    yield ByteRange(16, 1, f"version {version >> 4}.{version & 0xF}", "version")
    yield ByteRange(17, 1, f"mode {MODES[mode]}" if mode < len(MODES) else f"mode {mode}", "mode")
    yield ByteRange(18, 1, f"type {name_of(frame, schema)}", "type")
    yield ByteRange(19, 1, "CRC-8 of the header")
    end = min(HEADER_SIZE + size, len(frame))
    yield from _payload(frame[HEADER_SIZE:end], kind, version, schema)
    if end < len(frame):
        trailer = mode < len(MODES) and len(frame) - end == TRAILERS[mode]
        yield ByteRange(end, len(frame) - end, _TRAILER[mode] if trailer else "trailer")


def _payload(payload: bytes, kind: int, version: int, schema: Schema) -> Iterator[ByteRange]:
    row = row_of(kind, version & 0xF == 0, schema)
    fields = reading_fields(row) if row else ()
    at = 0
    if sum(size_of(field) for field in fields) <= len(payload):
        for field in fields:
            value = unpack((field,), payload, at)[field.name]
            words = ", ".join(f"{one:.6g}" for one in (value if isinstance(value, list) else [value]))
            unit = f" {field.unit}" if field.unit and field.scale == 1 and field.bias == 0 else ""
            yield ByteRange(HEADER_SIZE + at, size_of(field), f"{field.name} = {words}{unit}", field.name)
            at += size_of(field)
    if at < len(payload):
        yield ByteRange(
            HEADER_SIZE + at, len(payload) - at, "payload" if not at else "trailing bytes", "" if at else "data"
        )
