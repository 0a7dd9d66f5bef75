"""Text form of wire values, for comparisons, outcomes and the comments of a snapshot.

400, Field unit "Hz"          "400 Hz"          2, choices {2: "115 200 Bd"}    "115 200 Bd"
0x12, named bits              "A, C"            [0.0, 0.0, 1.0], unit "m"       "0, 0, 1 m"
                                                [52.0, 6.0, 30.0], unit "°,°,m" "52 °, 6 °, 30 m"
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from imuscope.protocols.registry.families import entry_words
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.flag_words import unknown_bits
from imuscope.protocols.schema.labels import constant_label, device_label
from imuscope.protocols.schema.shown_values import meant, signed_number

MAX_TEXT_CHARS = 120
IN_DEGREES = {"rad": "°", "rad/s": "°/s", "rad/s/°C": "°/s/°C"}
OFF = "off"  # a quantity that a list of outputs does not have
FLOAT32_DIGITS = 7
MAX_VALUE = 1e300  # above any device value; arithmetic fails beyond it, and an uploaded file may contain such values
_WHOLE = re.compile(r"-?\d{1,20}\Z")


def shown(field: Field) -> Field:
    """A field in the unit of its plots: an angle that is written in radians in degrees."""
    unit = IN_DEGREES.get(field.unit)
    if unit is None or field.scale != 1:
        return field
    return replace(field, unit=unit, scale=180 / math.pi)


def words(field: Field, value: Any, record: Mapping[str, Any] | None = None) -> str:
    """A value as text, in the shown unit; "" for None.

    Args:
        record: that it is in, if its meaning could depend on another value there.
    """
    if value is None:
        return ""
    if record is not None:
        field, value = meant(field, record), signed_number(field, value, record)
    field = shown(field)
    if isinstance(value, list | tuple):
        units = field.unit.split(",")
        if len(units) == len(value) > 1:  # one unit for each: "°,°,m"
            return _short(", ".join(f"{_one(field, item)} {unit}" for item, unit in zip(value, units, strict=True)))
        text = ", ".join(_one(field, item) for item in value) if value else "none"
        return _short(f"{text} {field.unit}" if field.unit and value else text)
    text = _one(field, value)
    named = field.choices or field.bits or isinstance(value, str | Mapping)
    return _short(f"{text} {field.unit}" if field.unit and not named else text)


def _one(field: Field, value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {part}" for name, part in value.items())
    if isinstance(value, str) or not isinstance(value, int | float):
        return str(value)
    if not abs(value) < MAX_VALUE:
        return (
            f"{value:g}"
            if isinstance(value, float)
            else f"{'-' if value < 0 else ''}2^{value.bit_length() - 1} or more"
        )
    if field.choices:
        return constant_label(field.choices.get(int(value), str(value)))
    if field.bits:
        return flags(field, int(value))
    if field.base == 16 and isinstance(value, int):
        return device_label(value)
    if field.scale == 1 and not field.bias and isinstance(value, int):
        return str(value)
    shown = value * field.scale + field.bias
    return f"{shown:.{field.decimals}f}" if field.decimals >= 0 else f"{shown:.{FLOAT32_DIGITS}g}"


def flags(field: Field, word: int) -> str:
    """The names of the set bits of a word."""
    names = []
    for bits in field.bits:
        part = bits.of(word)
        if bits.width > 1:
            names.append(f"{constant_label(bits.name)}: {constant_label(str(bits.choices.get(part, part)))}")
        elif part:
            names.append(constant_label(bits.name))
    return ", ".join([*names, *unknown_bits(field.bits, word)]) or "none"


def comment(field: Field, value: Any) -> str:
    """Comment of a snapshot after a value: its meaning if the number alone does not show it, else its unit."""
    if isinstance(value, int | float) and (field.choices or field.base == 16 or (field.bits and value)):
        return words(field, value)
    field = shown(field)
    if isinstance(value, int | float | list) and (field.scale != 1 or field.bias):
        return words(field, value)
    return field.unit if isinstance(value, int | float | list) else ""


def numbers(fields: Sequence[Field], values: Any) -> Any:
    """Values from a page, with large integers (sent as text) converted back to numbers."""
    if not isinstance(values, Mapping):
        return values
    known = {field.name: field for field in fields}
    return {name: _number(known[name], value) if name in known else value for name, value in values.items()}


def _number(field: Field, value: Any) -> Any:
    if isinstance(value, list):
        return [_number(field, one) for one in value]
    if field.fields:
        return numbers(field.fields, value)
    is_text = field.dtype in ("bytes", "ascii") or not isinstance(value, str)
    return value if is_text or not _WHOLE.match(value) else int(value)


def head_of(path: str, names: Iterable[str]) -> tuple[str, str]:
    """The name that a path begins with, and the rest. Names may contain dots ("wheelConfig.radius")."""
    for name in sorted(names, key=len, reverse=True):
        if path == name or path.startswith(f"{name}."):
            return name, path[len(name) + 1 :]
    first, _, rest = path.partition(".")
    return first, rest


def field_at(fields: Sequence[Field], path: str) -> Field | None:
    """The field at a path ("outputs.3.output_frequency"); for an element of a vector, the vector."""
    match: Field | None = None
    inside = {field.name: field for field in fields}
    while path:
        name, path = head_of(path, inside)
        if name.isdecimal():
            continue
        match = inside.get(name)
        if match is None:
            return None
        inside = {field.name: field for field in match.fields}
    return match


def value_at(values: Any, path: str) -> Any:
    """Value at a path; None if there is none."""
    while path:
        name, path = head_of(path, values if isinstance(values, Mapping) else ())
        if isinstance(values, Mapping):
            values = values.get(name)
        elif isinstance(values, list | tuple) and name.isdecimal() and int(name) < len(values):
            values = values[int(name)]
        else:
            return None
    return values


def record_at(values: Any, path: str) -> Mapping[str, Any] | None:
    """The record that holds the value at a path; None for another value."""
    at = value_at(values, path.rpartition(".")[0])
    return at if isinstance(at, Mapping) else None


def spaced(name: str) -> str:
    """Displayed form of a table's name: "OutputConfiguration" becomes "Output configuration"."""
    text = re.sub(r"([a-z])([A-Z])", lambda match: f"{match[1]} {match[2].lower()}", name.replace("_", " "))
    return text[:1].upper() + text[1:]


def titled(title: str) -> str:
    """The title, or the displayed form of a name if the table has no title; short names ("q0") are symbols."""
    return spaced(title) if len(title) > 2 and (title[0].islower() or "_" in title) else title


def title_at(fields: Sequence[Field], path: str) -> str:
    """Displayed title of a path: "Outputs 4, Rate"."""
    titles: list[str] = []
    inside = {field.name: field for field in fields}
    while path:
        name, path = head_of(path, inside)
        if name.isdecimal() and titles:
            titles[-1] += f" {int(name) + 1}"
            continue
        entry = inside.get(name)
        titles.append((entry.title or entry.name) if entry is not None else name)
        inside = {field.name: field for field in entry.fields} if entry is not None else {}
    return ", ".join(titles)


# ── records with a key: numbers with a joint meaning, which the family has words for ─────────────────────────────────


def key_of(fields: Sequence[Field]) -> Field | None:
    """The field of a record that names its quantity; None if it has none."""
    return next((field for field in fields if field.key_mask), None)


def hex_key(key: Field, number: int) -> str:
    """A key as in its document: "0x4020"."""
    return f"0x{number:0{2 * np.dtype(key.dtype).itemsize}X}"


def entry_value(entry: Mapping[str, Any] | None) -> str:
    """Format an entry: "400 Hz", with an unusual variant; OFF for none."""
    if entry is None:
        return OFF
    parts = entry_words(entry)
    return parts[1] if parts is not None else ""


def entry_title(key: Field, number: int) -> str:
    """The quantity that a key names."""
    parts = entry_words({key.name: number})
    return parts[0] if parts is not None else hex_key(key, number)


def entry_comment(fields: Sequence[Field], entry: Mapping[str, Any]) -> str:
    """Comment of a snapshot after one record of a list; "" if the values need no explanation."""
    key = key_of(fields)
    if key is not None and all(field.name in entry for field in fields):
        number = int(entry[key.name])
        return ", ".join(filter(None, (entry_title(key, number), entry_value(entry)))) if number else "nothing"
    parts = [(words(field, entry.get(field.name), entry), entry.get(field.name)) for field in fields]
    if all(text == str(value) or not text for text, value in parts):
        return ""
    return ", ".join(text for text, _ in parts if text)


def _short(text: str) -> str:
    return text if len(text) <= MAX_TEXT_CHARS else text[: MAX_TEXT_CHARS - 1] + "…"
