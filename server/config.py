"""With which settings does this server run? One frozen Config, from the command line over a TOML file over defaults.

    # imuscope.toml
    host = "0.0.0.0"
    port = 8080
    data = "/var/lib/imuscope"
    sources = ["/dev/ttyUSB0", "tcp://10.0.0.7:4000"]
    key = "@/etc/imuscope.key"  # of IDTP devices in Secure mode
    view_token = "…"            # may look
    control_token = "…"         # may also change things
    tls = true                  # https with a certificate made here; or tls_cert and tls_key: files (server/tls.py)
    source_folders = ["/srv/captures"]  # besides the library, where the page may open files as sources
    record = true               # from the start, all devices
    recordings_quota_gb = 20    # beyond that the oldest recordings go that nobody pinned; 0: no quota
    split_mb = 2000             # a recording goes on in a new file when it is so large
    split_min = 60              # … or so old
    foxglove = 8765             # speak the Foxglove protocol, on this loopback port and at /foxglove
    rerun_connect = "rerun+http://desk.local:9876/proxy"  # stream to this Rerun viewer
    log_format = "json"         # for programs; "text" for people
    log_level = "info"          # debug, info, warning, error
    allowed_hosts = ["robot.example"]
    allowed_origins = ["https://fleet.example"]

    [map]  # a map under the track; without it nothing is asked of anybody, and the track is on a plain grid
    tiles = "http://maps.local/{z}/{x}/{y}.png"
    attribution = "© OpenStreetMap contributors"

A name in the file that is not a setting is an error, because a mistyped token that is silently ignored is worse than a
server that does not start.
"""

from __future__ import annotations

import ipaddress
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import platformdirs

from server.devices.decode_options import DecodeOptions, key_text, reading, schema_text
from server.logging_setup import LEVELS, STYLES

DEFAULT_HOST = "127.0.0.1"
DEFAULT_PORT = 8080
MOST_MEMORY_MB = 65_536
_WORDS = {str: "text", int: "a whole number", float: "a number", bool: "true or false"}
SECRETS = ("key", "view_token", "control_token")


class ConfigError(ValueError):
    """A setting that cannot be used: which one, its value, what is allowed."""


def default_data() -> Path:
    """The user's data folder."""
    return Path(platformdirs.user_data_dir("imuscope", appauthor=False))


@dataclass(frozen=True, slots=True)
class MapTiles:
    """A tile server.

    Args:
        tiles: address with {z}, {x} and {y} in it; "" for no map.
        attribution: whom its tiles are owed to, as it stands on the map.
    """

    tiles: str = ""
    attribution: str = ""


@dataclass(frozen=True, slots=True)
class Config:
    """Everything that is decided before the server starts.

    Args:
        host, port: where to listen; port 0 lets the system choose one (it is printed).
        data: folder for recordings and compiled code.
        sources: opened at start; none given: twins of all device families.
        protocol: of those sources; "" to guess.
        key: for their Secure frames, hex or @FILE; min_mode: weakest mode accepted; schema: file that describes
            vendor types; unverified: show Secure frames without a key, marked (see server/devices/decode_options.py).
        time_unit: of the timestamps of IDTP, "ns", "us", "ms" or "s"; "" for microseconds, unless their arrival says
            otherwise; rotation: which way a device's quaternion turns, "enu_from_body" (also "") or "body_from_enu".
        trial_s: how long a person has to keep settings that could have cut the line, before they go back.
        history_s, memory_mb: how far back the server remembers samples, whichever is less.
        view_token, control_token: "" means that one is made when it is needed.
        tls: serve https, with a certificate of our own; tls_cert, tls_key: PEM files of one that was given.
        allowed_hosts: names under which this server may be addressed, besides its own and any literal address.
        allowed_origins: pages of other servers that may use this one.
        source_folders: besides the library, where files may be opened as sources over HTTP; what is given at start may
            be anywhere.
        record: record all devices from the start.
        recordings_quota_gb: how much all recordings may take together, 10⁹ bytes; 0 for no quota.
        split_mb, split_min: a recording goes on in a new file when it has 10⁶ bytes or minutes like that; 0 for never.
        record_head: ask an Xsens device for its Configuration when a recording begins (it pauses for a moment).
        upload_gb: how large an uploaded recording may be, 10⁹ bytes.
        foxglove: loopback port of the Foxglove protocol (server/integrations/foxglove.py); 0 for any free one, −1 for
        none. rerun_connect: address of a Rerun viewer on another machine that is streamed to; "" for none. log_format,
        log_level: how what happens is told on standard error, and from which level on (server/logging_setup.py). map:
        the tile server for a map under the track (server/api/map_tiles.py).
    """

    host: str = DEFAULT_HOST
    port: int = DEFAULT_PORT
    data: Path = field(default_factory=default_data)
    sources: tuple[str, ...] = ()
    protocol: str = ""
    key: str = field(default="", repr=False)
    min_mode: str = ""
    schema: str = ""
    unverified: bool = False
    time_unit: str = ""
    rotation: str = ""
    trial_s: float = 20.0
    history_s: float = 600.0
    memory_mb: int = 256
    view_token: str = field(default="", repr=False)
    control_token: str = field(default="", repr=False)
    tls: bool = False
    tls_cert: str = ""
    tls_key: str = ""
    allowed_hosts: tuple[str, ...] = ()
    allowed_origins: tuple[str, ...] = ()
    source_folders: tuple[str, ...] = ()
    record: bool = False
    recordings_quota_gb: float = 0.0
    split_mb: float = 0.0
    split_min: float = 0.0
    record_head: bool = True
    upload_gb: float = 16.0
    foxglove: int = -1
    rerun_connect: str = ""
    log_format: str = "text"
    log_level: str = "info"
    map: MapTiles = MapTiles()

    def reading(self) -> DecodeOptions:
        """How the sources are to be read.

        Raises:
            ReadingError: a setting that cannot be used, or a file that cannot be read.
        """
        key = key_text(self.key) if self.key else ""
        schema = schema_text(self.schema) if self.schema else ""
        told = (self.protocol, key, self.min_mode, self.unverified, schema)
        return reading(*told, time_unit=self.time_unit, rotation=self.rotation)

    @property
    def scheme(self) -> str:
        return "https" if self.tls or self.tls_cert else "http"

    @property
    def is_loopback(self) -> bool:
        """True when only this machine can reach the server."""
        return is_loopback(self.host)


def is_loopback(host: str) -> bool:
    """Is this name or address the machine itself?"""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def load(toml: Path | None = None, **given: Any) -> Config:
    """The configuration.

    Args:
        toml: file to read first.
        given: settings from the command line; None means "not given".
    Raises:
        ConfigError: the file cannot be read, a name is unknown or a value is not allowed.
    """
    settings: dict[str, Any] = {}
    if toml is not None:
        try:
            settings = tomllib.loads(toml.read_text(encoding="utf-8"))
        except OSError as error:
            raise ConfigError(f"{toml} cannot be read: {error.strerror}.") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise ConfigError(f"{toml} is not valid TOML: {error}.") from None
    settings.update({name: value for name, value in given.items() if value is not None})
    return _checked(settings)


def _checked(settings: Mapping[str, Any]) -> Config:
    default = Config()
    known = {item.name for item in fields(Config)}
    changes: dict[str, Any] = {}
    for name, value in settings.items():
        if name not in known:
            raise ConfigError(f"{name} is not a valid setting; there are: {', '.join(sorted(known))}.")
        changes[name] = _converted(name, value, getattr(default, name))
    config = replace(default, **changes)
    if config.data.exists() and not config.data.is_dir():
        raise ConfigError(f"data {str(config.data)!r} is a file; name a folder with --data.")
    if not 0 <= config.port <= 65535:
        raise ConfigError(f"port {config.port} is outside 0 … 65535.")
    if not -1 <= config.foxglove <= 65535:
        raise ConfigError(f"foxglove {config.foxglove} is neither a port, 0 … 65535, nor −1 for none.")
    if config.rerun_connect and not re.fullmatch(r"rerun(\+https?)?://[^/\s]+/proxy", config.rerun_connect):
        raise ConfigError(
            f"rerun_connect {config.rerun_connect!r} is not a valid address such as rerun+http://host:9876/proxy."
        )
    for name, choices in (("log_format", STYLES), ("log_level", LEVELS)):
        if getattr(config, name) not in choices:
            raise ConfigError(f"{name} {getattr(config, name)!r} is not valid; there are: {', '.join(choices)}.")
    if not 1 <= config.trial_s <= 600:
        raise ConfigError(f"trial_s {config.trial_s:g} is outside 1 … 600 s.")
    if not 0 < config.history_s <= 86_400:
        raise ConfigError(f"history_s {config.history_s:g} is outside 0 … 86 400 s.")
    for name, least, unit in (
        ("recordings_quota_gb", 0.001, "GB"),
        ("split_mb", 0.1, "MB"),
        ("split_min", 0.01, "min"),
    ):
        value = getattr(config, name)
        if value and not least <= value <= 1e6:
            raise ConfigError(f"{name} {value:g} is neither 0 (no limit) nor {least:g} … 1 000 000 {unit}.")
    if not 1 <= config.memory_mb <= MOST_MEMORY_MB:
        raise ConfigError(f"memory_mb {config.memory_mb} is outside 1 … {MOST_MEMORY_MB} MB.")
    if bool(config.tls_cert) != bool(config.tls_key):
        given, other = ("tls_cert", "tls_key") if config.tls_cert else ("tls_key", "tls_cert")
        raise ConfigError(f"{given} needs {other}: the files of a certificate and of its key.")
    if config.tls and config.tls_cert:
        raise ConfigError("tls makes a certificate and tls_cert names one: give one of the two.")
    if not 0 < config.upload_gb <= 1e6:
        raise ConfigError(f"upload_gb {config.upload_gb:g} is outside 0 … 1 000 000.")
    for name in ("view_token", "control_token"):
        token = getattr(config, name)
        if token and (len(token) < 8 or not token.isascii() or not token.isprintable() or " " in token):
            raise ConfigError(f"{name} must have at least 8 printable ASCII characters without spaces.")
    if config.view_token and config.view_token == config.control_token:
        raise ConfigError("view_token and control_token must differ, otherwise every viewer could control.")
    return config


def _converted(name: str, value: Any, default: Any) -> Any:
    """`value` as the type of the default."""
    if isinstance(default, MapTiles):
        return value if isinstance(value, MapTiles) else _map(value)
    if isinstance(default, tuple):
        if isinstance(value, str) or not all(isinstance(item, str) for item in value):
            raise ConfigError(f"{name} must be a list of strings, not {value!r}.")
        return tuple(value)
    if isinstance(default, Path) and isinstance(value, str | Path):
        return Path(value).expanduser().absolute()  # processes of ours work in other folders
    if isinstance(default, float) and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not type(default):
        shown = "…" if name in SECRETS else repr(value)  # however it is written
        raise ConfigError(f"{name} must be {_WORDS.get(type(default), 'a path')}, not {shown}.")
    return value


def _map(value: Any) -> MapTiles:
    """The [map] table."""
    known = [item.name for item in fields(MapTiles)]
    if not isinstance(value, Mapping):
        raise ConfigError(f"map must be a table with {' and '.join(known)}, not {value!r}.")
    for name, text in value.items():
        if name not in known:
            raise ConfigError(f"map.{name} is not a valid setting; there are: {', '.join(known)}.")
        if not isinstance(text, str):
            raise ConfigError(f"map.{name} must be text, not {text!r}.")
    found = MapTiles(**value)
    parts = urlsplit(found.tiles)
    missing = [part for part in ("{z}", "{x}", "{y}") if part not in found.tiles]
    if found.tiles and (missing or parts.scheme not in ("http", "https") or not parts.netloc or "{" in parts.netloc):
        raise ConfigError(f"map.tiles {found.tiles!r} must be an http address with {{z}}, {{x}} and {{y}} in its path.")
    return found
