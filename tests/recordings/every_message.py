"""Frames of everything that the tables of the three families describe, made by their own encoders.

A frame is made from the row of its message: a value for each field, within range, and different from field to field
and from frame to frame. A new row of a table is a new case.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import count, product
from typing import Any

from imuscope.protocols.commands.composer import ProtocolComposer
from imuscope.protocols.idtp.frames import LITE, SAFETY
from imuscope.protocols.idtp.frames import build as build_idtp
from imuscope.protocols.isb import frames as isb_frames
from imuscope.protocols.isb import messages as isb_messages
from imuscope.protocols.isb.dataset_loader import CURRENT, SETS
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.layouts import pack, size_of
from imuscope.protocols.xbus import messages as xbus_messages
from imuscope.protocols.xbus.data_identifiers import COORDINATES, ITEMS, PRECISIONS, item
from imuscope.protocols.xbus.frames import build

REPEATS = 3
KINDS = ("i8", "u8", "i16", "u16", "i32", "u32", "i64", "u64", "f32", "f64")
SCHEMA = "\n".join(
    f'[[message]]\ntype = {0x80 + number}\nname = "Own_{kind}"\n[[message.field]]\nname = "One"\ntype = "{kind}"\n'
    f'[[message.field]]\nname = "Some"\ntype = "{kind}"\ncount = 3\nunit = "m/s"\nscale = 0.5\n'
    for number, kind in enumerate(KINDS)
)
SCHEMA += '[[message]]\ntype = 0xA0\nname = "Odd"\n' + "".join(
    f'[[message.field]]\nname = "{name}"\ntype = "u8"\n' for name in ("time", "arrival", "value", "x", "rows", "t0")
)
"""A vendor's own IDTP payloads: every type of number, alone and as a scaled vector."""

Case = tuple[str, bytes]  # name of the case, frame


def composer(family: str) -> ProtocolComposer:
    """The encoder of a family, with the vendor's own payloads of SCHEMA."""
    make, row = PROTOCOLS[family].frames.composer, PROTOCOLS[family]
    assert make is not None
    return make(row.settings({"schema": SCHEMA}) if family == "idtp" else {})


def values_of(fields: Sequence[Field], seed: int) -> dict[str, Any]:
    """Values of a record as JSON."""
    return {field.name: _value(field, seed + 3 * place) for place, field in enumerate(fields)}


def _value(field: Field, seed: int) -> Any:
    shape = tuple(2 if size < 0 else size for size in field.shape)
    if field.dtype == "ascii":
        text = f"t{seed}"[: shape[-1]] if shape and field.shape[-1] >= 0 else "t7"
        return [text] * shape[0] if len(shape) == 2 else text
    if field.dtype == "bytes":
        return bytes((seed + k) % 256 for k in range(shape[0] if shape else 1)).hex()
    numbers = 1
    for size in shape:
        numbers *= size
    every = [_element(field, seed + k) for k in range(numbers)]
    return every if field.shape else every[0]


def _element(field: Field, seed: int) -> Any:
    if field.fields:
        return values_of(field.fields, seed)
    if field.choices:
        return sorted(field.choices)[seed % len(field.choices)]
    if field.dtype.endswith(("f4", "f8")) or field.dtype.startswith("fp"):
        return (seed % 50 + 1) / 64
    return seed % 50 + 1


# -- Xbus --------------------------------------------------------------------------------------------------------------


def xbus_items() -> Iterator[tuple[str, list[int], list[Field]]]:
    """Every item in every number format and coordinate system, and eight forms of different items in one message."""
    every: list[tuple[int, Field]] = []
    for row in ITEMS:
        systems = COORDINATES if "local" in row.frame else COORDINATES[:1]
        formats = PRECISIONS if row.dtype == "real" else PRECISIONS[:1]
        for (system, _), (form, dtype) in product(enumerate(systems), enumerate(formats)):
            identifier = row.id | system << 2 | form
            size = _size(row, dtype)
            every.append((identifier, item(identifier, size)))
    for identifier, field in every:
        yield f"{field.name} 0x{identifier:04X}", [identifier], [field]
    for at in range(0, len(every), 8):
        some = every[at : at + 8]
        yield f"several from 0x{some[0][0]:04X}", [one for one, _ in some], [field for _, field in some]


def _size(row: Field, dtype: str) -> int:
    """Bytes of an item; of one with an open list, with two entries."""
    if row.fields:
        return sum(size_of(part) * (2 if part.shape[:1] == (-1,) else 1) for part in row.fields)
    if row.dtype == "bytes":
        return 5
    return size_of(replace(row, dtype=dtype) if row.dtype == "real" else row)


def xbus() -> Iterator[Case]:
    """All data of an MTi, and every message that it sends, in each of its forms."""
    encode, numbers = composer("xbus").frame_of, count(1)
    for name, identifiers, fields in xbus_items():
        for seed in range(REPEATS):
            number = next(numbers)
            payload = (
                b"\x10\x20\x02" + (number & 0xFFFF).to_bytes(2, "big") + b"\x10\x60\x04" + number.to_bytes(4, "big")
            )
            yield name, _mtdata2(payload, identifiers, fields, seed)
    for row in xbus_messages.MESSAGES:
        if row.direction != "to_device" and row.name != "MTData2":
            yield row.name, encode({"message": row.name, "fields": values_of(row.fields, 1)})


def _mtdata2(payload: bytes, identifiers: Sequence[int], fields: Sequence[Field], seed: int) -> bytes:
    for identifier, field in zip(identifiers, fields, strict=True):
        if identifier in (0x1020, 0x1060):
            continue
        value = _value(field, seed)
        content = bytes.fromhex(value) if field.dtype == "bytes" else pack((field,), {field.name: value})
        payload += identifier.to_bytes(2, "big") + bytes([len(content)]) + content
    return build(0x36, payload)


# -- Inertial Sense ----------------------------------------------------------------------------------------------------


def isb() -> Iterator[Case]:
    """Every data set, of every firmware whose structure is another, and every other packet of a device."""
    encode = composer("isb").frame_of
    for did, dataset in SETS.items():
        if dataset.struct is None:
            continue
        for version in {CURRENT: 0, **dataset.sizes}:
            size = dataset.sizes.get(version, dataset.struct.size)
            fields = [field for field, _ in isb_messages.places(did, 0, size, version=version)]
            if not fields:
                continue  # that firmware has no such set
            for seed in range(REPEATS):
                record: Mapping[str, Any] = {
                    "message": dataset.name,
                    "fields": values_of(fields, seed),
                    "wire": {"firmware": version, "size": size},
                }
                yield f"{dataset.name} {version}", encode(record)


# -- IDTP --------------------------------------------------------------------------------------------------------------


def idtp() -> Iterator[Case]:
    """Every payload type in both modes that need no key, and a vendor's own."""
    one, numbers = composer("idtp"), count(1)
    for (name, fields), mode in product(one.messages.items(), (LITE, SAFETY)):
        for seed in range(REPEATS):
            number = next(numbers)
            head = {"timestamp": 1000 * number, "sequence": number, "device_id": 7, "version": 0x21, "mode": mode}
            values = {**values_of([field for field in fields if field.name not in head], seed), **head}
            yield f"{name} {mode}", one.frame_of({"message": name, "fields": values})


# -- other versions ----------------------------------------------------------------------------------------------------


def other_versions(family: str) -> Iterator[Case]:
    """Every message of a device with a payload that is shorter or longer than in the document: of another version."""
    if family == "xbus":
        for row in xbus_messages.MESSAGES:
            if row.direction != "to_device" and row.name != "MTData2":
                frame = composer("xbus").frame_of({"message": row.name, "fields": values_of(row.fields, 1)})
                payload = frame[6:-1] if frame[3] == 0xFF else frame[4:-1]
                for other in (b"", payload[:-1], payload + b"\x01", payload + bytes(9)):
                    yield row.name, build(row.id, other)
    elif family == "isb":
        for did, dataset in SETS.items():
            size = dataset.struct.size if dataset.struct is not None else 20
            for other in {1, max(size - 1, 1), max(size // 2, 1), size + 1, size + 40}:
                yield (
                    dataset.name,
                    isb_frames.build(isb_frames.DATA, did, bytes(k % 7 for k in range(min(other, 2000)))),
                )
    else:
        for kind in range(256):
            for size in (0, 3, 13, 41, 600):
                yield str(kind), build_idtp(kind, bytes(size), sequence=2 * kind + size + 10_000, device=7)
