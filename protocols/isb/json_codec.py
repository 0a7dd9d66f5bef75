"""JSON form of a packet, and its inverse, byte for byte.

    {"id": 4, "message": "DID_INS_1",
     "fields": {"week": 2392, "timeOfWeek": 432000.0, "insStatus": 200823, "theta": [0.0, 0.0, 3.0], …},
     "flags": {"insStatus": ["INS_STATUS_NAV_MODE", "INS_STATUS_SOLUTION: NAV", …]}}
    {"id": 12, "message": "SET_DID_FLASH_CONFIG", "fields": {"startupNavDtMs": 16}}
    {"id": 0, "message": "GET_DATA", "fields": {"id": 4, "size": 0, "offset": 0, "period": 1}}

A DATA packet is named like its data set, a SET_DATA packet SET_ and its data set; the others by their packet types.
`id` is the header's. `fields` are wire values by name, in the vendor's order, unscaled; records are objects, vectors
and matrices flat lists. A packet with a part of a set has only the fields in it, and a list cut at its ends only the
whole elements.

`wire` has the remaining information:

    offset, size   the part of the data set, if it differs from the span of the named fields
    firmware       whose structure it is, if the size does not determine it
    unknown        hex of bytes that belong to no field (and are not 0), by their offset in the payload
    flags          bits of the header's high nibble other than "with offset"
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from imuscope.protocols.isb.classify import EVENT_TEXT, variant_of
from imuscope.protocols.isb.dataset_loader import SETS, VERSIONS, element_size
from imuscope.protocols.isb.frames import DATA, HEADER, SET_DATA, TRAILER, TYPE_MASK, TYPES, WITH_OFFSET, build
from imuscope.protocols.isb.messages import (
    BY_NAME,
    COMMANDS,
    EVENT_SET,
    RAW_SETS,
    ROWS,
    SET_PREFIX,
    Place,
    places,
    rules,
    set_row,
    version_for,
)
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.json_values import flag_names, jsonable
from imuscope.protocols.schema.layouts import EncodeError, bytes_of_hex, pack, size_of, unpack

Plain = dict[str, Any]

_RULES = rules()
_COMMAND_OF = {row.name: kind for kind, row in COMMANDS.items()}

# -- packet → values ---------------------------------------------------------------------------------------------------


def described(kind: int, did: int, payload: bytes, offset: int, version: str | None) -> tuple[Place, ...]:
    """The fields of a payload (without its offset) and their offsets in it."""
    if kind in COMMANDS:
        at = 0
        out: list[Place] = []
        for field in COMMANDS[kind].fields:
            if at + size_of(field) <= len(payload):
                out.append((field, at))
            at += size_of(field)
        return tuple(out)
    variant = 0
    if not offset:
        variant = int(variant_of(np.frombuffer(payload, np.uint8), 0, len(payload), did, _RULES))
    return places(did, offset, len(payload), version=version, variant=variant)


def values_of(kind: int, did: int, payload: bytes, offset: int, version: str | None) -> dict[str, Any]:
    """Wire values by name."""
    places = described(kind, did, payload, offset, version)
    return {field.name: unpack((field,), payload, at)[field.name] for field, at in places}


def frame_to_json(packet: bytes, version: str | None = None) -> Plain:
    """The values of one valid packet: keys id, message, fields, and flags and wire if needed.

    Args:
        version: the device's firmware, of dataset_loader.VERSIONS, if known.
    """
    head, did = packet[2], packet[3]
    kind = head & TYPE_MASK
    shifted = bool(head & WITH_OFFSET) and kind in (DATA, SET_DATA)
    offset = int.from_bytes(packet[HEADER : HEADER + 2], "little") if shifted else 0
    payload = packet[HEADER + 2 * shifted : -TRAILER]
    places = described(kind, did, payload, offset, version)
    name = COMMANDS[kind].name if kind in COMMANDS else (set_row(did) if kind == SET_DATA else ROWS[did]).name
    fields = {field.name: unpack((field,), payload, at, exact=True)[field.name] for field, at in places}
    result: Plain = {"id": did, "message": name, "fields": jsonable(fields)}
    flags = {path: names for field, _ in places for path, names in _flags(field, fields[field.name])}
    if flags:
        result["flags"] = flags
    wire = _wire(kind, did, payload, offset, shifted, version, places, result["fields"])
    if head & ~TYPE_MASK & ~(WITH_OFFSET if shifted else 0):
        wire["flags"] = head & ~TYPE_MASK & ~(WITH_OFFSET if shifted else 0)
    if wire:
        result["wire"] = wire
    return result


def elements(record: Mapping[str, Any]) -> dict[str, list[str]]:
    """See ProtocolComposer.elements: a packet with an offset may begin or end within an array."""
    wire, dataset = record.get("wire", {}), SETS.get(record.get("id") or 0)
    if "offset" not in wire or dataset is None or dataset.struct is None:
        return {}
    names = {}
    for field, at in places(int(record["id"]), wire["offset"], wire["size"], version=wire.get("firmware")):
        whole = dataset.struct.field(field.name)
        if whole is not None and whole[0].shape != field.shape and field.shape:
            first = (wire["offset"] + at - whole[1]) // element_size(whole[0])
            some = range(first, first + field.shape[0])
            names[field.name] = [whole[0].axes[n] if whole[0].axes else str(n) for n in some]
    return names


def _wire(
    kind: int,
    did: int,
    payload: bytes,
    offset: int,
    shifted: bool,
    version: str | None,
    places: tuple[Place, ...],
    fields: Plain,
) -> Plain:
    """Information of a packet that the named fields do not carry."""
    wire: Plain = {}
    if kind not in COMMANDS:
        if version and version_for(did, offset, len(payload), version) != version_for(did, offset, len(payload), None):
            wire["firmware"] = version
        if (offset, len(payload), shifted) != _extent(did, fields, wire.get("firmware")):
            wire["size"] = len(payload)
            if shifted:
                wire["offset"] = offset
    elif len(payload) != sum(size_of(field) for field in COMMANDS[kind].fields):
        wire["size"] = len(payload)
    unknown = {}
    end = 0
    for field, at in (*places, (Field("", "u1", (0,)), len(payload))):
        gap = payload[end:at].rstrip(b"\0")
        if gap:
            unknown[str(end)] = gap.hex()
        end = at + size_of(field)
    if unknown:
        wire["unknown"] = unknown
    return wire


def _flags(field: Field, value: Any) -> Iterator[tuple[str, list[str]]]:
    return flag_names(field, value, field.name, lambda bits: bits.doc or bits.name)


# -- values → packet ---------------------------------------------------------------------------------------------------


def frame_from_json(record: Mapping[str, Any]) -> bytes:
    """The packet of a `frame_to_json` result; keys other than id, message, fields and wire are ignored.

    Raises:
        EncodeError: a name or value that the tables do not allow.
    """
    name, fields, wire = str(record.get("message", "")), record.get("fields", {}), record.get("wire", {})
    if not isinstance(fields, Mapping) or not isinstance(wire, Mapping):
        raise EncodeError("fields and wire are objects")
    kind = _COMMAND_OF.get(name) or (SET_DATA if name.startswith(SET_PREFIX) else DATA)
    did = _did(name, kind, record.get("id"))
    shifted = False
    if kind in COMMANDS:
        at = 0
        places: list[Place] = []
        for field in COMMANDS[kind].fields:
            places.append((field, at))
            at += size_of(field)
        size, offset = wire.get("size", at), 0
        places = [(field, at) for field, at in places if at + size_of(field) <= size]
    else:
        offset, size, shifted = _extent(did, fields, wire.get("firmware"))
        if "size" in wire:
            offset, size, shifted = wire.get("offset", 0), wire["size"], "offset" in wire
        places = list(_places(did, offset, size, fields, wire.get("firmware")))
    if not isinstance(size, int) or not 0 <= size <= 2040 or not isinstance(offset, int):
        raise EncodeError(f"a payload has 0 to 2040 bytes, given {size!r} from {offset!r}")
    payload = _packed(places, fields, size, wire.get("unknown", {}))
    flags = int(wire.get("flags", 0)) | (WITH_OFFSET if shifted else 0)
    return build(kind, did, payload, offset=offset if shifted else None, flags=flags)


def _did(name: str, kind: int, value: Any) -> int:
    """The header's number."""
    if kind in COMMANDS:
        return int(value or 0)
    bare = name.removeprefix(SET_PREFIX) if kind == SET_DATA else name
    if bare not in BY_NAME:
        raise EncodeError(f"no message is called {name!r}; there are DID_…, SET_DID_…, {', '.join(TYPES.values())}")
    return BY_NAME[bare].id


def _places(did: int, offset: int, size: int, fields: Mapping[str, Any], version: str | None) -> tuple[Place, ...]:
    raw = did in RAW_SETS and not offset and "buf" not in fields  # bytes of an unknown type, or none at all
    variant = int(fields.get("dataType", 0)) if raw else 0
    if did == EVENT_SET:
        variant = int(fields.get("msgTypeID") == EVENT_TEXT)
    return places(did, offset, size, version=version if version in VERSIONS else None, variant=variant)


def _extent(did: int, fields: Mapping[str, Any], version: str | None) -> tuple[int, int, bool]:
    """Offset, size and need of an offset of a payload with just the named fields, from the first to the last."""
    start, stop = -1, 0
    for field, at in _places(did, 0, 2040, fields, version):
        if field.name in fields:
            start = at if start < 0 else start
            value = fields[field.name]
            open_ended = field.dtype == "bytes" or field.fields or isinstance(value, list)
            length = len(value) // 2 if field.dtype == "bytes" else len(value) if open_ended and field.shape else 1
            texts = field.dtype == "ascii" or not field.shape or not open_ended
            whole = size_of(field) if texts else _step(field) * length
            if did == EVENT_SET and field.name == "data":
                whole = len(value) if field.dtype == "ascii" else len(value) // 2
            stop = max(stop, at + whole)
    return max(start, 0), stop - max(start, 0), start > 0


def _step(field: Field) -> int:
    return size_of(field) // max(math.prod(field.shape), 1) if 0 not in field.shape else 0


def _packed(places: list[Place], fields: Mapping[str, Any], size: int, unknown: Any) -> bytes:
    payload = bytearray(size)
    left = dict(fields)
    for field, at in places:
        if field.name not in left:
            raise EncodeError(f"{field.name} is missing")
        value = left.pop(field.name)
        if field.dtype == "bytes":
            value = bytes_of_hex(field.name, value)
        payload[at : at + size_of(field)] = pack((field,), {field.name: value})
    if left:
        names = ", ".join(field.name for field, _ in places) or "none"
        raise EncodeError(f"no field is called {next(iter(left))!r}; there are: {names}")
    for at, gap in unknown.items() if isinstance(unknown, Mapping) else ():
        raw = bytes_of_hex("unknown", gap)
        payload[int(at) : int(at) + len(raw)] = raw
    if len(payload) != size:
        raise EncodeError(f"the values need {len(payload)} bytes, there are {size}")
    return bytes(payload)
