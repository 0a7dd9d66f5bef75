"""Decode options of a source: the protocol, and those of the families (protocols/family/decode_options.py).

    --protocol NAME --key @robot.key                          on the command line, for all sources
    udp://:5000?protocol=NAME&key=00112233                    in a source, for this source only
    {"source": …, "protocol": NAME, "key": "00112233"}        over HTTP

Options in a source override the others. A secret is removed from the source before any other code sees it, it is never
printed, and no answer, event or error message contains it.
"""

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote_plus

from imuscope.protocols.family.decode_options import DecodeOption
from imuscope.recordings.tables.options import AxisClock, TableOptions

PROTOCOL = "protocol"


class DecodeOptionError(ValueError):
    """An invalid option: its name and the allowed values. Never contains a secret."""


@dataclass(frozen=True, slots=True)
class DecodeOptions:
    """Options that determine how a source is decoded.

    Args:
        protocol: "" to detect it.
        values: name → text of each given option, in its usual notation; see `checked_options`.
        table: options of a file that is a table.
        clock: of devices, that is the time axis; "": as chosen for the file.
    """

    protocol: str = ""
    values: Mapping[str, str] = field(default_factory=dict, repr=False, hash=False)
    table: TableOptions = TableOptions()  # noqa: RUF009 - frozen
    clock: AxisClock = ""

    def settings(self, protocol: str) -> dict[str, Any]:
        """Settings of the decoder of a protocol; options of other protocols are left out."""
        from imuscope.protocols.registry.families import (
            PROTOCOLS,  # imported on first use: the command line starts without it
        )

        family = PROTOCOLS.get(protocol)
        return family.settings(self.values) if family is not None and self.values else {}

    def replaced(self, values: Mapping[str, str], protocol: str | None = None) -> "DecodeOptions":
        """These options with others in their place; "" removes one."""
        texts = {**self.values, **values}
        values = {name: text for name, text in texts.items() if text}
        return replace(self, protocol=self.protocol if protocol is None else protocol, values=values)

    @property
    def secrets(self) -> dict[str, str]:
        """Keys of encrypted protocols and other values that no client may read."""
        return {name: text for name, text in self._declared() if _option(name).kind == "secret"}

    @property
    def shown(self) -> dict[str, str]:
        """Those that the page may show: neither secrets nor whole files."""
        return {name: text for name, text in self._declared() if _option(name).kind not in ("secret", "file")}

    @property
    def recorded(self) -> dict[str, str]:
        """Those that are properties of the device and stored in its recordings."""
        return {name: text for name, text in self._declared() if _option(name).recorded}

    def _declared(self) -> list[tuple[str, str]]:
        return [(name, text) for name, text in self.values.items() if name in declared_options()] if self.values else []


def declared_options() -> Mapping[str, DecodeOption]:
    """The options of all protocol families, by name."""
    from imuscope.protocols.registry.families import (
        decode_options,  # imported on first use: the command line starts without it
    )

    return decode_options()


def _option(name: str) -> DecodeOption:
    return declared_options()[name]


def source_options() -> list[DecodeOption]:
    return [option for option in declared_options().values() if "source" in option.scopes]


def url_options() -> list[str]:
    """Names of the options that a source can contain."""
    from imuscope.protocols.registry.families import url_options

    return url_options()


def checked_options(protocol: str = "", texts: Mapping[str, str] | None = None) -> DecodeOptions:
    """Decode options from texts; "" for one that is not given, and the content of files.

    Raises:
        DecodeOptionError: an option is invalid.
    """
    return DecodeOptions(protocol).replaced(
        {name: _checked(name, text) for name, text in (texts or {}).items() if text}
    )


def changed(old: DecodeOptions, new: DecodeOptions, names: Collection[str]) -> DecodeOptions:
    """`old` with the options of `new` that are in `names`: names, and "protocol".

    Descriptions of a vendor's own messages are added to the existing ones.
    """
    values = {name: _merged(name, old, new) for name in names if name != PROTOCOL}
    return old.replaced(values, new.protocol if PROTOCOL in names else None)


def recorded(options: DecodeOptions, about: Mapping[str, Any], usual: DecodeOptions) -> DecodeOptions:
    """Decode options of a recorded device: given for the file, else stored in the recording, else the server's own.

    Args:
        about: the recording's information on the device; anything but options is ignored.
        usual: the server's options for its own sources.
    """
    texts = {option.name: str(about.get(option.name, "")) for option in source_options() if option.recorded}
    try:
        stored = checked_options("", texts)
    except DecodeOptionError:
        stored = DecodeOptions()
    made = DecodeOptions(options.protocol, usual.values)
    for more in (stored, options):
        made = changed(made, more, more.values.keys())
    return made


def secret_text(secret: str, name: str = "key") -> str:
    """A secret that is given directly, or as @FILE.

    Raises:
        DecodeOptionError: the secret is empty, or the file cannot be read or is empty.
    """
    if not secret:
        raise DecodeOptionError(f"an empty {name} is not valid: give the {name}, or @FILE containing it")
    if not secret.startswith("@"):
        return secret
    try:
        text = Path(secret[1:]).expanduser().read_text(encoding="ascii").strip()
    except OSError as error:
        raise DecodeOptionError(f"the {name} cannot be read from {secret[1:]}: {error.strerror}") from None
    except UnicodeDecodeError:
        text = ""
    if not text:
        raise DecodeOptionError(f"{secret[1:]} contains no {name}: it must contain its characters and nothing else")
    return text


def file_text(path: str, name: str) -> str:
    """Text of a file that an option names.

    Raises:
        DecodeOptionError: it cannot be read.
    """
    try:
        return Path(path).expanduser().read_text(encoding="utf-8")
    except OSError as error:
        raise DecodeOptionError(f"the {name} cannot be read from {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise DecodeOptionError(f"{path} is not a text file") from None


def option_text(option: DecodeOption, value: str | bool) -> str:
    """Text of an option as written on the command line or in the settings: secrets and files may be in a file.

    Raises:
        DecodeOptionError: the file cannot be read.
    """
    if isinstance(value, bool):
        return "1" if value else ""
    if option.kind == "secret":
        return secret_text(value, option.name)
    return file_text(value, option.name) if option.kind == "file" and value else value


def parse_source_options(source: str, defaults: DecodeOptions) -> tuple[str, DecodeOptions]:
    """A source without its decode options, and `defaults` overridden by these options.

    Raises:
        DecodeOptionError: invalid value.
    """
    if "?" not in source or os.path.exists(source):
        return source, defaults
    place, _, query = source.partition("?")
    names = url_options()
    rest = []
    for part in query.split("&"):
        name, _, value = part.partition("=")
        value = unquote_plus(value)
        if name == PROTOCOL:
            defaults = defaults.replaced({}, "" if value == "auto" else value)
        elif name in names:
            defaults = defaults.replaced({name: _checked(name, value)})
        else:
            rest.append(part)
    return f"{place}?{'&'.join(rest)}" if rest else place, defaults


def _checked(name: str, text: str) -> str:
    option = _option(name)
    try:
        checked = option.checked(text)
        if option.kind == "secret" and not checked:
            option.read(text)  # an empty one is not secret
    except ValueError as error:
        raise DecodeOptionError(str(error)) from None
    return checked


def _merged(name: str, old: DecodeOptions, new: DecodeOptions) -> str:
    before, after = old.values.get(name, ""), new.values.get(name, "")
    merge = _option(name).merge
    return merge(before, after) if merge is not None and before and after else after or (before if merge else "")
