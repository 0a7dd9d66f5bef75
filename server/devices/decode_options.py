"""Options for decoding the bytes of a source: information from the user that the bytes do not contain.

    --protocol idtp --key @robot.key --min-mode secure        on the command line, for all sources
    udp://:5000?protocol=idtp&key=00112233&min_mode=secure    in a source, for this source only
    {"source": …, "protocol": "idtp", "key": "00112233"}      over HTTP

Options in a source override the others. A key is a secret: it is removed from the source before any other code sees
it, it is never printed, and no answer, event or error message contains it.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote_plus

MODES = ("lite", "safety", "secure")
TIME_UNITS = ("ns", "us", "ms", "s")
ROTATIONS = ("enu_from_body", "body_from_enu")
OPTIONS = ("protocol", "key", "min_mode", "unverified", "time_unit", "rotation")
ON, OFF = ("1", "", "true", "yes", "on"), ("0", "false", "no", "off")


class ReadingError(ValueError):
    """An invalid option: its name and the allowed values. Never contains the key."""


@dataclass(frozen=True, slots=True)
class DecodeOptions:
    """Options that determine how a source is decoded.

    Args:
        protocol: "" to detect it.
        key: for Secure frames of IDTP.
        min_mode: weakest mode of IDTP that is accepted, 0 to 2; None: Secure with a key, else Lite.
        unverified: without a key, show Secure frames, marked as unverified.
        replay_check: whether frames with an old sequence number are rejected.
        schema: rows of the vendor's own payload types (protocols/idtp/custom_payloads.py).
        time_unit: unit of IDTP timestamps, of TIME_UNITS; "" for microseconds, unless arrival times contradict it.
        rotation: direction of the quaternion of an IDTP device, of ROTATIONS; "" for body to ENU.
    """

    protocol: str = ""
    key: bytes | None = field(default=None, repr=False)
    min_mode: int | None = None
    unverified: bool = False
    replay_check: bool = True
    schema: Mapping[int, Any] | None = field(default=None, repr=False)
    time_unit: str = ""
    rotation: str = ""

    def settings(self, known: Collection[str]) -> dict[str, Any]:
        """Settings passed to a protocol that supports them (registry.ProtocolInfo.settings)."""
        values = {
            "key": self.key,
            "min_mode": self.min_mode,
            "show_unverified": self.unverified,
            "replay_check": self.replay_check,
            "schema": self.schema,
            "time_unit": self.time_unit or None,
            "rotation": self.rotation or None,
        }
        return {name: value for name, value in values.items() if name in known and value is not None}


def reading(
    protocol: str = "",
    key: str = "",
    min_mode: str = "",
    unverified: bool = False,
    schema: str = "",
    replay_check: bool = True,
    time_unit: str = "",
    rotation: str = "",
) -> DecodeOptions:
    """Decode options from texts.

    Args:
        key: hex, "" for none.
        min_mode: of MODES, or "".
        schema: text of the schema, "" for none.

    Raises:
        ReadingError: an option is invalid.
    """
    secret = _key(key) if key else None
    units = (_one_of("time_unit", time_unit, TIME_UNITS), _one_of("rotation", rotation, ROTATIONS))
    return DecodeOptions(protocol, secret, _mode(min_mode), unverified, replay_check, _schema(schema), *units)


def changed(old: DecodeOptions, new: DecodeOptions, given: Collection[str]) -> DecodeOptions:
    """`old` with the options of `new` that are in `given`: names of OPTIONS, and "schema_text".

    Schemas of vendor types are added to the existing ones; one of the same type replaces it.
    """
    changes = {name: getattr(new, name) for name in OPTIONS if name in given}
    if "schema_text" in given:
        changes["schema"] = {**(old.schema or {}), **(new.schema or {})} or None
    return replace(old, **changes)


def to_text_options(options: DecodeOptions) -> dict[str, Any]:
    """The inverse of `reading`, for another process; without the protocol, which each file has for itself."""
    return {
        "key": options.key.hex() if options.key else "",
        "min_mode": "" if options.min_mode is None else MODES[options.min_mode],
        "unverified": options.unverified,
        "schema": schema_words(options.schema),
        "time_unit": options.time_unit,
        "rotation": options.rotation,
    }


def schema_words(schema: Mapping[int, Any] | None) -> str:
    """The schema (TOML) of these rows, "" for none."""
    if not schema:
        return ""
    from protocols.registry import PROTOCOLS  # imported on first use, because it loads compiled code

    write = next((write for family in PROTOCOLS.values() if (write := family.write_schema) is not None), None)
    return write(schema) if write is not None else ""


def recorded(options: DecodeOptions, about: Mapping[str, Any], usual: DecodeOptions) -> DecodeOptions:
    """Decode options of a recorded device: given for the file, else stored in the recording, else the server's own.

    Args:
        about: the recording's information on the device; anything but options is ignored.
        usual: the server's options for its own sources.
    """
    values = {name: about.get(name, "") for name in ("time_unit", "rotation", "schema")}
    try:
        stored = reading(
            time_unit=str(values["time_unit"]), rotation=str(values["rotation"]), schema=str(values["schema"])
        )
    except ReadingError:
        stored = DecodeOptions()
    schema = {**(usual.schema or {}), **(stored.schema or {}), **(options.schema or {})}
    return replace(
        options,
        key=options.key or usual.key,
        min_mode=usual.min_mode if options.min_mode is None else options.min_mode,
        unverified=options.unverified or usual.unverified,
        schema=schema or None,
        time_unit=options.time_unit or stored.time_unit or usual.time_unit,
        rotation=options.rotation or stored.rotation or usual.rotation,
    )


def key_text(given: str) -> str:
    """The hex digits of a key that is given directly, or as @FILE.

    Raises:
        ReadingError: the key is empty, or the file cannot be read or is empty.
    """
    if not given:
        raise ReadingError("an empty key is not valid: give an even number of hex digits, or @FILE containing them")
    if not given.startswith("@"):
        return given
    try:
        text = Path(given[1:]).expanduser().read_text(encoding="ascii").strip()
    except OSError as error:
        raise ReadingError(f"the key cannot be read from {given[1:]}: {error.strerror}") from None
    except UnicodeDecodeError:
        text = ""
    if not text:
        raise ReadingError(f"{given[1:]} contains no key: it must contain hex digits")
    return text


def schema_text(path: str) -> str:
    """Text of a schema file.

    Raises:
        ReadingError: it cannot be read.
    """
    try:
        return Path(path).expanduser().read_text(encoding="utf-8")
    except OSError as error:
        raise ReadingError(f"the schema cannot be read from {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ReadingError(f"{path} is not a text file") from None


def parse_source_options(source: str, given: DecodeOptions) -> tuple[str, DecodeOptions]:
    """A source without its decode options, and `given` overridden by these options.

    Raises:
        ReadingError: invalid value.
    """
    if "?" not in source or os.path.exists(source):
        return source, given
    place, _, query = source.partition("?")
    rest = []
    for part in query.split("&"):
        name, _, value = part.partition("=")
        value = unquote_plus(value)
        match name:
            case "protocol":
                given = replace(given, protocol="" if value == "auto" else value)
            case "key":
                given = replace(given, key=_key(value))
            case "min_mode":
                given = replace(given, min_mode=_mode(value))
            case "time_unit":
                given = replace(given, time_unit=_one_of(name, value, TIME_UNITS))
            case "rotation":
                given = replace(given, rotation=_one_of(name, value, ROTATIONS))
            case "unverified":
                if value not in ON + OFF:
                    raise ReadingError("unverified must be 1 or 0")
                given = replace(given, unverified=value in ON)
            case _:
                rest.append(part)
    return f"{place}?{'&'.join(rest)}" if rest else place, given


def _key(text: str) -> bytes:
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b""
    if not key:
        raise ReadingError("a key must be an even number of hex digits, at least two")
    return key


def _mode(text: str) -> int | None:
    if not text:
        return None
    return MODES.index(_one_of("min_mode", text, MODES))


def _one_of(name: str, text: str, known: tuple[str, ...]) -> str:
    if text and text not in known:
        raise ReadingError(f"{name} is {text!r:.40}, not one of {', '.join(known)}")
    return text


def _schema(text: str) -> Mapping[int, Any] | None:
    if not text.strip():
        return None
    from protocols.registry import PROTOCOLS  # imported on first use, because it loads compiled code

    parse = next((parse for family in PROTOCOLS.values() if (parse := family.parse_schema) is not None), None)
    if parse is None:
        raise ReadingError("no available protocol uses a schema")
    try:
        return parse(text)
    except ValueError as error:
        raise ReadingError(f"the schema cannot be used: {error!s:.300}") from None
