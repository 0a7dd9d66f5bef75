"""Table lines of `imuscope inspect`: values with their units, enumerations and flags by name.

    {"message": "Imu3Acc", "fields": {"device_id": 7, "version": 33, "mode": 1, "acc_x": 0.5, …}}
    ──>  Imu3Acc   device_id 7  version 2.1  mode Safety  acc_x 0.5 m/s²  …

The rows of the protocols' tables (protocols/schema/fields.py) give the meaning of a value. JSON lines have wire values;
here values are scaled to the unit of their row. Text from a device is escaped so that it cannot control the terminal
(server/text/printable.py).
"""

import struct
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any

from imuscope.protocols.commands.composer import ProtocolComposer
from imuscope.protocols.family.info import ProtocolInfo
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.flag_words import unknown_bits
from imuscope.protocols.schema.labels import device_label
from imuscope.protocols.schema.shown_values import meant, signed_number
from imuscope.server.commands.compose import composers
from imuscope.server.configuration.value_format import entry_title
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.library.reject_reasons import explained_rejects
from imuscope.server.text.printable import printable

LONGEST_WORD = 64  # characters of a text or of bytes; jsonl has all of them
NAME_CHARS = 26  # of the message name

NOTES: Mapping[str, str] = {
    "undecodable_short": "shorter than its type: not decoded",
    "size_mismatch_long": "longer than its type",
    "version": "not version 2.1",
    "not_finite": "a value is not a number",
    "not_unit": "the norm of the quaternion is not 1",
}
"""Explanation of each of the "notes" of a listed line, for display."""

Line = Mapping[str, Any]
_NOTHING = Field("")
NO_PARTS: Mapping[str, Sequence[str]] = {}


class InspectTable:
    """Lines of a table.

    Args:
        reading: decode options, for descriptions of a vendor's own messages.
        family: of the frames.
    """

    head = f"{'offset':>10}  {'size':>5}  {'message':<{NAME_CHARS}}  fields"

    def __init__(self, reading: DecodeOptions, family: ProtocolInfo) -> None:
        self._explained = explained_rejects(family)
        self._composers = composers(reading)
        self._fields = lru_cache(maxsize=1024)(self._fields_of)

    def row(self, line: Line) -> str:
        """One line, without a line break."""
        head = f"{line['offset']:>10}  {line['size']:>5}  "
        if "reject" in line:
            why = self._explained.get(line["reject"], "")
            return head + f"{'—':<{NAME_CHARS}}  {line['reject']}" + (f": {why}" if why else "")
        flags = line.get("flags", {})
        known = self._fields(line["protocol"], line["message"])
        composer = self._composers.get(line["protocol"])
        parts = composer.elements(line) if composer is not None else {}
        words = _words(line["fields"], known, flags, "", parts)
        wire = line.get("wire", {})
        words += _repeated(wire, known.values())
        words += [f"({name} {_shown(wire[name], _NOTHING, {}, '')})" for name in ("bid", "trailing") if name in wire]
        words += [f"({NOTES.get(note, note)})" for note in line.get("notes", ())]
        words += ["(unverified)"] * (line.get("verified") is False)
        name = line["message"] if line["id"] is not None else f"{line['protocol']} {line['message']}"
        return printable((head + f"{name:<{NAME_CHARS}}  " + "  ".join(words)).rstrip())

    def _fields_of(self, protocol: str, message: str) -> Mapping[str, Field]:
        """Fields by the names that inspect prints; {} for embedded messages (NMEA, UBX, RTCM)."""
        composer: ProtocolComposer | None = self._composers.get(protocol)
        if composer is None:
            return {}
        return {field.name: field for field in _rows(composer, message)}


def _repeated(wire: Mapping[str, Any], fields: Iterable[Field]) -> list[str]:
    """The earlier forms of a quantity that a message holds several times, by name and identifier."""
    rows = {field.id: field for field in fields if field.id >= 0}
    words = []
    for position, value in wire.get("repeated", ()):
        identifier = wire["items"][position][0]
        field = rows.get(identifier & 0xFFF0, _NOTHING)
        words.append(f"(also {field.name or 'unknown'} 0x{identifier:04X} {_shown(value, field, {}, '')})")
    return words


def _rows(composer: ProtocolComposer, message: str) -> tuple[Field, ...]:
    return (composer.listed or {}).get(message) or composer.messages.get(message) or composer.opaque_fields


def _words(
    record: Line,
    rows: Mapping[str, Field],
    flags: Mapping[str, list[str]],
    path: str,
    parts: Mapping[str, Sequence[str]] = NO_PARTS,
) -> list[str]:
    """The values of a record, each with the meaning that it has beside the others.

    Args:
        parts: arrays of which only some elements are there → names of these.
    """
    words = []
    for name, value in record.items():
        field = rows.get(name, _NOTHING)
        if field.meaning_of:
            field, value = meant(field, record), signed_number(field, value, record)
        if name in parts and isinstance(value, list) and "," not in field.unit:
            some = (f"{part} {_one(one, field, flags, path)}" for part, one in zip(parts[name], value, strict=False))
            words.append(f"{name} {_with('[' + ', '.join(some) + ']', field.unit)}")
            continue
        words.append(f"{name} {_shown(value, field, flags, f'{path}{name}')}")
    return words


def _shown(value: Any, field: Field, flags: Mapping[str, list[str]], path: str) -> str:
    """A value with its unit, enumerated ones and flag words by name."""
    if isinstance(value, Mapping) and value.keys() <= {"f32", "f64"}:
        value = _float(value)
    if isinstance(value, Mapping):
        parts = {part.name: part for part in field.fields}
        return "{" + ", ".join(_words(value, parts, flags, f"{path}.")) + "}"
    if isinstance(value, (list, tuple)):
        units = field.unit.split(",") if "," in field.unit else [""] * len(value)
        each = [_one(v, field, flags, f"{path}[{i}]") for i, v in enumerate(value)]
        text = "[" + ", ".join(_with(one, unit) for one, unit in zip(each, units, strict=False)) + "]"
        return text if "," in field.unit or field.fields else _with(text, field.unit)
    return _with(_one(value, field, flags, path), "" if "," in field.unit else field.unit)


def _one(value: Any, field: Field, flags: Mapping[str, list[str]], path: str) -> str:
    if isinstance(value, Mapping) and value.keys() <= {"f32", "f64"}:
        value = _float(value)
    if isinstance(value, (Mapping, list, tuple)):
        return _shown(value, field, flags, path)
    if field.choices and value in field.choices:
        return f"{field.choices[value]} ({value})"
    if isinstance(value, str):
        return value if len(value) <= LONGEST_WORD else f"{value[: LONGEST_WORD - 1]}…"
    scaled = field.scale != 1 or field.bias
    if scaled and isinstance(value, (int, float)):
        value = value * field.scale + field.bias
    if isinstance(value, float):
        narrow = field.dtype.endswith("f4") or not (field.dtype.endswith("f8") or scaled)
        text = f"{value:.6g}" if narrow else f"{value:.10g}"
    else:
        text = _number(value, field) if isinstance(value, int) else str(value)
    names = [*flags.get(path, ()), *(unknown_bits(field.bits, value) if field.bits and isinstance(value, int) else ())]
    return f"{text} ({', '.join(names)})" if names else text


def _number(value: int, field: Field) -> str:
    """An integer; an identifier in hex, as in its document or on its label."""
    if field.key_mask:
        title = entry_title(field, value)
        return f"0x{value:04X}" + ("" if title.startswith("0x") else f" ({title})")
    return device_label(value) if field.base == 16 else str(value)


def _with(text: str, unit: str) -> str:
    """A unit that begins with a number is a multiple: "1234 × 0.1 ms"."""
    if not unit or unit == "week":  # a week number is not a count of weeks
        return text
    return f"{text} × {unit}" if unit[0].isdigit() else f"{text} {unit}"


def _float(float_bytes: Mapping[str, str]) -> float:
    """A non-finite float, which is listed as its bytes."""
    ((kind, digits),) = float_bytes.items()
    return float(struct.unpack(">f" if kind == "f32" else ">d", bytes.fromhex(digits))[0])
