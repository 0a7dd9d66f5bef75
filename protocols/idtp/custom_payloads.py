"""Payload types defined by a vendor, from the user's description, as rows.

IDTP leaves types from 0x80 on to each vendor. A small TOML file describes them, and they are shown like any other:

    [[message]]
    type = 0x80                     # payload type, 0x07 to 0xFF; 0x00 to 0x06 only for devices that speak version 2.0
    name = "Wheels"
    doc = "Wheel odometry."         # optional, like all below but name and type

    [[message.field]]
    name = "Speed"
    type = "i16"                    # i8 u8 i16 u16 i32 u32 i64 u64 f32 f64, little-endian
    count = 4                       # a vector; 1 when left out
    axes = ["fl", "fr", "rl", "rr"] # a name for each of its elements
    unit = "m/s"
    scale = 0.001                   # shown = sent × scale + bias
    bias = 0.0
    decimals = 2                    # digits after the point on the page

    [[message.field]]
    name = "Steering"
    type = "f32"
    unit = "rad"

A message must not have the name of a standard type, nor a field that of a header field. Fields are consecutive, without
gaps, in file order. An error names message, field, the given value and the allowed ones.
"""

import functools
import math
import re
import tomllib
from collections.abc import Mapping
from typing import Any

from imuscope.protocols.idtp.frames import MAX_PAYLOAD
from imuscope.protocols.idtp.messages import BY_NAME
from imuscope.protocols.schema.fields import Field, Message
from imuscope.protocols.schema.layouts import size_of

TYPES: Mapping[str, str] = {
    **{f"{kind}{8 * size}": f"<{kind}{size}" for kind in "iu" for size in (2, 4, 8)},
    **{"i8": "i1", "u8": "u1", "f32": "<f4", "f64": "<f8"},
}
TEMPLATE = """\
# {size} bytes in all; one [[message.field]] for each quantity, in the order of the bytes.
# type: i8 u8 i16 u16 i32 u32 i64 u64 f32 f64, little-endian
# count: how many of them; left out, one
# unit: "m/s", "°C"; shown = sent × scale
[[message]]
type = 0x{id}
name = "Vendor{id}"

[[message.field]]
name = "Values"
type = "{type}"
count = {count}
unit = ""
scale = 1.0
"""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_MESSAGE_KEYS = ("type", "name", "doc", "field")
_FIELD_KEYS = ("name", "type", "count", "axes", "unit", "scale", "bias", "decimals", "doc", "title")

_NAMES_IN_USE = (
    "timestamp",
    "sequence",
    "device_id",
    "version",
    "mode",
    "data",
)  # written by json_codec.py beside the fields

STANDARD = (*BY_NAME, *(f"{name}Bytes" for name in BY_NAME))  # and the names of too short ones

Schema = Mapping[int, Message]


class SchemaError(ValueError):
    """An invalid description. The text names the place, the given value and the allowed ones."""


@functools.lru_cache(maxsize=8)
def parse(text: str) -> Schema:
    """Payload type → row.

    Raises:
        SchemaError: the text is not TOML, or is invalid.
    """
    try:
        document = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as problem:
        raise SchemaError(f"the schema is not valid TOML: {problem}") from None
    _only("the schema", document, ("message",))
    rows: dict[int, Message] = {}
    for number, table in enumerate(_tables("the schema", document, "message"), 1):
        row = _message(f"message {number}", table)
        if row.id in rows:
            raise SchemaError(f"message {row.name}: type 0x{row.id:02X} is described twice")
        if row.name in {other.name for other in rows.values()}:
            raise SchemaError(f"message {number}: the name {row.name!r} is used twice")
        rows[row.id] = row
    return rows


def _message(place: str, table: Mapping[str, Any]) -> Message:
    name = _name(place, table)
    if name in STANDARD:
        raise SchemaError(f"{place}: {name} is a standard type of IDTP; choose another name")
    place = f"message {name}"
    _only(place, table, _MESSAGE_KEYS)
    number = _whole(place, table, "type", 0, 0xFF)
    fields: list[Field] = []
    for index, part in enumerate(_tables(place, table, "field"), 1):
        field = _field(place, index, part)
        if field.name in {other.name for other in fields}:
            raise SchemaError(f"{place}: the field name {field.name!r} is used twice")
        fields.append(field)
    size = sum(size_of(field) for field in fields)
    if not 0 < size <= MAX_PAYLOAD:
        raise SchemaError(f"{place}: its fields have 1 to {MAX_PAYLOAD} bytes, given {size}")
    return Message(
        number, name, tuple(fields), channel_per_field=True, doc=_text(place, table, "doc"), source="user's schema"
    )


def _field(message: str, index: int, table: Mapping[str, Any]) -> Field:
    name = _name(f"{message}, field {index}", table)
    place = f"{message}, field {name}"
    _only(place, table, _FIELD_KEYS)
    if name in _NAMES_IN_USE:
        raise SchemaError(f"{message}, field {index}: name is none of {', '.join(_NAMES_IN_USE)}; given {name!r}")
    kind = table.get("type")
    if not isinstance(kind, str) or kind not in TYPES:
        raise SchemaError(f"{place}: type is one of {', '.join(TYPES)}, given {kind!r}")
    count = _whole(place, table, "count", 1, MAX_PAYLOAD, 1)
    axes = table.get("axes", [])
    if axes and "count" not in table:
        raise SchemaError(f"{place}: axes needs count: how many elements there are")
    if not isinstance(axes, list) or not all(isinstance(axis, str) for axis in axes) or len(axes) not in (0, count):
        raise SchemaError(f"{place}: axes is a list of {count} names, given {axes!r}")
    if len(set(axes)) < len(axes) or not all(axis.strip() for axis in axes):
        raise SchemaError(f"{place}: axes are {count} different names, given {axes!r}")
    scale = _number(place, table, "scale", 1.0)
    if scale == 0:
        raise SchemaError(f"{place}: scale is a number other than 0, given 0")
    return Field(
        name,
        TYPES[kind],
        (count,) if "count" in table else (),
        unit=_text(place, table, "unit"),
        scale=scale,
        bias=_number(place, table, "bias", 0.0),
        axes=tuple(axes) if "count" in table else (),
        decimals=_whole(place, table, "decimals", -1, 12, -1),
        title=_text(place, table, "title"),
        doc=_text(place, table, "doc"),
        source="user's schema",
    )


def written(schema: Schema) -> str:
    """The text that `parse` turns into these rows."""
    lines: list[str] = []
    for row in schema.values():
        lines += ["[[message]]", f"type = {row.id}", f"name = {_quoted(row.name)}", f"doc = {_quoted(row.doc)}"]
        for field in row.fields:
            kind = next(name for name, dtype in TYPES.items() if dtype == field.dtype)
            lines += ["[[message.field]]", f"name = {_quoted(field.name)}", f'type = "{kind}"']
            lines += [f"count = {field.shape[0]}"] if field.shape else []
            lines += [f"axes = [{', '.join(map(_quoted, field.axes))}]"] if field.axes else []
            lines += [f"scale = {field.scale!r}", f"bias = {field.bias!r}", f"decimals = {field.decimals}"]
            lines += [f"{name} = {_quoted(getattr(field, name))}" for name in ("unit", "title", "doc")]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    """A TOML string."""
    return '"' + "".join(c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08X}" for c in text) + '"'


# -- values of a table -------------------------------------------------------------------------------------------------


def _only(place: str, table: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for key in table:
        if key not in known:
            raise SchemaError(f"{place}: {key!r} is not known; there are {', '.join(known)}")


def _tables(place: str, table: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    entries = table.get(key, [])
    if not isinstance(entries, list) or not entries or not all(isinstance(one, dict) for one in entries):
        raise SchemaError(f"{place}: at least one [[{'message.' * (key == 'field')}{key}]] is needed")
    return entries


def _name(place: str, table: Mapping[str, Any]) -> str:
    name = table.get("name")
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise SchemaError(f"{place}: name is letters, digits and _, a letter first; given {name!r}")
    return name


def _text(place: str, table: Mapping[str, Any], key: str) -> str:
    value = table.get(key, "")
    if not isinstance(value, str):
        raise SchemaError(f"{place}: {key} is text, given {value!r}")
    return value


def _whole(place: str, table: Mapping[str, Any], key: str, low: int, high: int, usual: int | None = None) -> int:
    value = table.get(key, usual)
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise SchemaError(f"{place}: {key} is a whole number from {low} to {high}, given {value!r}")
    return value


def _number(place: str, table: Mapping[str, Any], key: str, usual: float) -> float:
    value = table.get(key, usual)
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not math.isfinite(value):
        raise SchemaError(f"{place}: {key} is a number, given {value!r}")
    return float(value)
