"""JSON form of a frame, and its inverse, byte for byte.

    {"id": 4, "message": "Imu9",
     "fields": {"timestamp": 2000000, "sequence": 100, "device_id": 102, "version": 33, "mode": 1,
                "acc_x": 0.5, "acc_y": -1.25, …, "mag_z": 41.125},
     "wire": {"trailing": "00000000"}}

`fields` are the header's values, by the document's names, then the readings, unscaled, by theirs; for types described
by the user, by the names of the description. A payload without a description, or too short for its type, is `data`, as
hex. A float that is not finite is {"f32": hex} or {"f64": hex}.

`wire` has the remaining bytes: `trailing`, hex of payload bytes after the last field. Preamble, payload size
and checksums follow from the rest; an HMAC is made again with the key.

Source: IDTP v2.1.0, sections 4.1 and 4.5.
"""

from collections.abc import Mapping
from typing import Any

from imuscope.protocols.idtp.custom_payloads import Schema
from imuscope.protocols.idtp.frames import HEADER, HEADER_SIZE, LITE, MAJOR, SECURE, VERSION, build
from imuscope.protocols.idtp.messages import BY_NAME, SECTION, WIRE
from imuscope.protocols.idtp.payloads import row_of
from imuscope.protocols.schema.fields import Field, Message
from imuscope.protocols.schema.layouts import EncodeError, bytes_of_hex, pack, size_of, unpack

Plain = dict[str, Any]

HEADER_LIMITS: Mapping[str, tuple[int, int, int]] = {  # name → least and greatest value, default
    "timestamp": (0, 0xFFFFFFFF, 0),
    "sequence": (0, 0xFFFFFFFF, 0),
    "device_id": (0, 0xFFFF, 0),
    "version": (MAJOR << 4, MAJOR << 4 | 0xF, VERSION),
    "mode": (LITE, SECURE, LITE),
}


def frame_to_json(frame: bytes, schema: Schema | None = None) -> Plain:
    """The values of one valid frame: keys id, message, fields, and wire if needed."""
    _, timestamp, sequence, device, size, version, mode, kind = HEADER.unpack_from(frame)
    head = (timestamp, sequence, device, version, mode)
    payload = frame[HEADER_SIZE : HEADER_SIZE + size]
    row = row_of(kind, version & 0xF == 0, schema or {})
    fields: Plain = dict(zip(HEADER_LIMITS, head, strict=True))
    record: Plain = {"id": kind, "message": row.name if row else f"0x{kind:02X}", "fields": fields}
    described = _size(row)
    if row is None or size < described:
        if payload or row:
            fields["data"] = payload.hex()
        return record
    for field in row.fields:
        fields.update(_named(field, unpack((field,), payload, _place(row, field), exact=True)[field.name]))
    if size > described:
        record["wire"] = {"trailing": payload[described:].hex()}
    return record


def _size(row: Message | None) -> int:
    return sum(size_of(field) for field in row.fields) if row else 0


def _place(row: Message, field: Field) -> int:
    return sum(size_of(other) for other in row.fields[: row.fields.index(field)])


def _names(field: Field) -> tuple[str, ...]:
    """The document's names of a field's elements; for a field described by the user, its own."""
    standard = field.source == SECTION
    return WIRE[field.name] if standard else (field.name,)


def _named(field: Field, value: Any) -> Plain:
    names = _names(field)
    return dict(zip(names, value if len(names) > 1 else [value], strict=True))


# -- values → frame ----------------------------------------------------------------------------------------------------


def frame_from_json(record: Mapping[str, Any], key: bytes | None = None, schema: Schema | None = None) -> bytes:
    """The frame of a `frame_to_json` result; keys other than message, id, fields and wire are ignored.

    Args:
        key: for a Secure frame.

    Raises:
        EncodeError: a name or value that the tables do not allow, or no key.
    """
    fields, wire = record.get("fields", {}), record.get("wire", {})
    if not isinstance(fields, Mapping) or not isinstance(wire, Mapping):
        raise EncodeError("fields and wire are objects")
    head = {name: _whole(name, fields) for name in HEADER_LIMITS}
    values = {name: value for name, value in fields.items() if name not in HEADER_LIMITS}
    name = str(record.get("message", ""))
    kind = _number(name, record.get("id"), schema or {})
    row = row_of(kind, head["version"] & 0xF == 0, schema or {})
    payload = bytes_of_hex("data", values["data"]) if _is_raw(row, values) else _packed(name, row, values)
    payload += bytes_of_hex("trailing", wire.get("trailing", ""))
    if head["mode"] == SECURE and key is None:
        raise EncodeError("Secure frames need a key: start with --key")
    device = head.pop("device_id")
    try:
        return build(kind, payload, device=device, key=key, **head)
    except ValueError as problem:
        raise EncodeError(str(problem)) from None


def _is_raw(row: Message | None, values: Mapping[str, Any]) -> bool:
    return values.keys() == {"data"} and (row is None or "data" not in {field.name for field in row.fields})


def _packed(name: str, row: Message | None, values: Mapping[str, Any]) -> bytes:
    if row is None:
        if values:
            raise EncodeError(f"{name} has no field but data, given {', '.join(values)}")
        return b""
    left = dict(values)
    grouped: Plain = {}
    for field in row.fields:
        names = _names(field)
        for one in names:
            if one not in left:
                raise EncodeError(f"{one} is missing")
        numbers = [left.pop(one) for one in names]
        grouped[field.name] = numbers if len(names) > 1 else numbers[0]
    if left:
        known = [*HEADER_LIMITS, *(one for field in row.fields for one in _names(field))]
        raise EncodeError(f"no field is called {next(iter(left))!r}; there are: {', '.join(known)}")
    return pack(row.fields, grouped)


def _number(name: str, value: Any, schema: Schema) -> int:
    if name in BY_NAME:
        return BY_NAME[name].id
    described = {row.name: row.id for row in schema.values()}
    if name in described:
        return described[name]
    try:
        number = int(name, 16) if name.startswith("0x") or not isinstance(value, int) else value
    except (TypeError, ValueError):
        raise EncodeError(f"no message is called {name!r}; there are: {', '.join([*BY_NAME, *described])}") from None
    if not 0 <= number <= 255:
        raise EncodeError(f"a payload type is 0 to 255, given {number}")
    return number


def _whole(name: str, fields: Mapping[str, Any]) -> int:
    """A value of the header."""
    least, most, usual = HEADER_LIMITS[name]
    value = fields.get(name, usual)
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        raise EncodeError(f"{name} is a whole number from {least} to {most}, given {value!r}")
    return value
