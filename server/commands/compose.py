"""Frames from text: `imuscope compose`, and the frames that `imuscope send` sends.

    imuscope compose SET_DID_FLASH_CONFIG startupNavDtMs=16        ──>  ef49250c06001000100000008f05
    imuscope compose SetOutputConfiguration outputs.0.data_identifier=0x1020 outputs.0.output_frequency=100
    imuscope inspect FILE --format jsonl | imuscope compose --jsonl -        the frames again, one hex line each

FIELD=VALUE:   400   0x400F   -1.5   a name of a choice (GROUND_VEHICLE)   names of flags (DisableAutoStore|EnableAhs)
               in the unit that `imuscope commands` prints for the field; an angle may be in degrees where that is rad
               (90deg, [0,0,90°])
               a group of bits and its value (GPS1_SOURCE=SER1|GPS1_TYPE=GPX; protocols/schema/flag_words.py)
               a list or record as JSON ([1, 2, 3])   hex digits of opaque bytes   text
               a path into lists and records (outputs.0.output_frequency=400); each next index adds a list entry;
               one element of a vector (gps1AntOffset.1=0.3) if a device supplies the others, as with `send`

A message is a command of a protocol, completed with its default values, or any message that `imuscope inspect` names,
unchanged. The protocol is found by the name of the message. The error for an unknown name lists the nearest names.

Lines of JSON are read one at a time and their frames written at once, so a file of any size can be processed.
"""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from imuscope.protocols.commands.composer import FrameRecord, ProtocolComposer
from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.flag_words import nearest, word_of
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.protocols.schema.shown_values import to_shown, to_wire
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.errors import UsageError

NOTHING: FrameRecord = {}
_NUMBER = re.compile(r"0x[0-9A-Fa-f]{1,2}")
_DEGREES = re.compile(r"([-+]?[\d.]+(?:e[-+]?\d+)?)\s*(?:°|deg)(?:/s)?\Z", re.IGNORECASE)
_DEGREES_IN = re.compile(r"\d\s*(°|deg)", re.IGNORECASE)
FOREIGN = ("nmea", "ubx", "rtcm3")
"""Messages that any port can carry, composed from their own bytes. Families add others (ProtocolComposer.strings)."""


class ComposeError(UsageError):
    """The reason why a frame cannot be composed, in one sentence."""


def composers(reading: DecodeOptions = DecodeOptions()) -> dict[str, ProtocolComposer]:  # noqa: B008 - frozen
    """Composers of all protocols that have one, by name.

    Args:
        reading: decode options, for a key and descriptions of a vendor's own messages.
    """
    made = ((name, family.frames.composer) for name, family in PROTOCOLS.items())
    return {name: make(reading.settings(name)) for name, make in made if make is not None}


def context_of(protocol: str, reading: DecodeOptions) -> DeviceContext:
    """Device context of a device that is not connected: the key."""
    return DeviceContext(settings=reading.settings(protocol))


# -- one message, as text ----------------------------------------------------------------------------------------------


def find_composer(
    all_composers: Mapping[str, ProtocolComposer], message: str, protocol: str = "", pairs: Sequence[str] = ()
) -> ProtocolComposer:
    """Composer of the protocol that has this message.

    Args:
        pairs: FIELD=VALUE; the fields decide the protocol of a message given by number.

    Raises:
        ComposeError: unknown message, or one of another protocol; with the nearest names.
    """
    if protocol and protocol not in all_composers:
        raise ComposeError(f"unknown protocol {protocol!r}; available: {', '.join(all_composers)}.")
    candidates = [all_composers[protocol]] if protocol else list(all_composers.values())
    bare = message.removeprefix("$")
    for composer in candidates:
        if message in composer.messages or composer.command(message) or bare in composer.messages:
            return composer
    if protocol and message.startswith("0x"):
        return candidates[0]
    if _NUMBER.fullmatch(message) and not protocol:
        return _numbered(candidates, message, pairs)
    names = {name: None for composer in candidates for name in composer.names()}
    where = f" of {PROTOCOLS[protocol].title}" if protocol else ""
    raise ComposeError(f"unknown message{where}: {message!r}; {nearest(message, list(names))}")


def _numbered(candidates: Sequence[ProtocolComposer], message: str, pairs: Sequence[str]) -> ProtocolComposer:
    """Composer for a message given by number: the only one whose numbered messages have these fields.

    Raises:
        ComposeError: several protocols qualify.
    """
    paths = {pair.partition("=")[0] for pair in pairs}
    able = [one for one in candidates if one.numbered and paths <= {field.name for field in one.opaque_fields}]
    if len(able) == 1:
        return able[0]
    names = " or ".join(one.name for one in candidates if one.numbered)
    raise ComposeError(f"{message} is a number in several protocols; add --protocol {names}")


def frame_of(
    composer: ProtocolComposer,
    message: str,
    pairs: Sequence[str],
    known: DeviceContext | None = None,
    present: Mapping[str, Any] = NOTHING,
) -> tuple[bytes, dict[str, Any]]:
    """The frame of a message and the values in it.

    Args:
        pairs: FIELD=VALUE.
        present: current values of the device, to complete vectors of which one element is named.

    Raises:
        ComposeError: invalid name or value.
    """
    known = known or DeviceContext()
    problem = None
    for command in composer.forms(message):
        try:
            values = parse(pairs, command.arguments, present)
        except ComposeError as error:
            problem = problem or error
            continue
        defaults = {field.name: field.default for field in command.arguments if field.default is not None}
        values = {**defaults, **values}
        try:
            return composer.driver.frame(command.name, values, known), values
        except EncodeError as error:
            problem = problem or ComposeError(f"{message}: {error}")
    if problem is not None:
        raise problem
    fields = composer.messages.get(message) or (composer.listed or {}).get(message, composer.messages.get(message))
    defaults = (
        {}
        if fields is not None
        else {one.name: one.default for one in composer.opaque_fields if one.default is not None}
    )
    values = {**defaults, **parse(pairs, composer.opaque_fields if fields is None else fields)}
    try:
        return composer.frame_of({"message": message, "fields": values}), values
    except EncodeError as error:
        raise ComposeError(f"{message}: {error}") from None


def names_elements(pairs: Sequence[str], fields: Sequence[Field]) -> bool:
    """Whether single elements of a vector are named, so that the device must supply the others.

    Raises:
        ComposeError: unknown field.
    """
    fields_of_paths = (_match(pair.partition("=")[0], fields) for pair in pairs)
    return any(rest and _is_vector(field) for field, rest in fields_of_paths)


def _is_vector(field: Field) -> bool:
    """Whether the field is a numeric list of fixed length."""
    return len(field.shape) == 1 and field.shape[0] > 0 and not field.fields and field.dtype not in ("ascii", "bytes")


def parse(pairs: Sequence[str], fields: Sequence[Field], present: Mapping[str, Any] = NOTHING) -> dict[str, Any]:
    """FIELD=VALUE pairs, in the units of the fields, as wire values by name.

    Args:
        present: current values of the device; a vector of which one element is named keeps the others.

    Raises:
        ComposeError: unknown field, invalid value or invalid path.
    """
    values: dict[str, Any] = {}
    for pair in pairs:
        path, equals, text = pair.partition("=")
        if not equals or not path:
            raise ComposeError(f"{pair!r} is not valid; write it as FIELD=VALUE")
        field, rest = _match(path, fields)
        if rest and _is_vector(field) and field.name not in values and field.name in present:
            values |= to_shown((field,), {field.name: list(present[field.name])})
        _put(values, field.name, field, rest, path, text)
    try:
        return to_wire(fields, values)
    except EncodeError as error:
        raise ComposeError(str(error)) from None


def _match(path: str, fields: Sequence[Field]) -> tuple[Field, list[str]]:
    """The field that a path begins with, and the rest of the path. Names may contain dots."""
    for field in sorted(fields, key=lambda one: len(one.name), reverse=True):
        if path == field.name or path.startswith(f"{field.name}."):
            return field, [part for part in path[len(field.name) + 1 :].split(".") if part]
    names = [field.name for field in fields]
    if not fields:
        raise ComposeError(f"unknown field {path!r}; this message has no fields")
    raise ComposeError(f"unknown field {path.split('.')[0]!r}; {nearest(path, names)}")


def _put(into: dict[str, Any], name: str, field: Field, rest: list[str], path: str, text: str) -> None:
    """Write a value at a path; a list can grow by one entry at a time."""
    if not rest:
        into[name] = value_of(text, field, path)
        return
    if not field.shape and not field.fields:
        raise ComposeError(f"{path}: {field.name} has no parts")
    if not field.shape:
        part, deeper = _match(".".join(rest), field.fields)
        _put(into.setdefault(name, {}), part.name, part, deeper, path, text)
        return
    if not rest[0].isdecimal():
        raise ComposeError(f"{path}: {field.name} is a list; its first entry is {field.name}.0")
    place, rows = int(rest[0]), into.setdefault(name, [])
    if _is_vector(field) and place >= field.shape[0]:
        raise ComposeError(f"{path}: {field.name} has {field.shape[0]} elements, the last is {field.shape[0] - 1}")
    if place > len(rows) and _is_vector(field):
        whole = ",".join("…" * field.shape[0])
        raise ComposeError(f"{path}: the other elements of {field.name} are unknown; give {field.name}=[{whole}]")
    if place > len(rows):
        raise ComposeError(f"{path}: {field.name} has {len(rows)} entries so far; the next is {field.name}.{len(rows)}")
    if place == len(rows):
        wire = {part.name: part.default for part in field.fields if part.default is not None}
        defaults = to_shown(field.fields, wire)
        rows.append(defaults if field.fields else 0)
    if rest[1:] and not field.fields:
        raise ComposeError(f"{path}: {field.name}.{place} has no parts")
    if not rest[1:]:
        rows[place] = value_of(text, replace(field, shape=()), path)
        return
    part, deeper = _match(".".join(rest[1:]), field.fields)
    _put(rows[place], part.name, part, deeper, path, text)


def value_of(text: str, field: Field, path: str) -> Any:
    """The wire value of a text.

    Raises:
        ComposeError: the text is not a valid value.
    """
    if field.dtype == "ascii":
        return text
    if field.dtype == "bytes":
        digits = text.removeprefix("0x").replace(" ", "")
        try:
            return bytes.fromhex(digits).hex()
        except ValueError:
            raise ComposeError(f"{path} must be hex, not {text!r}") from None
    if text[:1] == "[" and text[-1:] == "]" and _DEGREES_IN.search(text) and field.shape:
        return [_number(part.strip(), field, path) for part in text[1:-1].split(",")]
    if text[:1] in ("[", "{"):
        try:
            return _named(json.loads(text), field, path)
        except json.JSONDecodeError as error:
            raise ComposeError(f"{path} is not valid JSON: {error.msg}, at character {error.pos + 1}") from None
    if field.shape and not field.fields:
        return [_number(part.strip(), field, path) for part in text.split(",") if part.strip()]
    return _number(text, field, path)


def _named(value: Any, field: Field, path: str) -> Any:
    """A JSON value with names of choices replaced by their numbers."""
    if isinstance(value, list) and field.bits and not field.shape and all(isinstance(one, str) for one in value):
        return _number("|".join(value), field, path) if value else 0
    if isinstance(value, list):
        return [_named(one, field, path) for one in value]
    if isinstance(value, Mapping) and field.fields:
        parts = {part.name: part for part in field.fields}
        return {
            name: _named(one, parts[name], f"{path}.{name}") if name in parts else one for name, one in value.items()
        }
    if isinstance(value, str) and field.dtype not in ("ascii", "bytes"):
        return _number(value, field, path)
    return value


def _number(text: str, field: Field, path: str) -> int | float:
    """A number, or the number of a choice or of flags."""
    for read in (lambda word: int(word, 0), float):
        try:
            return read(text)
        except ValueError:
            continue
    degrees = _DEGREES.match(text)
    if degrees and field.unit.startswith("rad") and not field.unit.startswith("rad²"):
        return math.radians(float(degrees[1]))
    if degrees and field.unit.startswith("°"):
        return float(degrees[1])
    numbers = {meaning.casefold(): number for number, meaning in field.choices.items()}
    if text.casefold() in numbers:
        return numbers[text.casefold()]
    if text.casefold() in ("true", "false") and not numbers:
        return int(text.casefold() == "true")
    if field.bits:
        try:
            return word_of(text, field, path)
        except EncodeError as error:
            raise ComposeError(str(error)) from None
    if numbers:
        raise ComposeError(f"{path}: {text!r} is not an allowed value; {nearest(text, field.choices.values())}")
    raise ComposeError(f"{path} must be a number, not {text!r}")


# -- output of inspect -------------------------------------------------------------------------------------------------


def frames_of(
    lines: Iterable[str], all_composers: Mapping[str, ProtocolComposer], protocol: str = ""
) -> Iterator[bytes]:
    """One frame for each line that inspect printed, except rejects.

    Args:
        protocol: for lines that do not name one.

    Raises:
        ComposeError: an invalid line, with its number.
    """
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            record = json.loads(line)
            if not isinstance(record, dict):
                raise ComposeError("expected a JSON object")
            if protocol:
                record.setdefault("protocol", protocol)
            if "reject" not in record:
                yield frame_of_record(record, all_composers)
        except json.JSONDecodeError as error:
            raise ComposeError(f"line {number} is not valid JSON: {error.msg}") from None
        except (EncodeError, ComposeError) as error:
            raise ComposeError(f"line {number}: {error}") from None


def frame_of_record(record: FrameRecord, all_composers: Mapping[str, ProtocolComposer]) -> bytes:
    protocol = record.get("protocol")
    if protocol is None:
        raise ComposeError("the line has no protocol; give one with --protocol")
    strings = {name: make for one in all_composers.values() for name, make in one.strings.items()}
    if protocol in FOREIGN:
        return _foreign(record)
    if protocol in strings:
        return (strings[protocol] or _foreign)(record)
    composer = all_composers.get(str(protocol))
    if composer is None:
        raise ComposeError(
            f"unknown protocol {protocol!r}; available: {', '.join([*all_composers, *FOREIGN, *strings])}"
        )
    try:
        return composer.frame_of(record)
    except (EncodeError, ComposeError):
        raise
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        raise ComposeError(f"{record.get('message')}: {error}") from None


def _foreign(record: FrameRecord) -> bytes:
    """An embedded message (NMEA, UBX, RTCM): its own bytes."""
    wire = record.get("wire", {})
    line = wire.get("line")
    if not isinstance(line, str):
        raise ComposeError(f"a message of {record['protocol']} needs wire.line")
    if record["protocol"] in ("ubx", "rtcm3"):
        return bytes.fromhex(line)
    raw = line.encode("latin-1", "replace")
    ends = {0: b"", 1: b"\n", 2: b"\r\n"}
    return raw + ends.get(int(record.get("size", len(raw) + 2)) - len(raw), b"\r\n")
