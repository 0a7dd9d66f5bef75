"""One packet as JSON values and back, byte for byte.

    {"id": 128, "message": "ScaledAccelerometer+GpsTimestamp", "fields": {"Acceleration": [0.0, 0.0, -1.0], "tow": …}}

`message` names the fields of the packet in their order. A field that is not known is called by its numbers, its data
are hex.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from imuscope.plugin import EncodeError, Field, pack, unpack
from imuscope_mip.messages import ACK, BY_NAME, Row, row_of, row_of_bytes
from imuscope_mip.packets import build, parts_of

_NUMBERS = re.compile(r"0x([0-9A-Fa-f]{2})([0-9A-Fa-f]{2})\Z")


def rows_of(packet: bytes) -> list[Row]:
    """Type of each field of a packet. A field with a name that occurs before it is decoded as bytes, so that no data
    are lost.
    """
    rows: list[Row] = []
    visited: set[str] = set()
    unknown: Counter[int] = Counter()
    for number, data in parts_of(packet):
        row = row_of(packet[2], number, len(data), data[0] if data else -1)
        if _NUMBERS.match(row.name) or not visited.isdisjoint(field.name for field in row.fields):
            unknown[number] += 1
            row = row_of_bytes(packet[2], number, len(data), unknown[number])
        visited.update(field.name for field in row.fields)
        rows.append(row)
    return rows


def name_of(rows: Sequence[Row]) -> str:
    """Name of a packet with these fields."""
    return "+".join(row.name for row in rows)


def frame_to_json(packet: bytes) -> dict[str, Any]:
    """The values of one valid packet."""
    rows, fields = rows_of(packet), {}
    for row, (_, data) in zip(rows, parts_of(packet), strict=True):
        fields.update(unpack(row.fields, data, len(row.prefix), exact=True))
    return {"id": packet[2], "message": name_of(rows), "fields": plain(fields)}


def plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Bytes as hex."""
    return {name: value.hex() if isinstance(value, bytes) else value for name, value in values.items()}


def named_rows(name: str, number: int | None, values: Mapping[str, Any]) -> list[Row]:
    """The fields of a packet that is called so.

    Raises:
        EncodeError: one of them is not known.
    """
    rows: list[Row] = []
    unknown: Counter[int] = Counter()
    for part in name.split("+"):
        numbers = _NUMBERS.match(part)
        if part == "Ack":
            rows.append(row_of(number if number is not None else 1, ACK, 2, -1))
        elif part in BY_NAME:
            rows.append(BY_NAME[part])
        elif numbers:
            descriptor = int(numbers[2], 16)
            unknown[descriptor] += 1
            name = row_of_bytes(0, descriptor, 1, unknown[descriptor]).fields[0].name
            data = values.get(name, "")
            size = len(data) // 2 if isinstance(data, str) else 0
            rows.append(row_of_bytes(int(numbers[1], 16), descriptor, size, unknown[descriptor]))
        else:
            raise EncodeError(f"no message is called {part!r}; there are: {', '.join(BY_NAME)}")
    return rows


def frame_from_json(record: Mapping[str, Any]) -> bytes:
    """The packet of what `frame_to_json` gave.

    Raises:
        EncodeError: a name or value that the tables do not allow.
    """
    values = dict(record.get("fields", {}))
    rows = named_rows(str(record.get("message", "")), record.get("id"), values)
    known = {field.name for row in rows for field in row.fields}
    if unknown := [name for name in values if name not in known]:
        raise EncodeError(f"no field is called {unknown[0]!r}; there are: {', '.join(known) or 'none'}")
    sets = {row.set for row in rows if row.descriptor != ACK} or {rows[0].set}
    if len(sets) > 1:
        raise EncodeError("the fields of a packet are of one descriptor set")
    parts = []
    for row in rows:
        own = {field.name: _wire(field, values[field.name]) for field in row.fields if field.name in values}
        parts.append((row.descriptor, row.prefix + pack(row.fields, own)))
    try:
        return build(sets.pop(), parts)
    except ValueError as error:
        raise EncodeError(str(error)) from None


def _wire(field: Field, value: Any) -> Any:
    """Hex as bytes."""
    if field.dtype != "bytes":
        return value
    try:
        return bytes.fromhex(value)
    except (TypeError, ValueError):
        raise EncodeError(f"{field.name} is hex, given {value!r}") from None
