"""What may a user write as a source? This docstring is the grammar; `SourceUrl` takes it apart.

    /dev/ttyUSB0                                a serial port; the rate is found by listening
    /dev/ttyUSB0?baud=921600                    options may follow a bare path too
    serial:///dev/ttyUSB0?baud=921600&bits=8&parity=none&stop=1&flow=none
    tcp://host:port                             connect to a device server
    tcp-listen://[host]:port                    wait for a device to connect
    udp://[host]:port                           receive datagrams; answers go to whoever sent last
    capture.bin · file:///data/capture.bin?speed=4&loop=1      a capture, played at its own pace
    drive.mcap?device=2&from=12.5&to=20         a recording, see server/links/replay.py
    twin:xbus?rate=400&drop=0.01                a simulated device behind a real pseudo-terminal

An IPv6 address stands in brackets: `tcp://[fe80::1]:4001`. Whatever is written wrongly is answered with a LinkError
"bad-source" that names the field, the value and what is allowed; nothing is guessed.
"""

from __future__ import annotations

import os
import re
import stat
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import cast
from urllib.parse import parse_qsl, unquote

from server.links.base import LinkError, LinkKind
from server.links.text import grouped

FORMS = (
    "Sources look like /dev/ttyUSB0, serial:///dev/ttyUSB0?baud=921600, tcp://host:port, tcp-listen://:port, "
    "udp://:port, capture.bin or twin:xbus."
)
KINDS: tuple[LinkKind, ...] = ("serial", "tcp", "tcp-listen", "udp", "file", "twin")
_SCHEME = re.compile(r"^([a-zA-Z][a-zA-Z0-9+.-]+):(?://)?(.*)$", re.DOTALL)
_WINDOWS_PORT = re.compile(r"^COM\d+$")


def bad(source: str, what: str, hint: str = FORMS) -> LinkError:
    """The one shape in which a wrongly written source is refused."""
    return LinkError("bad-source", f"The source {source!r:.80} cannot be used: {what}.", hint)


def is_printable(text: str) -> bool:
    """Could this be the name of anything? No control characters, no halves of characters."""
    return not any(unicodedata.category(one) in ("Cc", "Cs") for one in text)


def is_host(name: str) -> bool:
    """Could a host be called so? Looking up another name is not refused by the system but fails in Python."""
    try:
        name.encode("idna")
    except UnicodeError:
        return False
    return True


READING_OPTIONS = "protocol, key, min_mode, unverified, time_unit and rotation"  # see server/devices/decode_options.py


@dataclass(frozen=True, slots=True)
class SourceUrl:
    """A source taken apart: which kind of link, where to, and the options after the question mark, all still text."""

    text: str
    kind: LinkKind
    place: str
    options: Mapping[str, str]

    @classmethod
    def parse(cls, text: str) -> SourceUrl:
        """Take `text` apart; whether the port or file exists is found out when it is opened.

        Raises:
            LinkError: kind "bad-source".
        """
        text = text.strip()
        if not text:
            raise bad(text, "it is empty")
        if not is_printable(unquote(text)):
            raise bad(text, "it holds a character that is none")
        if os.path.exists(text):
            return cls(text, "serial" if _is_port(text) else "file", text, {})
        scheme = _SCHEME.match(text)
        if scheme is None or _WINDOWS_PORT.match(text):
            place, options = _split_options(text, text)
            return cls(text, "serial" if _is_port(place) else "file", place, options)
        kind = scheme[1].lower()
        if kind not in KINDS:
            near = get_close_matches(kind, KINDS, 1)
            hint = f"Did you mean {near[0]}? {FORMS}" if near else FORMS
            raise bad(text, f"{kind!r:.40} is not one of {', '.join(KINDS)}", hint)
        place, options = _split_options(text, scheme[2])
        if not place:
            raise bad(text, f"nothing follows {kind!r}")
        return cls(text, cast(LinkKind, kind), unquote(place), options)

    def same_place(self, other: SourceUrl) -> bool:
        """Would both open the same thing? A port is one port, however it is written and at whatever rate."""
        if self.text == other.text:
            return self.kind != "twin"
        if self.kind != "serial" or other.kind != "serial":
            return False
        return os.path.realpath(self.place) == os.path.realpath(other.place)

    def allow(self, names: Sequence[str]) -> None:
        """Refuse options that are not among `names`: a misspelt one must not be ignored in silence."""
        for name in self.options:
            if name not in names:
                own = f"It has {', '.join(names)}; any" if names else "Any"
                allowed = f"{own} source has {READING_OPTIONS}."
                near = get_close_matches(name, names, 1)
                raise bad(
                    self.text,
                    f"it has no option {name!r:.40}",
                    f"Did you mean {near[0]}? {allowed}" if near else allowed,
                )

    def number(self, name: str, default: float, low: float, high: float, unit: str = "") -> float:
        """A number from `low` to `high`."""
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
        """A whole number from `low` to `high`."""
        value = self.number(name, default, low, high, unit)
        if value != int(value):
            raise bad(self.text, f"{name} is {value:g}, not a whole number", f"Give {name} as a whole number.")
        return int(value)

    def choice(self, name: str, default: str, choices: Sequence[str]) -> str:
        """One word of `choices`."""
        value = self.options.get(name, default)
        if value not in choices:
            allowed = ", ".join(choices)
            raise bad(self.text, f"{name} is {value!r:.40}, not one of {allowed}", f"Give {name} as one of {allowed}.")
        return value

    def switch(self, name: str) -> bool:
        """On (1, true, yes, on, or nothing after the name) or off."""
        value = self.choice(name, "0", ("0", "1", "", "true", "false", "yes", "no", "on", "off"))
        return value in ("1", "", "true", "yes", "on")

    def address(self, *, listening: bool) -> tuple[str, int]:
        """Host and port of a network source. A listener may leave the host out (every interface) and may give port 0
        (any free one)."""
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
                f"An IPv6 address stands in brackets: {self.kind}://[{host}]:{port}.",
            )
        if not host and not listening:
            raise bad(self.text, "the host is missing", f"Write it as {self.kind}://host:port.")
        if host and not is_host(host):
            raise bad(self.text, f"host is {host!r:.60}, which no host is called", f"{self.kind}://robot.local:{port}.")
        return host, int(port)


def _is_port(path: str) -> bool:
    """True for a serial port: by its name when it is not plugged in, else because it is a character device."""
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
