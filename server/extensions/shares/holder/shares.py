"""Addresses of shares, as given to `--share`.

    /run/imuscope/imu0                           a pseudo-terminal; the path is a symbolic link to it
    /run/imuscope/imu0?permissions=0660&owner=imu&group=dialout
    tcp://127.0.0.1:4001                         listens; without a host on loopback
    udp://127.0.0.1:4002                         sends datagrams there; datagrams from there go to the device
    …?mode=read                                  clients cannot write to the device

The first client of a share that is not read-only may write, the others read.
"""

from __future__ import annotations

from collections.abc import Mapping

from imuscope.server.system.light_modules import Any, Literal, NamedTuple

ShareKind = Literal["pty", "tcp", "udp"]
MODES = ("write", "read")
_OPTIONS = {"pty": ("mode", "permissions", "owner", "group"), "tcp": ("mode",), "udp": ("mode",)}
LOOPBACK = "127.0.0.1"


class ShareError(ValueError):
    """An address of a share that cannot be used: cause, then action."""


class ShareAddress(NamedTuple):
    """One share.

    Args:
        text: as given, without options: also its name.
        path: of a pseudo-terminal; "" for the others.
        host, port: of TCP and UDP.
        read_only: no client may write through it.
        permissions: file mode of the terminal; None: as the system sets it.
        owner, group: of the terminal, names or numbers; "": unchanged.
    """

    kind: ShareKind
    text: str
    path: str = ""
    host: str = ""
    port: int = 0
    read_only: bool = False
    permissions: int | None = None
    owner: str = ""
    group: str = ""

    @classmethod
    def parse(cls, text: str) -> ShareAddress:
        """Parse an address.

        Raises:
            ShareError: with the allowed values.
        """
        place, _, query = text.strip().partition("?")
        scheme, separator, rest = place.partition("://")
        if not separator:
            kind, rest = "pty", place
        elif scheme in ("tcp", "udp"):
            kind = scheme
        else:
            raise ShareError(f"{scheme}:// cannot be shared; give a path, tcp://HOST:PORT or udp://HOST:PORT")
        options = _options(text, kind, query)
        read_only = _mode(options) == "read"
        if kind == "pty":
            if not rest.startswith("/"):
                raise ShareError(f"{rest!r:.80} is not an absolute path; give one such as /run/imuscope/imu0")
            permissions = _permissions(options.get("permissions", ""))
            owners = options.get("owner", ""), options.get("group", "")
            return cls("pty", rest, rest, "", 0, read_only, permissions, *owners)
        host, port = _host_and_port(text, rest)
        shown = f"[{host}]" if ":" in host else host
        named: ShareKind = "tcp" if kind == "tcp" else "udp"
        return cls(named, f"{kind}://{shown}:{port}", "", host, port, read_only)

    def to_json(self) -> dict[str, Any]:
        """For another process; `from_json` is the inverse."""
        return self._asdict()

    @classmethod
    def from_json(cls, body: Mapping[str, Any]) -> ShareAddress:
        return cls(**body)


def _options(text: str, kind: str, query: str) -> dict[str, str]:
    from urllib.parse import parse_qsl  # which a holder, that is given the parts, does not need

    options = dict(parse_qsl(query, keep_blank_values=True))
    for name in options:
        if name not in _OPTIONS[kind]:
            raise ShareError(f"{text!r:.80} has no option {name!r:.40}; it has {', '.join(_OPTIONS[kind])}")
    return options


def _mode(options: Mapping[str, str]) -> str:
    mode = options.get("mode", "write")
    if mode not in MODES:
        raise ShareError(f"mode={mode!r:.40} is not valid; allowed: {', '.join(MODES)}")
    return mode


def _permissions(text: str) -> int | None:
    if not text:
        return None
    try:
        mode = int(text, 8)
    except ValueError:
        mode = -1
    if not 0 <= mode <= 0o777:
        raise ShareError(f"permissions={text!r:.40} are not valid; give them in octal, such as 0660")
    return mode


def _host_and_port(text: str, rest: str) -> tuple[str, int]:
    from urllib.parse import urlsplit

    try:
        parts = urlsplit(f"//{rest}")
        host, port = parts.hostname or LOOPBACK, parts.port
    except ValueError:
        host, port = "", None
    if not host or not port or parts.path or parts.username:
        raise ShareError(f"{text!r:.80} is not a valid address; give HOST:PORT with a port from 1 to 65535")
    return host, port
