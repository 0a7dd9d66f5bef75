"""How should the bytes of a source be read? What a person says about it, because the bytes cannot.

    --protocol idtp --key @robot.key --min-mode secure        on the command line, for all its sources
    udp://:5000?protocol=idtp&key=00112233&min_mode=secure    in a source, for this one alone
    {"source": …, "protocol": "idtp", "key": "00112233"}      over HTTP

What a source says of itself comes before what was said beside it. A key is a secret: it is taken out of the source
before anything else sees that, is never printed, and no answer or event holds it; what is wrong with one is said
without it.
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
    """Something that cannot be used: which setting, and what is allowed. Never the key itself."""


@dataclass(frozen=True, slots=True)
class DecodeOptions:
    """What was said about a source.

    Args:
        protocol: "" to recognise it.
        key: for Secure frames of IDTP.
        min_mode: weakest mode of IDTP that is accepted, 0 to 2; None: Secure with a key, else Lite.
        unverified: without a key, show Secure frames, marked.
        replay_check: whether frames with an old sequence number are refused.
        schema: rows of the vendor's own payload types (protocols/idtp/custom_payloads.py).
        time_unit: of the timestamps of IDTP, of TIME_UNITS; "" for microseconds, unless their arrival says otherwise.
        rotation: which way the quaternion of an IDTP device turns, of ROTATIONS; "" for body to ENU.
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
        """What a protocol that knows these settings is told (registry.ProtocolInfo.settings)."""
        told = {
            "key": self.key,
            "min_mode": self.min_mode,
            "show_unverified": self.unverified,
            "replay_check": self.replay_check,
            "schema": self.schema,
            "time_unit": self.time_unit or None,
            "rotation": self.rotation or None,
        }
        return {name: value for name, value in told.items() if name in known and value is not None}


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
    """A Reading of words.

    Args:
        key: hex, "" for none.
        min_mode: of MODES, or "".
        schema: the text of the description, "" for none.
    Raises:
        ReadingError: one of them cannot be used.
    """
    secret = _key(key) if key else None
    units = (_one_of("time_unit", time_unit, TIME_UNITS), _one_of("rotation", rotation, ROTATIONS))
    return DecodeOptions(protocol, secret, _mode(min_mode), unverified, replay_check, _schema(schema), *units)


def changed(old: DecodeOptions, new: DecodeOptions, given: Collection[str]) -> DecodeOptions:
    """`old` with those settings of `new` that were given: OPTIONS, and "schema_text".

    Descriptions of vendor types are added to those that there are; one of the same type takes its place.
    """
    changes = {name: getattr(new, name) for name in OPTIONS if name in given}
    if "schema_text" in given:
        changes["schema"] = {**(old.schema or {}), **(new.schema or {})} or None
    return replace(old, **changes)


def words_of(said: DecodeOptions) -> dict[str, Any]:
    """What `reading` makes the same of: for another process. Not the protocol, which each file has for itself."""
    return {
        "key": said.key.hex() if said.key else "",
        "min_mode": "" if said.min_mode is None else MODES[said.min_mode],
        "unverified": said.unverified,
        "schema": schema_words(said.schema),
        "time_unit": said.time_unit,
        "rotation": said.rotation,
    }


def schema_words(schema: Mapping[int, Any] | None) -> str:
    """The description (TOML) of these rows, "" for none."""
    if not schema:
        return ""
    from protocols.idtp.custom_payloads import written

    return written(schema)


def recorded(said: DecodeOptions, about: Mapping[str, Any], usual: DecodeOptions) -> DecodeOptions:
    """How a recorded device is read: as a person says of the file, else as the recording says, else as is usual here.

    Args:
        about: what the recording tells of the device; what is no setting in it is left out.
        usual: what the server was told of its own sources.
    """
    told = {name: about.get(name, "") for name in ("time_unit", "rotation", "schema")}
    try:
        kept = reading(time_unit=str(told["time_unit"]), rotation=str(told["rotation"]), schema=str(told["schema"]))
    except ReadingError:
        kept = DecodeOptions()
    schema = {**(usual.schema or {}), **(kept.schema or {}), **(said.schema or {})}
    return replace(
        said,
        key=said.key or usual.key,
        min_mode=usual.min_mode if said.min_mode is None else said.min_mode,
        unverified=said.unverified or usual.unverified,
        schema=schema or None,
        time_unit=said.time_unit or kept.time_unit or usual.time_unit,
        rotation=said.rotation or kept.rotation or usual.rotation,
    )


def key_text(given: str) -> str:
    """The hex digits of a key that is given as such, or as @FILE.

    Raises:
        ReadingError: nothing is given, there is no such file, or it holds no text.
    """
    if not given:
        raise ReadingError("an empty key is no key: an even number of hex digits, or @FILE that holds them")
    if not given.startswith("@"):
        return given
    try:
        text = Path(given[1:]).expanduser().read_text(encoding="ascii").strip()
    except OSError as error:
        raise ReadingError(f"the key cannot be read from {given[1:]}: {error.strerror}") from None
    except UnicodeDecodeError:
        text = ""
    if not text:
        raise ReadingError(f"{given[1:]} holds no key: it must hold hex digits")
    return text


def schema_text(path: str) -> str:
    """What a file with descriptions of vendor types says.

    Raises:
        ReadingError: it cannot be read.
    """
    try:
        return Path(path).expanduser().read_text(encoding="utf-8")
    except OSError as error:
        raise ReadingError(f"the schema cannot be read from {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ReadingError(f"{path} is no text") from None


def parse_source_options(source: str, given: DecodeOptions) -> tuple[str, DecodeOptions]:
    """A source without what it says about its reading, and that put over `given`.

    Raises:
        ReadingError: a value that cannot be used.
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
                    raise ReadingError("unverified is 1 or 0")
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
        raise ReadingError("a key is an even number of hex digits, at least two")
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
    from protocols.idtp.custom_payloads import SchemaError, parse  # when first used: its tables load what is compiled

    try:
        return parse(text)
    except SchemaError as error:
        raise ReadingError(f"the schema cannot be used: {error!s:.300}") from None
