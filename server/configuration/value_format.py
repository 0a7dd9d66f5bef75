"""What does a wire value mean, in words? For comparisons, outcomes and the comments of a snapshot.

400, Field unit "Hz"          "400 Hz"          2, choices {2: "115 200 Bd"}    "115 200 Bd"
0x12, named bits              "A, C"            [0.0, 0.0, 1.0], unit "m"       "0, 0, 1 m"
                                                [52.0, 6.0, 30.0], unit "°,°,m" "52 °, 6 °, 30 m"
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from protocols.labels import device_label, spoken
from protocols.schema import Field

LONGEST = 120
ALWAYS = 0xFFFF  # the rate of what comes with every message
DIGITS = 7  # of a float32
MOST = 1e300  # of any value that a device holds; beyond it arithmetic fails, and a stranger's file may hold it
_WHOLE = re.compile(r"-?\d{1,20}\Z")


def words(field: Field, value: Any) -> str:
    """A value as a person reads it, in the shown unit; "" for nothing."""
    if value is None:
        return ""
    if isinstance(value, list | tuple):
        units = field.unit.split(",")
        if len(units) == len(value) > 1:  # each has its own: "°,°,m"
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
    if not abs(value) < MOST:
        return (
            f"{value:g}"
            if isinstance(value, float)
            else f"{'-' if value < 0 else ''}2^{value.bit_length() - 1} or more"
        )
    if field.choices:
        return spoken(field.choices.get(int(value), str(value)))
    if field.bits:
        return flags(field, int(value))
    if field.base == 16 and isinstance(value, int):
        return device_label(value)
    if field.scale == 1 and not field.bias and isinstance(value, int):
        return str(value)
    shown = value * field.scale + field.bias
    return f"{shown:.{field.decimals}f}" if field.decimals >= 0 else f"{shown:.{DIGITS}g}"


def flags(field: Field, word: int) -> str:
    """The bits of a word by name."""
    names = []
    for bits in field.bits:
        part = bits.of(word)
        if bits.width > 1:
            names.append(f"{spoken(bits.name)}: {spoken(str(bits.choices.get(part, part)))}")
        elif part:
            names.append(spoken(bits.name))
    return ", ".join(names) or "none"


def comment(field: Field, value: Any) -> str:
    """What a snapshot says behind a value: its meaning where the number alone does not tell, and its unit."""
    if isinstance(value, int | float) and (field.choices or field.base == 16 or (field.bits and value)):
        return words(field, value)
    if isinstance(value, int | float | list) and (field.scale != 1 or field.bias):
        return words(field, value)
    return field.unit if isinstance(value, int | float | list) else ""


def numbers(fields: Sequence[Field], values: Any) -> Any:
    """What a page sent, with whole numbers that JavaScript cannot hold, and so writes as text, as numbers again."""
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
    """The name that a path begins with, and what follows: names may have points of their own ("wheelConfig.radius")."""
    for name in sorted(names, key=len, reverse=True):
        if path == name or path.startswith(f"{name}."):
            return name, path[len(name) + 1 :]
    first, _, rest = path.partition(".")
    return first, rest


def field_at(fields: Sequence[Field], path: str) -> Field | None:
    """The field of a path ("outputs.3.output_frequency"); of a place in a vector, the vector."""
    found: Field | None = None
    inside = {field.name: field for field in fields}
    while path:
        name, path = head_of(path, inside)
        if name.isdecimal():
            continue
        found = inside.get(name)
        if found is None:
            return None
        inside = {field.name: field for field in found.fields}
    return found


def value_at(values: Any, path: str) -> Any:
    """What stands at a path; None where nothing does."""
    while path:
        name, path = head_of(path, values if isinstance(values, Mapping) else ())
        if isinstance(values, Mapping):
            values = values.get(name)
        elif isinstance(values, list | tuple) and name.isdecimal() and int(name) < len(values):
            values = values[int(name)]
        else:
            return None
    return values


def title_at(fields: Sequence[Field], path: str) -> str:
    """A path for a person: "Outputs 4, Rate"."""
    titles: list[str] = []
    inside = {field.name: field for field in fields}
    while path:
        name, path = head_of(path, inside)
        if name.isdecimal() and titles:
            titles[-1] += f" {int(name) + 1}"
            continue
        found = inside.get(name)
        titles.append((found.title or found.name) if found is not None else name)
        inside = {field.name: field for field in found.fields} if found is not None else {}
    return ", ".join(titles)


# ── an entry of an Xsens output configuration: two numbers that say more together ────────────────────────────────────


def output_words(entry: Mapping[str, Any] | None) -> str:
    """ "400 Hz", with precision and frame where they are not the usual ones; "off" for none."""
    if entry is None:
        return "off"
    from protocols.xbus.data_identifiers import COORDINATES

    identifier, rate = int(entry["data_identifier"]), int(entry["output_frequency"])
    parts = ["with every message" if rate in (0, ALWAYS) else f"{rate} Hz"]
    if identifier & 3:
        parts.append(("Float32", "Fp12.20", "Fp16.32", "Float64")[identifier & 3])
    if identifier & 0xC and identifier >> 2 & 3 < len(COORDINATES):
        parts.append(COORDINATES[identifier >> 2 & 3])
    return ", ".join(parts)


def output_title(identifier: int) -> str:
    """The quantity that a data identifier asks for."""
    from protocols.xbus.output_configuration import OUTPUTS

    output = OUTPUTS.get(identifier & 0xFFF0)
    return (output.field.title or output.name) if output is not None else f"0x{identifier:04X}"


def entry_comment(fields: Sequence[Field], entry: Mapping[str, Any]) -> str:
    """What a snapshot says behind one record of a list; "" where the values speak for themselves."""
    if "data_identifier" in entry and "output_frequency" in entry:
        if not entry["data_identifier"]:
            return "nothing"
        return f"{output_title(int(entry['data_identifier']))}, {output_words(entry)}"
    said = [(words(field, entry.get(field.name)), entry.get(field.name)) for field in fields]
    if all(text == str(value) or not text for text, value in said):
        return ""
    return ", ".join(text for text, _ in said if text)


def _short(text: str) -> str:
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
