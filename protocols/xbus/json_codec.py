"""JSON form of a frame, and its inverse, byte for byte.

    {"id": 54, "message": "MTData2",
     "fields": {"PacketCounter": 7, "Quaternion": [1.0, 0.0, 0.0, 0.0], "StatusWord": 3},
     "flags": {"StatusWord": ["Selftest", "FilterValid"]},
     "wire": {"bid": 1}}

`fields` are wire values by name, in the order of the wire: numbers unscaled (fixed point as the exact float), vectors
and matrices as flat lists, records as objects, opaque bytes as hex. A float that is not finite is {"f32": hex} or
{"f64": hex}. `flags` names the set bits of every flag word; a bit group is "FilterMode: with GNSS".

`wire` has the remaining information:

    bid        the bus identifier, if not 0xFF
    extended   true: the extended header with fewer than 255 bytes
    size       payload bytes, if the values alone would give another length (a device identifier of 8 bytes)
    items      MTData2: [identifier, size] of all items in order, if one is not the plain float32 ENU one or occurs
               twice
    repeated   MTData2: values hidden by a later item of the same name, as [position in items, value]
    trailing   hex of payload bytes after the last field or item

Source: MT0101P 2020.A, sections 5.1 and 5.3.6.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.json_values import flag_names, jsonable
from imuscope.protocols.schema.layouts import EncodeError, bytes_of_hex, is_open, pack, size_of, unpack
from imuscope.protocols.xbus.data_identifiers import BY_NAME as ITEMS_BY_NAME
from imuscope.protocols.xbus.data_identifiers import RAW_BLOB, item
from imuscope.protocols.xbus.frames import EXTENDED, MASTER, MAX_ACCEPTED, MAX_STANDARD, MTDATA2, build, items
from imuscope.protocols.xbus.messages import BY_NAME, form, form_of

Plain = dict[str, Any]

_HEX_NAME = re.compile(r"0x[0-9A-Fa-f]{4}")

# -- frame → values ----------------------------------------------------------------------------------------------------


def frame_to_json(frame: bytes) -> Plain:
    """The values of one valid frame: keys id, message, fields, and flags and wire if needed."""
    bid, mid = frame[1], frame[2]
    body = 6 if frame[3] == EXTENDED else 4
    payload = frame[body:-1]
    wire: Plain = {}
    if bid != MASTER:
        wire["bid"] = bid
    if body == 6 and len(payload) <= MAX_STANDARD:
        wire["extended"] = True
    if mid == MTDATA2:
        name = "MTData2"
        described: Sequence[Field]
        described, fields = _data(payload, wire)
    else:
        message, covered = form_of(mid, payload)
        name, described = message.name, message.fields
        fields = unpack(described, payload, exact=True)
        if covered < len(payload):
            wire["trailing"] = payload[covered:].hex()
        if not _leads_back(mid, name, jsonable(fields), payload[:covered]):
            wire["size"] = covered
    result: Plain = {"id": mid, "message": name, "fields": jsonable(fields)}
    flags = {path: names for field in described for path, names in flag_names(field, fields[field.name], field.name)}
    if flags:
        result["flags"] = flags
    if wire:
        result["wire"] = wire
    return result


def _leads_back(mid: int, name: str, fields: Plain, payload: bytes) -> bool:
    """Whether name and values alone reproduce this payload."""
    try:
        return _packed(mid, name, fields, None) == payload
    except EncodeError:
        return False


def _data(payload: bytes, wire: Plain) -> tuple[list[Field], Plain]:
    """Fields and values of an MTData2 payload; the remaining information goes into `wire`."""
    spans, covered = items(payload)
    sequence = _joined(spans)
    values: Plain = {}
    described: dict[str, Field] = {}
    repeated: list[list[Any]] = []
    where: dict[str, int] = {}
    for position, (identifier, at, size) in enumerate(sequence):
        field = item(identifier, size)
        raw = payload[at : at + size] if size <= 255 else _chain(payload, at, size)
        if field.name in values:
            repeated.append([where[field.name], jsonable(values.pop(field.name))])
        values[field.name] = unpack((field,), raw, exact=True)[field.name]
        described[field.name] = field
        where[field.name] = position
    listed = tuple((identifier, size) for identifier, _, size in sequence)
    if not _is_unambiguous(listed):
        wire["items"] = [list(entry) for entry in listed]
    if repeated:
        wire["repeated"] = repeated
    if covered < len(payload):
        wire["trailing"] = payload[covered:].hex()
    return [described[name] for name in values], values


def _joined(spans: list[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
    """The items with each chain of raw blobs (255 bytes, continued by the next item) as one."""
    joined: list[tuple[int, int, int]] = []
    before = (-1, 0, 0)
    for one in spans:
        identifier, _, size = one
        if identifier == RAW_BLOB == before[0] and before[2] == 255 and size > 0:
            joined[-1] = (identifier, joined[-1][1], joined[-1][2] + size)
        else:
            joined.append(one)
        before = one
    return joined


def _chain(payload: bytes, at: int, size: int) -> bytes:
    """`size` bytes of a chain whose first part begins at `at`, without the headers between the parts."""
    parts = b""
    while len(parts) < size:
        part = min(size - len(parts), 255)
        parts += payload[at : at + part]
        at += part + 3
    return parts


@lru_cache(maxsize=1024)
def _is_unambiguous(sequence: tuple[tuple[int, int], ...]) -> bool:
    """Whether the names alone reproduce this sequence of (identifier, size)."""
    names = [item(identifier, size).name for identifier, size in sequence]
    known = all(_usual(name, size) == entry for name, entry, (_, size) in zip(names, sequence, sequence, strict=True))
    return known and len(set(names)) == len(names)


def _usual(name: str, size: int) -> tuple[int, int]:
    """The default identifier and size of a name; `size` if the value decides it."""
    if name not in ITEMS_BY_NAME:
        return int(name, 16), size
    row = ITEMS_BY_NAME[name]
    inner = row.fields[-1:] or (row,)
    if is_open(inner[0]):
        return row.id, size
    return row.id, size_of(replace(row, dtype=">f4") if row.dtype == "real" else row)


# -- values → frame ----------------------------------------------------------------------------------------------------


def frame_from_json(record: Mapping[str, Any]) -> bytes:
    """The frame of a `frame_to_json` result; keys other than message, id, fields and wire are ignored.

    Raises:
        EncodeError: a name or value that the tables do not allow.
    """
    name = str(record.get("message", ""))
    fields = record.get("fields", {})
    wire = record.get("wire", {})
    if not isinstance(fields, Mapping) or not isinstance(wire, Mapping):
        raise EncodeError("fields and wire are objects")
    mid = _number(name, record.get("id"))
    payload = _data_payload(fields, wire) if name == "MTData2" else _packed(mid, name, fields, wire.get("size"))
    payload += bytes_of_hex("trailing", wire.get("trailing", ""))
    if len(payload) > MAX_ACCEPTED:
        raise EncodeError(f"a payload has at most {MAX_ACCEPTED} bytes, given {len(payload)}")
    bid = wire.get("bid", MASTER)
    if not isinstance(bid, int) or not 0 <= bid <= 255:
        raise EncodeError(f"bid is a number from 0 to 255, given {bid!r}")
    return build(mid, payload, bid, extended=bool(wire.get("extended")))


def _number(name: str, value: Any) -> int:
    if name in BY_NAME:
        return BY_NAME[name][0].id
    try:
        number = int(name, 16) if name else int(value)
    except (TypeError, ValueError):
        raise EncodeError(f"no message is called {name!r}") from None
    if not 0 <= number <= 255:
        raise EncodeError(f"a message number is 0 to 255, given {number}")
    return number


def _packed(mid: int, name: str, fields: Mapping[str, Any], size: int | None) -> bytes:
    """The payload of a message other than MTData2: by its size if given, else by the first row that fits."""
    if size is not None:
        return pack(*_readied(form(mid, size)[0].fields, fields))
    if fields.keys() == {"data"} and not any(
        row.fields[:1] and row.fields[0].name == "data" for row in BY_NAME.get(name, ())
    ):
        return bytes_of_hex("data", fields["data"])
    problem = EncodeError(f"{name} has no fields, given {', '.join(fields)}")
    for row in BY_NAME.get(name, ()):
        try:
            return pack(*_readied(row.fields, fields))
        except EncodeError as error:
            if not isinstance(problem.__cause__, EncodeError) or fields.keys() == {field.name for field in row.fields}:
                problem = error
    if not fields and name not in BY_NAME:
        return b""
    raise problem


def _data_payload(fields: Mapping[str, Any], wire: Mapping[str, Any]) -> bytes:
    listed = wire.get("items")
    if listed is None:
        return b"".join(_item(name, None, value) for name, value in fields.items())
    hidden = dict(wire.get("repeated", ()))
    payload = b""
    for position, (identifier, size) in enumerate(listed):
        name = item(identifier, size).name
        if position not in hidden and name not in fields:
            raise EncodeError(f"{name} is listed in items and missing in fields")
        payload += _item(name, (identifier, size), hidden.get(position, fields.get(name)))
    return payload


def _item(name: str, entry: tuple[int, int] | None, value: Any) -> bytes:
    """One item, header and value; several for a long blob."""
    if name not in ITEMS_BY_NAME and not _HEX_NAME.fullmatch(name):
        raise EncodeError(f"no item is called {name!r}")
    size = len(value) // 2 if isinstance(value, str) else _open_size(name, value)
    identifier, size = entry or _usual(name, size)
    field = item(identifier, size)
    raw = pack(*_readied((field,), {field.name: value}))
    parts = [raw[at : at + 255] for at in range(0, len(raw), 255)] or [b""]
    if len(parts) > 1 and identifier != RAW_BLOB:
        raise EncodeError(f"{name} has at most 255 bytes, given {len(raw)}")
    return b"".join(identifier.to_bytes(2, "big") + bytes([len(part)]) + part for part in parts)


def _open_size(name: str, value: Any) -> int:
    """The size of an item whose record ends in a list."""
    row = ITEMS_BY_NAME.get(name)
    if row is None or not row.fields or not isinstance(value, Mapping):
        return 0
    last = row.fields[-1]
    count = len(value.get(last.name, ())) if is_open(last) else 0
    return sum(size_of(field) for field in row.fields[:-1]) + size_of(last) * (count if is_open(last) else 1)


def _readied(fields: Sequence[Field], values: Mapping[str, Any]) -> tuple[Sequence[Field], dict[str, Any]]:
    """`values` with hex turned into bytes for byte fields."""
    kinds = {field.name: field for field in fields}
    return fields, {
        name: bytes_of_hex(name, value) if name in kinds and kinds[name].dtype == "bytes" else value
        for name, value in values.items()
    }
