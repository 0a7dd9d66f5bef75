"""Settings of the server: one frozen Config. The command line overrides a TOML file, which overrides the defaults.

    # imuscope.toml
    host = "0.0.0.0"
    port = 8080
    data = "/var/lib/imuscope"
    sources = ["/dev/ttyUSB0", "tcp://10.0.0.7:4000"]
    view_token = "…"            # read-only access
    control_token = "…"         # full access
    tls = true                  # https with a self-signed certificate; or tls_cert and tls_key: files (http/tls.py)
    source_folders = ["/srv/captures"]  # besides the library, where the page may open files as sources
    record = true               # record all devices from the start
    recordings_quota_gb = 20    # above it, the oldest recordings that are not pinned are deleted; 0: no quota
    split_mb = 2000             # size at which a recording continues in a new file
    split_min = 60              # … or duration
    sync_s = 10                 # time between two writes of a recording to the disk itself; 0: left to the system
    shares = { "/dev/ttyUSB0" = ["/run/imuscope/imu0", "tcp://127.0.0.1:4001"] }  # for other programs
    foxglove = 8765             # serve the Foxglove protocol, on this loopback port and at /foxglove
    rerun_connect = "rerun+http://desk.local:9876/proxy"  # stream to this Rerun viewer
    ros2 = true                 # devices as nodes of ROS 2, through the Zenoh router at ros2_router
    ros2_frames = { "/dev/ttyUSB0" = "imu_link" }  # frame_id of devices, by their source
    log_format = "json"         # for programs; "text" for reading
    log_level = "info"          # debug, info, warning, error
    allowed_hosts = ["robot.example"]
    allowed_origins = ["https://fleet.example"]

    [map]  # a map under the track; without it no requests are made, and the track is drawn on a plain grid
    tiles = "http://maps.local/{z}/{x}/{y}.png"
    attribution = "© OpenStreetMap contributors"

    [store]  # recordings of many robots (server/extensions/fleet/model/settings.py)
    url = "s3://bucket/prefix"

    [fleet]  # this robot on the page of many (server/extensions/fleet/model/fleet_settings.py)
    router = "tls/fleet.example:7447"

An unknown name in the file is an error, because a mistyped token that is silently ignored is worse than a server that
does not start.
"""

import ipaddress
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints
from urllib.parse import urlsplit

import platformdirs
from annotated_types import Interval, Unit

from imuscope.server.devices.decode.decode_options import (
    DecodeOptions,
    checked_options,
    declared_options,
    option_text,
    source_options,
)
from imuscope.server.settings.extension_settings import ExtensionSettings, extension_settings, shipped_owner
from imuscope.server.settings.logging_setup import LEVELS, STYLES
from imuscope.server.settings.setting_types import (
    Form,
    allowed_by,
    empty_or,
    is_allowed,
    is_of_type,
    one_of,
    refusal_of,
    zero_or,
)

DEFAULT_HOST = "127.0.0.1"
DEFAULT_PORT = 8080
MAX_MEMORY_MB = 65_536
SECRETS = ("view_token", "control_token", "password")


S = TypeVar("S", bound=ExtensionSettings)
T = TypeVar("T", bound=Any)


class ConfigError(ValueError):
    """An invalid setting: its name, its value and the allowed values."""


def default_data() -> Path:
    """The user's data folder."""
    return Path(platformdirs.user_data_dir("imuscope", appauthor=False))


def _is_tile_address(text: str) -> bool:
    parts = urlsplit(text)
    has_place = all(part in text for part in ("{z}", "{x}", "{y}"))
    return has_place and parts.scheme in ("http", "https") and bool(parts.netloc) and "{" not in parts.netloc


def _is_token(text: str) -> bool:
    return not text or (len(text) >= 8 and text.isascii() and text.isprintable() and " " not in text)


_Token = Annotated[str, Form(_is_token, "must have at least 8 printable ASCII characters without spaces")]


SIMULATORS = ("simulators",)
"""Sources where none are set: those of the simulated devices."""


@dataclass(frozen=True, slots=True)
class MapTiles:
    """A tile server.

    Args:
        tiles: address containing {z}, {x} and {y}; "" for no map.
        attribution: source of the tiles, as shown on the map.
    """

    tiles: Annotated[str, empty_or(_is_tile_address, "must be an http address with {z}, {x} and {y} in its path")] = ""
    attribution: str = ""


_TYPES = {
    str: "text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    Path: "a path",
    tuple[str, ...]: "a list of strings",
    dict[str, tuple[str, ...]]: "a table of lists of strings",
    dict[str, str]: "a table of strings",
}


@dataclass(frozen=True, slots=True)
class Config:
    """All settings of the server.

    Args:
        host, port: address to listen on; port 0 lets the system choose one (it is printed).
        data: folder for recordings and what the server remembers.
        sources: opened at start; not set: simulators of all device families. An empty list is none.
        protocol: of those sources; "" to detect it.
        decode_options: of those sources, as written: each a setting of its own, by the name that a protocol family
            declares (protocols/family/decode_options.py); secrets may be @FILE, files are named.
        rollback_s: time to confirm settings that could have cut the link, before they are rolled back.
        history_s, memory_mb: limits of the sample history, whichever is reached first.
        bytes_mb: of memory_mb, for the bytes of live links (server/devices/link/byte_memory.py); at most a quarter of
            it.
        view_token, control_token: "" to generate one when it is needed.
        tls: serve https with a self-signed certificate; tls_cert, tls_key: PEM files of another certificate.
        allowed_hosts: names under which this server may be addressed, besides its own and any literal address.
        allowed_origins: pages of other servers that may use this one.
        source_folders: folders, besides the library, from which files may be opened as sources over HTTP; sources given
            at start may be anywhere.
        record: record all devices from the start.
        recordings_quota_gb: maximum size of all recordings together, 10⁹ bytes; 0 for no quota.
        split_mb, split_min: size (10⁶ bytes) or duration at which a recording continues in a new file; 0 for never.
        sync_s: time between two fdatasyncs of a recording, whose end a power cut loses; 0 to leave them to the system.
        record_head: request the Configuration of an Xsens device when a recording begins, which pauses it for about
            90 ms; otherwise the recording has the one received last, which a starting device sends by itself.
        upload_gb: maximum size of an uploaded recording, 10⁹ bytes.
        log_format, log_level: format and lowest level of the log on standard error (server/settings/logging_setup.py).
        map: tile server for a map under the track (server/integrations/map_tiles.py).
        extensions: settings of extensions, each of its type (server/settings/extension_settings.py).
    """

    host: str = DEFAULT_HOST
    port: Annotated[int, Interval(ge=0, le=65_535)] = DEFAULT_PORT
    data: Path = field(default_factory=default_data)
    sources: tuple[str, ...] = SIMULATORS
    protocol: str = ""
    decode_options: Mapping[str, str | bool] = field(default_factory=dict, repr=False)
    rollback_s: Annotated[float, Interval(ge=1, le=600), Unit("s")] = 20.0
    history_s: Annotated[float, Interval(gt=0, le=86_400), Unit("s")] = 600.0
    memory_mb: Annotated[int, Interval(ge=1, le=MAX_MEMORY_MB), Unit("MB")] = 256
    bytes_mb: Annotated[int, Interval(ge=0, le=MAX_MEMORY_MB), Unit("MB")] = 64
    view_token: _Token = field(default="", repr=False)
    control_token: _Token = field(default="", repr=False)
    tls: bool = False
    tls_cert: str = ""
    tls_key: str = ""
    allowed_hosts: tuple[str, ...] = ()
    allowed_origins: tuple[str, ...] = ()
    source_folders: tuple[str, ...] = ()
    record: bool = False
    recordings_quota_gb: Annotated[float, zero_or(0.001, 1e6, "GB")] = 0.0
    split_mb: Annotated[float, zero_or(0.1, 1e6, "MB")] = 0.0
    split_min: Annotated[float, zero_or(0.01, 1e6, "min")] = 0.0
    sync_s: Annotated[float, zero_or(0.1, 60, "s", "left to the system")] = 1.0
    record_head: bool = False
    upload_gb: Annotated[float, Interval(gt=0, le=1e6)] = 16.0
    log_format: Annotated[str, one_of(*STYLES)] = "text"
    log_level: Annotated[str, one_of(*LEVELS)] = "info"
    map: MapTiles = MapTiles()
    extensions: tuple[ExtensionSettings, ...] = ()

    def of(self, kind: type[S]) -> S:
        """The settings of an extension."""
        return next((one for one in self.extensions if isinstance(one, kind)), None) or kind()

    def having(self, settings: ExtensionSettings) -> "Config":
        """This configuration with other settings of an extension."""
        others = [one for one in self.extensions if not isinstance(one, type(settings))]
        return replace(self, extensions=(*others, settings))

    def reading(self) -> DecodeOptions:
        """Decode options of the sources.

        Raises:
            DecodeOptionError: an invalid setting, or a file that cannot be read.
        """
        declared = declared_options() if self.decode_options else {}
        options = ((name, value) for name, value in self.decode_options.items() if value)
        return checked_options(self.protocol, {name: option_text(declared[name], value) for name, value in options})

    @property
    def bytes_limit_mb(self) -> float:
        """Memory for the bytes of live links."""
        return min(self.bytes_mb, self.memory_mb / 4)

    @property
    def scheme(self) -> str:
        return "https" if self.tls or self.tls_cert else "http"

    @property
    def is_loopback(self) -> bool:
        """True when only this machine can reach the server."""
        return is_loopback(self.host)


def is_loopback(host: str) -> bool:
    """Whether a name or address is the loopback of this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def load(toml: Path | None = None, **values: Any) -> Config:
    """The configuration.

    Args:
        toml: configuration file; `values` overrides it.
        values: settings from the command line; None means "not given". A table overrides only what it has.

    Raises:
        ConfigError: the file cannot be read, a name is unknown or a value is not allowed.
    """
    settings: dict[str, Any] = {}
    if toml is not None:
        try:
            settings = tomllib.loads(toml.read_text(encoding="utf-8"))
        except OSError as error:
            raise ConfigError(f"{toml} cannot be read: {error.strerror}.") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
            raise ConfigError(f"{toml} is not valid TOML: {error}.") from None
    values = {name: value for name, value in values.items() if value is not None}
    for name, value in values.items():
        table = settings.get(name, {})
        if name in tables() and isinstance(value, Mapping):
            value = {**table, **value} if isinstance(table, dict) else table
        settings[name] = value
    try:
        for kind in extension_settings():
            kind.complete(settings)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    return _checked(settings)


def _checked(settings: Mapping[str, Any]) -> Config:
    own = {name: value for name, value in settings.items() if name not in setting_names()}
    options = _decode_options(own) if own else {}
    config = replace(_chosen(Config(), settings), decode_options=options)
    config = replace(config, extensions=tuple(_chosen(kind(), settings) for kind in extension_settings()))
    config = replace(config, data=config.data.expanduser().absolute())  # our subprocesses work in other folders
    if config.data.exists() and not config.data.is_dir():
        raise ConfigError(f"data {str(config.data)!r} is a file; name a folder with --data.")
    if bool(config.tls_cert) != bool(config.tls_key):
        present, other = ("tls_cert", "tls_key") if config.tls_cert else ("tls_key", "tls_cert")
        raise ConfigError(f"{present} needs {other}: the files of a certificate and of its key.")
    if config.tls and config.tls_cert:
        raise ConfigError("tls creates a certificate and tls_cert names one: give one of the two.")
    try:
        for one in config.extensions:
            one.check()
    except ValueError as error:
        raise ConfigError(str(error)) from None
    if config.view_token and config.view_token == config.control_token:
        raise ConfigError("view_token and control_token must differ, otherwise every viewer could control.")
    return config


_NAMES = {one.name for one in fields(Config)} - {"decode_options", "extensions"}


def setting_names() -> set[str]:
    """Names of all settings and tables of the file, besides decode options."""
    return _NAMES | {one.name for kind in extension_settings() for one in fields(kind)}  # type: ignore[arg-type]


def _decode_options(settings: Mapping[str, Any]) -> dict[str, str | bool]:
    """Settings that are decode options, each of the type of its option."""
    declared = {option.name: option for option in source_options()}
    for name, value in settings.items():
        option = declared.get(name)
        if option is None:
            if owner := shipped_owner(name):
                again = "install imuscope again to add it: pip install --force-reinstall"
                raise ConfigError(f"{name} is a setting of the extension {owner}, which is not installed; {again}.")
            known = ", ".join(sorted((*setting_names(), *declared)))
            raise ConfigError(f"{name} is not a valid setting; valid settings: {known}.")
        kind = bool if option.kind == "flag" else str
        if not isinstance(value, kind):
            shown = "…" if option.kind == "secret" else repr(value)
            raise ConfigError(f"{name} must be {_TYPES[kind]}, not {shown}.")
    return dict(settings)


def _as_tuples(value: Any) -> Any:
    """TOML's lists as tuples, also those in a table."""
    if isinstance(value, Mapping):
        return {name: _as_tuples(one) for name, one in value.items()}
    return tuple(value) if isinstance(value, list) else value


def _type_text(kind: Any) -> str:
    if not is_dataclass(kind):
        return _TYPES[kind]
    names = [one.name for one in fields(kind)]
    return f"a table with {', '.join(names[:3])}{' and the like' if len(names) > 3 else ''}"


def _chosen(default: T, settings: Mapping[str, Any]) -> T:
    """`default` with those of the settings that are its own."""
    names = _NAMES if isinstance(default, Config) else {one.name for one in fields(default)}
    return _typed(default, {name: value for name, value in settings.items() if name in names})


def _typed(default: T, settings: Any, table: str = "") -> T:
    """`default` with these settings, each allowed and strictly of its type: neither text nor true is a number."""
    types, annotated = (get_type_hints(type(default), include_extras=extras) for extras in (False, True))
    changes = {}
    for name, value in settings.items():
        if name not in types:
            raise ConfigError(f"{table}{name} is not a valid setting; valid settings: {', '.join(sorted(types))}.")
        if is_dataclass(types[name]) and isinstance(value, Mapping):
            value = _typed(types[name](), value, f"{name}.")
        elif types[name] is Path and isinstance(value, str):
            value = Path(value)
        checked = _as_tuples(value)
        if not is_of_type(checked, types[name]):
            shown = "…" if name in SECRETS else repr(value)  # as written
            raise ConfigError(f"{table}{name} must be {_type_text(types[name])}, not {shown}.")
        if not is_allowed(checked, annotated[name]):
            shown = "" if name in SECRETS else f" {value!r}" if isinstance(value, str) else f" {value:g}"
            raise ConfigError(f"{table}{name}{shown} {refusal_of(annotated[name])}.")
        changes[name] = checked
    return replace(default, **changes)


def tables() -> dict[str, type]:
    """Tables of the file with names of their own: their settings, as a dataclass."""
    kinds = (Config, *extension_settings())
    return {name: hint for kind in kinds for name, hint in get_type_hints(kind).items() if is_dataclass(hint)}  # type: ignore[misc]


def allowed_values() -> Iterator[tuple[str, str]]:
    """Name of each setting whose values are limited, with the table that it is in, and its allowed values."""
    own = [("", kind) for kind in (Config, *extension_settings())]
    for table, kind in (*own, *tables().items()):
        for name, hint in get_type_hints(kind, include_extras=True).items():
            if words := allowed_by(hint):
                yield f"[{table}] {name}".removeprefix("[] "), words
