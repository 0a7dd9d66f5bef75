"""From words to a frame: `imuscope compose`, and what `imuscope send` sends.

    imuscope compose SET_DID_FLASH_CONFIG startupNavDtMs=16        ──>  ef49250c06001000100000008f05
    imuscope compose SetOutputConfiguration outputs.0.data_identifier=0x1020 outputs.0.output_frequency=100
    imuscope inspect FILE --format jsonl | imuscope compose --jsonl -        the frames again, one hex line each

FIELD=VALUE:   400   0x400F   -1.5   a name of a choice (GROUND_VEHICLE)   names of flags (DisableAutoStore|EnableAhs)
               an angle in degrees where the unit is rad (90deg, [0,0,90°])
               a group of bits and its value (GPS1_SOURCE=SER1|GPS1_TYPE=GPX; protocols/flag_words.py)
               a list or record as JSON ([1, 2, 3])   hex digits of opaque bytes   text
               a path into lists and records (outputs.0.output_frequency=400); lists grow as their places are named;
               of a vector one element (gps1AntOffset.1=0.3) where a device is asked for the others, as `send` does

A message is a command of a protocol, with what it is usually sent with filled in; or any message that `imuscope
inspect` names, as it stands. Whose it is is found by its name. What is not known is answered with the nearest names.

Lines of JSON are read one at a time and their frames written at once, so that the size of a file does not matter.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from protocols.flag_words import nearest, word_of
from protocols.idtp import json_codec as idtp_plain
from protocols.idtp import messages as idtp_messages
from protocols.idtp.commands import DATA, HEADER, reading_fields
from protocols.idtp.driver import IdtpDriver
from protocols.isb import json_codec as isb_plain
from protocols.isb import messages as isb_messages
from protocols.layouts import EncodeError
from protocols.registry import PROTOCOLS
from protocols.schema import Command, Field
from protocols.transactions import DeviceContext, DeviceDriver
from protocols.xbus import data_identifiers as xbus_items
from protocols.xbus import json_codec as xbus_plain
from protocols.xbus import messages as xbus_messages
from protocols.xbus.binary_strings import EM1000, EM1000_HEAD
from server.devices.decode_options import DecodeOptions

FrameRecord = Mapping[str, Any]
NOTHING: FrameRecord = {}
_NUMBER = re.compile(r"0x[0-9A-Fa-f]{1,2}")
_DEGREES = re.compile(r"([-+]?[\d.]+(?:e[-+]?\d+)?)\s*(?:°|deg)(?:/s)?\Z", re.IGNORECASE)
_DEGREES_IN = re.compile(r"\d\s*(°|deg)", re.IGNORECASE)
FOREIGN = ("nmea", "ubx", "rtcm3", "tss2", "em1000")
"""Messages that pass through any port; they are kept as they came."""


class ComposeError(ValueError):
    """What cannot be composed, in one sentence."""


@dataclass(frozen=True, slots=True)
class ProtocolComposer:
    """What composing needs of a protocol.

    Args:
        driver: its commands.
        messages: every other message that inspect names → its fields.
        frame_of: the frame of a record, as its json_codec.py specifies them.
        opaque: fields of a message that is only a number ("0x80").
        numbered: whether a message may be called by its mere number.
        listed: fields of messages that inspect may print with others than those: in another form, items of MTData2.
    """

    name: str
    driver: DeviceDriver
    messages: Mapping[str, tuple[Field, ...]]
    frame_of: Callable[[FrameRecord], bytes]
    opaque: tuple[Field, ...] = (DATA,)
    numbered: bool = True
    listed: Mapping[str, tuple[Field, ...]] | None = None

    def command(self, name: str) -> Command | None:
        """A command by name; the $ of a sentence may be left out."""
        commands = {row.name: row for row in self.driver.commands(DeviceContext())}
        return commands.get(name) or commands.get(name.removeprefix("$"))

    def forms(self, name: str) -> list[Command]:
        """A command in each of its forms: of one name, told apart by what stands in brackets behind it."""
        first = self.command(name)
        rows = self.driver.commands(DeviceContext())
        return [first, *(row for row in rows if row.name.startswith(f"{first.name} ("))] if first else []

    def names(self) -> list[str]:
        """Everything that it can compose."""
        return [*(row.name for row in self.driver.commands(DeviceContext())), *self.messages]


def composers(key: bytes | None = None, schema: Mapping[int, Any] | None = None) -> dict[str, ProtocolComposer]:
    """All protocols, by name.

    Args:
        key: for Secure frames of IDTP.
        schema: the vendor's own payload types, see protocols/idtp/custom_payloads.py.
    """
    xbus = {name: rows[0].fields for name, rows in xbus_messages.BY_NAME.items()}
    isb = {name: row.fields for name, row in isb_messages.BY_NAME.items()}
    isb |= {row.name: row.fields for row in map(isb_messages.set_row, range(256))}
    isb |= {row.name: row.fields for row in isb_messages.COMMANDS.values()}
    rows = {**{row.name: row for row in idtp_messages.MESSAGES}, **{r.name: r for r in (schema or {}).values()}}
    idtp = {name: (*HEADER, *reading_fields(row)) for name, row in rows.items()}

    def idtp_frame(record: FrameRecord) -> bytes:
        return idtp_plain.frame_from_json(record, key, schema)

    forms = {name: tuple(part for row in rows for part in row.fields) for name, rows in xbus_messages.BY_NAME.items()}
    forms["MTData2"] = tuple(xbus_items.BY_NAME.values())
    drivers = {name: row.driver for name, row in PROTOCOLS.items() if row.driver is not None}
    made = (
        ProtocolComposer("xbus", drivers["xbus"], xbus, xbus_plain.frame_from_json, listed=forms),
        ProtocolComposer("isb", drivers["isb"], isb, isb_plain.frame_from_json, numbered=False),
        ProtocolComposer("idtp", IdtpDriver(schema), idtp, idtp_frame, (*HEADER, DATA)),
    )
    return {one.name: one for one in made}


def known_of(reading: DecodeOptions) -> DeviceContext:
    """What is known of a device that is not there: the key."""
    return DeviceContext(key=reading.key)


# -- one message, in words ---------------------------------------------------------------------------------------------


def chosen(
    all_tongues: Mapping[str, ProtocolComposer], message: str, protocol: str = "", pairs: Sequence[str] = ()
) -> ProtocolComposer:
    """Whose message this is.

    Args:
        pairs: FIELD=VALUE, by whose fields a mere number is told apart.
    Raises:
        ComposeError: nobody's, or somebody else's; with the nearest names.
    """
    if protocol and protocol not in all_tongues:
        raise ComposeError(f"there is no protocol {protocol!r}; there are: {', '.join(all_tongues)}.")
    among = [all_tongues[protocol]] if protocol else list(all_tongues.values())
    bare = message.removeprefix("$")
    for tongue in among:
        if message in tongue.messages or tongue.command(message) or bare in tongue.messages:
            return tongue
    if protocol and message.startswith("0x"):
        return among[0]
    if _NUMBER.fullmatch(message) and not protocol:
        return _numbered(among, message, pairs)
    names = {name: None for tongue in among for name in tongue.names()}
    where = f" of {PROTOCOLS[protocol].title}" if protocol else ""
    raise ComposeError(f"no message{where} is called {message!r}; {nearest(message, list(names))}")


def _numbered(among: Sequence[ProtocolComposer], message: str, pairs: Sequence[str]) -> ProtocolComposer:
    """Whose message of a mere number it is: that of the only protocol which has such messages with these fields.

    Raises:
        ComposeError: several have.
    """
    given = {pair.partition("=")[0] for pair in pairs}
    able = [one for one in among if one.numbered and given <= {field.name for field in one.opaque}]
    if len(able) == 1:
        return able[0]
    names = " or ".join(one.name for one in among if one.numbered)
    raise ComposeError(f"{message} is a number in several protocols; add --protocol {names}")


def frame_of(
    tongue: ProtocolComposer,
    message: str,
    pairs: Sequence[str],
    known: DeviceContext | None = None,
    present: Mapping[str, Any] = NOTHING,
) -> tuple[bytes, dict[str, Any]]:
    """The frame of a message and the values that went into it.

    Args:
        pairs: FIELD=VALUE.
        present: what the device has, for vectors of which one element is named.
    Raises:
        ComposeError: a name or value that cannot be used.
    """
    known = known or DeviceContext()
    problem = None
    for command in tongue.forms(message):
        try:
            values = parse(pairs, command.arguments, present)
        except ComposeError as error:
            problem = problem or error
            continue
        usual = {field.name: field.default for field in command.arguments if field.default is not None}
        values = {**usual, **values}
        try:
            return tongue.driver.frame(command.name, values, known), values
        except EncodeError as error:
            problem = problem or ComposeError(f"{message}: {error}")
    if problem is not None:
        raise problem
    fields = tongue.messages.get(message)
    usual = {} if fields is not None else {one.name: one.default for one in tongue.opaque if one.default is not None}
    values = {**usual, **parse(pairs, tongue.opaque if fields is None else fields)}
    try:
        return tongue.frame_of({"message": message, "fields": values}), values
    except EncodeError as error:
        raise ComposeError(f"{message}: {error}") from None


def names_elements(pairs: Sequence[str], fields: Sequence[Field]) -> bool:
    """Is an element of a vector named, whose others the device has to tell?

    Raises:
        ComposeError: no field of that name.
    """
    found = (_found(pair.partition("=")[0], fields) for pair in pairs)
    return any(rest and _is_vector(field) for field, rest in found)


def _is_vector(field: Field) -> bool:
    """Is it a list of fixed length, of numbers?"""
    return len(field.shape) == 1 and field.shape[0] > 0 and not field.fields and field.dtype not in ("ascii", "bytes")


def parse(pairs: Sequence[str], fields: Sequence[Field], present: Mapping[str, Any] = NOTHING) -> dict[str, Any]:
    """FIELD=VALUE pairs as values by name.

    Args:
        present: what the device has: a vector of which one element is named keeps the others.
    Raises:
        ComposeError: no field of that name, a value that is none, a path that leads nowhere.
    """
    values: dict[str, Any] = {}
    for pair in pairs:
        path, equals, text = pair.partition("=")
        if not equals or not path:
            raise ComposeError(f"{pair!r} is not valid; write it as FIELD=VALUE")
        field, rest = _found(path, fields)
        if rest and _is_vector(field) and field.name not in values and field.name in present:
            values[field.name] = list(present[field.name])
        _put(values, field.name, field, rest, path, text)
    return values


def _found(path: str, fields: Sequence[Field]) -> tuple[Field, list[str]]:
    """The field that a path begins with, and what follows: names may have points of their own."""
    for field in sorted(fields, key=lambda one: len(one.name), reverse=True):
        if path == field.name or path.startswith(f"{field.name}."):
            return field, [part for part in path[len(field.name) + 1 :].split(".") if part]
    names = [field.name for field in fields]
    if not fields:
        raise ComposeError(f"there is no field {path!r}; this message has none")
    raise ComposeError(f"there is no field {path.split('.')[0]!r}; {nearest(path, names)}")


def _put(into: dict[str, Any], name: str, field: Field, rest: list[str], path: str, text: str) -> None:
    """Write a value where a path leads; lists grow as far as the next place."""
    if not rest:
        into[name] = value_of(text, field, path)
        return
    if not field.shape and not field.fields:
        raise ComposeError(f"{path}: {field.name} has no parts")
    if not field.shape:
        part, deeper = _found(".".join(rest), field.fields)
        _put(into.setdefault(name, {}), part.name, part, deeper, path, text)
        return
    if not rest[0].isdecimal():
        raise ComposeError(f"{path}: {field.name} is a list: {field.name}.0 is its first")
    place, rows = int(rest[0]), into.setdefault(name, [])
    if _is_vector(field) and place >= field.shape[0]:
        raise ComposeError(f"{path}: {field.name} has {field.shape[0]} elements, the last is {field.shape[0] - 1}")
    if place > len(rows) and _is_vector(field):
        whole = ",".join("…" * field.shape[0])
        raise ComposeError(f"{path}: what else is in {field.name} is not known here; give {field.name}=[{whole}]")
    if place > len(rows):
        raise ComposeError(f"{path}: {field.name} has {len(rows)} entries so far; the next is {field.name}.{len(rows)}")
    if place == len(rows):
        usual = {part.name: part.default for part in field.fields if part.default is not None}
        rows.append(usual if field.fields else 0)
    if not field.fields:
        if rest[1:]:
            raise ComposeError(f"{path}: {field.name}.{place} has no parts")
        rows[place] = value_of(text, _one(field), path)
        return
    if not rest[1:]:
        rows[place] = value_of(text, _one(field), path)
        return
    part, deeper = _found(".".join(rest[1:]), field.fields)
    _put(rows[place], part.name, part, deeper, path, text)


def _one(field: Field) -> Field:
    """One element of a list."""
    return replace(field, shape=())


def value_of(text: str, field: Field, path: str) -> Any:
    """A value in words as a wire value.

    Raises:
        ComposeError: it is none.
    """
    if field.dtype == "ascii":
        return text
    if field.dtype == "bytes":
        digits = text.removeprefix("0x").replace(" ", "")
        try:
            return bytes.fromhex(digits).hex()
        except ValueError:
            raise ComposeError(f"{path} is hex, given {text!r}") from None
    if text[:1] == "[" and text[-1:] == "]" and _DEGREES_IN.search(text) and field.shape:
        return [_number(part.strip(), field, path) for part in text[1:-1].split(",")]
    if text[:1] in ("[", "{"):
        try:
            return _named(json.loads(text), field, path)
        except json.JSONDecodeError as error:
            raise ComposeError(f"{path} is no JSON: {error.msg}, at character {error.pos + 1}") from None
    if field.shape and not field.fields:
        return [_number(part.strip(), field, path) for part in text.split(",") if part.strip()]
    return _number(text, field, path)


def _named(value: Any, field: Field, path: str) -> Any:
    """A value of JSON with the names of choices in it made numbers."""
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
    """A number, or what a choice or flags stand for."""
    for read in (lambda word: int(word, 0), float):
        try:
            return read(text)
        except ValueError:
            continue
    turned = _DEGREES.match(text)
    if turned and field.unit.startswith("rad") and not field.unit.startswith("rad²"):
        return math.radians(float(turned[1]))
    words = {meaning.casefold(): number for number, meaning in field.choices.items()}
    if text.casefold() in words:
        return words[text.casefold()]
    if text.casefold() in ("true", "false") and not words:
        return int(text.casefold() == "true")
    if field.bits:
        try:
            return word_of(text, field, path)
        except EncodeError as error:
            raise ComposeError(str(error)) from None
    if words:
        raise ComposeError(f"{path} is none of its choices, given {text!r}; {nearest(text, field.choices.values())}")
    raise ComposeError(f"{path} is a number, given {text!r}")


# -- what inspect printed ----------------------------------------------------------------------------------------------


def frames_of(lines: Iterable[str], all_tongues: Mapping[str, ProtocolComposer], protocol: str = "") -> Iterator[bytes]:
    """One frame for each line that inspect printed; rejects have none.

    Args:
        protocol: of lines that name none.

    Raises:
        ComposeError: a line that is none of inspect's, with its number.
    """
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            record = json.loads(line)
            if not isinstance(record, dict):
                raise ComposeError("it is no object")
            if protocol:
                record.setdefault("protocol", protocol)
            if "reject" not in record:
                yield frame_of_record(record, all_tongues)
        except json.JSONDecodeError as error:
            raise ComposeError(f"line {number} is no JSON: {error.msg}") from None
        except (EncodeError, ComposeError) as error:
            raise ComposeError(f"line {number}: {error}") from None


def frame_of_record(record: FrameRecord, all_tongues: Mapping[str, ProtocolComposer]) -> bytes:
    """The frame of one line."""
    protocol = record.get("protocol")
    if protocol is None:
        raise ComposeError("it names no protocol; give one with --protocol")
    if protocol in FOREIGN:
        return _foreign(record)
    tongue = all_tongues.get(str(protocol))
    if tongue is None:
        raise ComposeError(f"there is no protocol {protocol!r}; there are: {', '.join([*all_tongues, *FOREIGN])}")
    try:
        return tongue.frame_of(record)
    except (EncodeError, ComposeError):
        raise
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        raise ComposeError(f"{record.get('message')}: {error}") from None


def _foreign(record: FrameRecord) -> bytes:
    """A message that only passed through: its own bytes."""
    wire, fields = record.get("wire", {}), record.get("fields", {})
    line = wire.get("line")
    if record["protocol"] == "em1000":
        angles = (round(fields[name] * 100) for name in ("roll", "pitch", "heave", "heading"))
        return EM1000_HEAD + EM1000.pack(*angles)[len(EM1000_HEAD) :]
    if not isinstance(line, str):
        raise ComposeError(f"a message of {record['protocol']} needs wire.line")
    if record["protocol"] in ("ubx", "rtcm3"):
        return bytes.fromhex(line)
    raw = line.encode("latin-1", "replace")
    ends = {0: b"", 1: b"\n", 2: b"\r\n"}
    return raw + ends.get(int(record.get("size", len(raw) + 2)) - len(raw), b"\r\n")
