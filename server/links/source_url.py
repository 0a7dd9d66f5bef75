"""Grammar of source addresses. This docstring is the grammar; `SourceUrl` parses it.

    /dev/ttyUSB0                                a serial port; the rate is detected
    /dev/ttyUSB0?baud=921600                    options may follow a bare path too
    serial:///dev/ttyUSB0?baud=921600&bits=8&parity=none&stop=1&flow=none
    tcp://host:port                             connect to a device server
    tcp-listen://[host]:port                    wait for a device to connect
    udp://[host]:port                           receive datagrams; answers go to the last sender
    capture.bin · file:///data/capture.bin?speed=4&loop=1      a capture, played with its original timing
    drive.mcap?device=2&from=12.5&to=20         a recording, see server/links/replay.py
    sim:NAME?rate=400&drop=0.01                 a simulated device of that protocol, behind a real pseudo-terminal;

An IPv6 address is written in brackets: `tcp://[fe80::1]:4001`. An invalid source raises a LinkError "bad-source" with
the field, its value and the allowed values; nothing is guessed.
"""

import os
import re
import stat
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from urllib.parse import parse_qsl, unquote

from imuscope.protocols.registry.families import url_options
from imuscope.server.links.base import Link, LinkError, LinkSettings, steady_clock
from imuscope.server.links.registry import link_kind, link_schemes, source_forms
from imuscope.server.links.text import grouped

_SCHEME = re.compile(r"^([a-zA-Z][a-zA-Z0-9+.-]+):(?://)?(.*)$", re.DOTALL)
LINE_OPTIONS = ("baud", "bits", "parity", "stop", "flow")
"""Options of a serial port: with one of them, a path where nothing is yet is that of a port."""
_WINDOWS_PORT = re.compile(r"^COM\d+$")


def bad(source: str, what: str, hint: str | None = None) -> LinkError:
    """The error for an invalid source address. The default hint lists the forms of sources."""
    forms_hint = source_forms() if hint is None else hint
    return LinkError("bad-source", f"The source {source!r:.80} cannot be used: {what}.", forms_hint)


def is_printable(text: str) -> bool:
    """Whether a text contains neither control characters nor unpaired surrogates."""
    return not any(unicodedata.category(one) in ("Cc", "Cs") for one in text)


def is_host(name: str) -> bool:
    """Whether a text is a valid host name. For an invalid one, Python raises UnicodeError instead of OSError."""
    try:
        name.encode("idna")
    except UnicodeError:
        return False
    return True


def _decode_options() -> str:
    """The options that any source can contain (server/devices/decode/decode_options.py)."""
    *first, last = url_options()
    return f"{', '.join(first)} and {last}" if first else last


@dataclass(frozen=True, slots=True)
class SourceUrl:
    """A parsed source: kind of link, place, and the options after the question mark, all as text."""

    text: str
    kind: str
    place: str
    options: Mapping[str, str]

    @classmethod
    def parse(cls, text: str) -> "SourceUrl":
        """Parse `text`. Whether the port or file exists is checked when it is opened.

        Raises:
            LinkError: kind "bad-source".
        """
        text = text.strip()
        if not text:
            raise bad(text, "it is empty")
        if not is_printable(unquote(text)):
            raise bad(text, "it contains a control character")
        if os.path.exists(text):
            return cls(text, "serial" if _is_port(text) else "file", text, {})
        scheme = _SCHEME.match(text)
        if scheme is None or _WINDOWS_PORT.match(text):
            place, options = _split_options(text, text)
            is_port = _is_port(place) or (not os.path.exists(place) and not options.keys().isdisjoint(LINE_OPTIONS))
            return cls(text, "serial" if is_port else "file", place, options)
        name = scheme[1].lower()
        schemes = link_schemes()
        if name not in schemes:
            near = get_close_matches(name, schemes, 1)
            hint = f"Did you mean {near[0]}? {source_forms()}" if near else None
            raise bad(text, f"{name!r:.40} is not one of {', '.join(schemes)}", hint)
        place, options = _split_options(text, scheme[2])
        if not place:
            raise bad(text, f"nothing follows {name!r}")
        return cls(text, schemes[name], unquote(place), options)

    def same_place(self, other: "SourceUrl") -> bool:
        """Whether both addresses open the same device. Different paths and rates of one port are the same device."""
        if self.text == other.text:
            return self.kind != "simulator"
        if self.kind != "serial" or other.kind != "serial":
            return False
        return os.path.realpath(self.place) == os.path.realpath(other.place)

    def allow(self, names: Sequence[str]) -> None:
        """Refuse options that are not among `names`, so that a misspelt one is not silently ignored."""
        for name in self.options:
            if name not in names:
                own = f"It has {', '.join(names)}; any" if names else "Any"
                allowed = f"{own} source has {_decode_options()}."
                near = get_close_matches(name, names, 1)
                raise bad(
                    self.text,
                    f"it has no option {name!r:.40}",
                    f"Did you mean {near[0]}? {allowed}" if near else allowed,
                )

    def number(self, name: str, default: float, low: float, high: float, unit: str = "") -> float:
        """Option as a number from `low` to `high`."""
        text = self.options.get(name)
        if text is None:
            return default
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            allowed = f"a number from {grouped(low)} to {grouped(high)} {unit}".rstrip()
            raise bad(self.text, f"{name} is {text!r:.40}, not {allowed}", f"Give {name} as {allowed}.")
        return value

    def whole(self, name: str, default: int, low: int, high: int, unit: str = "") -> int:
        """Option as a whole number from `low` to `high`."""
        value = self.number(name, default, low, high, unit)
        if value != int(value):
            raise bad(self.text, f"{name} is {value:g}, not a whole number", f"Give {name} as a whole number.")
        return int(value)

    def choice(self, name: str, default: str, choices: Sequence[str]) -> str:
        """Option as one of `choices`."""
        value = self.options.get(name, default)
        if value not in choices:
            allowed = ", ".join(choices)
            raise bad(self.text, f"{name} is {value!r:.40}, not one of {allowed}", f"Give {name} as one of {allowed}.")
        return value

    def switch(self, name: str) -> bool:
        """Option as a switch: true for 1, true, yes, on, or a name without a value."""
        value = self.choice(name, "0", ("0", "1", "", "true", "false", "yes", "no", "on", "off"))
        return value in ("1", "", "true", "yes", "on")

    def address(self, *, listening: bool) -> tuple[str, int]:
        """Host and port of a network source. For a listener, the host may be omitted (every interface) and the port
        may be 0 (any free one).
        """
        host, colon, port = self.place.rpartition(":")
        if not colon:
            raise bad(self.text, "the port is missing", f"Write it as {self.kind}://host:port.")
        low = 0 if listening else 1
        if not port.isascii() or not port.isdigit() or len(port) > 5 or not low <= int(port) <= 65535:
            raise bad(self.text, f"port is {port!r:.40}, not a number from {low} to 65535")
        if host.startswith("[") and host.endswith("]"):
            host = host[1:-1]
        elif ":" in host:
            raise bad(
                self.text,
                f"host is {host!r:.60}",
                f"Write an IPv6 address in brackets: {self.kind}://[{host}]:{port}.",
            )
        if not host and not listening:
            raise bad(self.text, "the host is missing", f"Write it as {self.kind}://host:port.")
        if host and not is_host(host):
            raise bad(self.text, f"host is {host!r:.60}, not a valid host name", f"{self.kind}://robot.local:{port}.")
        return host, int(port)


def open_link(source: str, settings: LinkSettings | None = None) -> Link:
    """Create the link for a source, not connected yet; `await link.open()` connects it.

    Raises:
        LinkError: kind "bad-source", with the field, the value and the allowed ones.
    """
    parsed = SourceUrl.parse(source)
    definition = link_kind(parsed.kind)
    assert definition is not None, "the kind of a parsed source is registered"
    return definition.open(source, settings or LinkSettings(now_ns=steady_clock()), parsed)


def _is_port(path: str) -> bool:
    """Whether this is a serial port: by its name if it is not plugged in, else if it is a character device."""
    if path == "/dev/stdin" or path.startswith("/dev/fd/"):
        return False
    if path.startswith("/dev/") or _WINDOWS_PORT.match(path):
        return True
    try:
        return stat.S_ISCHR(os.stat(path).st_mode)
    except (OSError, ValueError):
        return False


def _split_options(text: str, rest: str) -> tuple[str, dict[str, str]]:
    place, _, query = rest.partition("?")
    options: dict[str, str] = {}
    for name, value in parse_qsl(query, keep_blank_values=True):
        if name in options:
            raise bad(text, f"option {name!r:.40} is given twice", "Give each option once.")
        options[name] = value
    return place, options
