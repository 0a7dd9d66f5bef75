"""Annotation of the bytes of an Xbus frame, for the page and for names in the traffic log.

    FA        preamble
    FF        bus identifier
    C0        SetOutputConfiguration
    08        8 bytes of data
    40 20     outputs.0.data_identifier      Acceleration, Float32
    01 90     outputs.0.output_frequency     400 Hz
    …
    D5        checksum

The spans of a frame cover it without overlap, in order. Anything other than a frame is one span.

Source: MT0101P 2020.A, 5.1.
"""

from collections.abc import Iterator
from typing import Any

from imuscope.protocols.commands.transactions import ByteRange
from imuscope.protocols.schema.fields import Bits, Field
from imuscope.protocols.schema.layouts import size_of, unpack
from imuscope.protocols.xbus.data_identifiers import COORDINATES, item
from imuscope.protocols.xbus.frames import EXTENDED, MTDATA2, items
from imuscope.protocols.xbus.messages import form_of
from imuscope.protocols.xbus.output_configuration import ALWAYS, OUTPUTS

RESTORE = 0xDE
_PRECISIONS = ("Float32", "Fp12.20", "Fp16.32", "Float64")


def is_frame(data: bytes) -> bool:
    """Whether this is exactly one valid frame."""
    if len(data) < 5 or data[0] != 0xFA or sum(data[1:]) & 0xFF:
        return False
    if data[3] != EXTENDED:
        return len(data) == data[3] + 5
    return len(data) >= 7 and len(data) == (data[4] << 8 | data[5]) + 7


def name_of(data: bytes) -> str:
    """Its message's name; a description if it is not a frame."""
    if is_frame(data):
        return form_of(data[2], _payload(data))[0].name
    if data and set(data) == {RESTORE}:
        return "restore communication"
    return f"{len(data)} byte" + "s" * (len(data) != 1)


def _payload(frame: bytes) -> bytes:
    return frame[6 if frame[3] == EXTENDED else 4 : -1]


def annotate(data: bytes) -> list[ByteRange]:
    """The bytes of a frame and what they mean."""
    if not is_frame(data):
        return [ByteRange(0, len(data), name_of(data))] if data else []
    payload = _payload(data)
    body = len(data) - len(payload) - 1
    bus = "bus: master" if data[1] == 0xFF else f"bus {data[1]}"
    ranges = [ByteRange(0, 1, "preamble"), ByteRange(1, 1, bus), ByteRange(2, 1, name_of(data))]
    ranges.append(ByteRange(3, body - 3, f"{len(payload)} byte" + "s" * (len(payload) != 1) + " of data"))
    parts = _of_items(payload, body) if data[2] == MTDATA2 else _of_fields(data[2], payload, body)
    ranges += parts
    return [*ranges, ByteRange(len(data) - 1, 1, "checksum")]


def _of_fields(mid: int, payload: bytes, at: int) -> Iterator[ByteRange]:
    message, covered = form_of(mid, payload)
    values = unpack(message.fields, payload)
    end = at + covered
    for field in message.fields:
        for span in _of_field(field, values[field.name], at, field.name):
            yield span
            at = span.offset + span.size
    if covered < len(payload):
        yield ByteRange(end, len(payload) - covered, "not in the document")


def _of_items(payload: bytes, at: int) -> Iterator[ByteRange]:
    spans, covered = items(payload)
    for identifier, place, size in spans:
        yield ByteRange(at + place - 3, 2, identifier_words(identifier))
        yield ByteRange(at + place - 1, 1, f"{size} bytes")
        field = item(identifier, size)
        if size:
            yield ByteRange(at + place, size, _words(field, unpack((field,), payload[place:])[field.name]), field.name)
    if covered < len(payload):
        yield ByteRange(at + covered, len(payload) - covered, "not an item")


def _of_field(field: Field, value: Any, at: int, path: str) -> Iterator[ByteRange]:
    """One field; each element of a list, and each field of a record, separately."""
    if field.dtype in ("bytes", "ascii") or (field.shape and not field.fields and not isinstance(value, list)):
        if size := size_of(field):
            yield ByteRange(at, size, _words(field, value), path)
        return
    elements = value if field.shape else [value]
    step = size_of(field) // max(len(elements), 1)
    for place, one in enumerate(elements):
        here = f"{path}.{place}" if field.shape else path
        if not field.fields:
            yield ByteRange(at, step, _words(field, one), here)
            at += step
            continue
        for part in field.fields:
            for span in _of_field(part, one[part.name], at, f"{here}.{part.name}"):
                yield span
                at = span.offset + span.size


# -- words -------------------------------------------------------------------------------------------------------------


def identifier_words(identifier: int) -> str:
    """A data identifier: name, and precision and coordinate system if it selects them."""
    output = OUTPUTS.get(identifier & 0xFFF0)
    if identifier == 0:
        return "nothing"
    if output is None:
        return item(identifier, 4).name
    words = [output.field.title or output.name]
    if output.real:
        words.append(_PRECISIONS[identifier & 3])
    if output.local and identifier >> 2 & 3 < len(COORDINATES):
        words.append(COORDINATES[identifier >> 2 & 3])
    return ", ".join(words)


def _words(field: Field, value: Any) -> str:
    if isinstance(value, bytes):
        return f"{len(value)} byte" + "s" * (len(value) != 1)
    if isinstance(value, str):
        return f"“{value}”"
    if field.name == "data_identifier":
        return identifier_words(value)
    if field.name == "output_frequency" and value in (0, ALWAYS):
        return "with every message, or the maximum rate" if value else "the maximum rate"
    if field.bits and isinstance(value, int):
        return f"{field.name}: {', '.join(_set_bits(field.bits, value)) or 'none'}"
    if field.choices and isinstance(value, int):
        return f"{field.name}: {field.choices.get(value, value)}"
    unit = f" {field.unit}" if field.unit else ""
    if isinstance(value, list):
        return f"{field.title or field.name}: {', '.join(_number(field, one) for one in value)}{unit}"
    if isinstance(value, dict):
        return field.title or field.name
    return f"{field.name}: {_number(field, value)}{unit}"


def _number(field: Field, value: Any) -> str:
    if not isinstance(value, (int, float)):
        return str(value)
    shown = value * field.scale + field.bias if (field.scale, field.bias) != (1, 0) else value
    return f"{shown:.{max(field.decimals, 3)}g}" if isinstance(shown, float) and field.decimals < 7 else f"{shown}"


def _set_bits(bits: tuple[Bits, ...], word: int) -> Iterator[str]:
    for one in bits:
        value = one.of(word)
        if one.width == 1:
            if value:
                yield one.name
        elif value or one.choices:
            yield f"{one.name}: {one.choices.get(value, value)}"
