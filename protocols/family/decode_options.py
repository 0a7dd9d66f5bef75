"""Declaration of decode options: information from the user that the bytes of a device do not contain.

A family lists its options (`Decoding.options`). From each of them the program makes, without another line:

    --tick-unit ms                                 a flag of the command line
    udp://:5000?tick_unit=ms                       an option of a source
    {"source": "udp://:5000", "tick_unit": "ms"}   a field over HTTP
    tick_unit = "ms"                               a setting of the configuration file
    a select box, a check box or a field           an input of the page, if the option has a title
    Decoder(tick_unit="ms")                        a keyword of the family's decoder and listing

Until it reaches the family, the value of an option is text: "" if it is not given, "1" for a flag. Families that use
one name for an option must mean the same by it; the first declaration has the words.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

Kind = Literal["text", "choice", "flag", "secret", "file"]
Scope = Literal["source", "inspect", "compose", "commands"]

ON, OFF = ("1", "", "true", "yes", "on"), ("0", "false", "no", "off")
_RESERVED = """
address align allowed_hosts allowed_origins analysis analysis_mb analysis_s anyone attribution away_s baud begin bits
burst_ms bus_ca bus_certificate bus_ids bus_key bytes_mb channel clock columns command config control_token corrupt
data date_order device direction domain drift_ppm drop duration end field file files fleet fleet_name fleet_server flow
format foxglove from from_b gravity help history_s host json jsonl jump_s kind listen log_format log_level loop map
memory memory_mb message name offset operators option other output packet_stamp pairs parity port product protocol pty
question rate record record_head recordings_quota_gb rejects remove_unused rerun_connect reset_s robot robots
rollback_s ros2 ros2_axes ros2_contract ros2_covariances ros2_depth ros2_domain ros2_frames ros2_map_frame ros2_names
ros2_namespace ros2_reliability ros2_router ros2_tf router router_config search seconds seed server share share_owners
shares shell show signal signal_b source source_folders sources speed split_mb split_min sql square stop store sync_s
systemd_unit tcp time_column timeout tls tls_cert tls_key to to_b token trial_s type udev_rule udp units unplug_s
upload_gb version vertical view_token webhook_hosts without_position yes
"""
RESERVED = frozenset(_RESERVED.split())
"""Names of the program's own options and settings, which a family cannot use."""
_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True, slots=True)
class DecodeOption:
    """An option of how the bytes of a device are decoded.

    Args:
        name: in a source, over HTTP, in settings and recordings: "tick_unit"; on the command line --tick-unit.
        kind: "text"; "choice" of `choices`; "flag"; "secret": a text that is never shown, logged or returned;
            "file": a text, for which the command line and the settings name a file.
        help: what it is for, in a line.
        choices: (value, display name) each.
        read: makes the decoder's setting of a text; raises ValueError with a sentence about an invalid text.
        write: the text of a setting in its usual notation; None: a text is used as given.
        keyword: of the decoder; "" for the name.
        scopes: "source": sources, live or recorded; "inspect", "compose", "commands": the commands of these names.
        recorded: whether it is a property of the device, and therefore stored in recordings.
        merge: an earlier text and a newer one in one text; None: the newer one replaces the earlier.
        conflicts: options that must not be given with it → the reason.
        details: further lines for the help of the command line.
        title: of its input on the page; "" for none.
        default: on the page, the choice in effect if none is given.
        unset: on the page, the display name of not choosing; "" if one of the choices always applies.
        early: whether the page offers it before the protocol is known, too.
        pattern: regular expression of the whole text of a text or secret, for the page to check while it is typed;
            "" for none. `read` decides.
        table_role: "unit" if it is also the unit of the times of a table; else "".
        malformed, example: on the page, the error if the text does not have that pattern, and one that does.
    """

    name: str
    kind: Kind
    help: str
    choices: tuple[tuple[str, str], ...] = ()
    read: Callable[[str], Any] = str
    write: Callable[[Any], str] | None = None
    keyword: str = ""
    scopes: frozenset[Scope] = frozenset(("source",))
    recorded: bool = False
    merge: Callable[[str, str], str] | None = None
    conflicts: Mapping[str, str] = field(default_factory=dict)
    details: str = ""
    title: str = ""
    default: str = ""
    unset: str = ""
    early: bool = False
    pattern: str = ""
    malformed: str = ""
    table_role: str = ""
    example: str = ""

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name) or self.name in RESERVED:
            raise ValueError(f"{self.name!r:.40} cannot be the name of a decode option")
        if bool(self.choices) != (self.kind == "choice"):
            raise ValueError(f"the decode option {self.name} must have choices if it is a choice, and only then")

    @property
    def flag(self) -> str:
        """Its name on the command line, without the dashes."""
        return self.name.replace("_", "-")

    @property
    def values(self) -> tuple[str, ...]:
        return tuple(value for value, _ in self.choices)

    def checked(self, text: str) -> str:
        """The text in its usual notation; "" for an option that is not given.

        Raises:
            ValueError: the text is invalid; the message never contains a secret.
        """
        if self.kind == "flag":
            if text not in ON + OFF:
                raise ValueError(f"{self.name} must be 1 or 0")
            return "1" if text in ON else ""
        if not (text.strip() if self.kind == "file" else text):
            return ""
        if self.kind == "choice" and text not in self.values:
            raise ValueError(f"{self.name} is {text!r:.40}, not one of {', '.join(self.values)}")
        try:
            setting = self.read(text)
        except ValueError as error:
            if self.kind == "secret" and text in str(error):
                raise ValueError(f"the {self.name} is not valid") from None
            raise
        return text if self.write is None else self.write(setting)


def settings_of(options: Iterable[DecodeOption], texts: Mapping[str, str]) -> dict[str, Any]:
    """The settings of a decoder with these options. A text that is meant for another family is left out."""
    settings = {}
    for option in options:
        text = texts.get(option.name, "")
        if text and (option.kind != "choice" or text in option.values):
            settings[option.keyword or option.name] = True if _is_plain(option) else option.read(text)
    return settings


def _is_plain(option: DecodeOption) -> bool:
    return option.kind == "flag" and option.read is str


def merged(options: Iterable[DecodeOption]) -> dict[str, DecodeOption]:
    """Options of several families by name: choices and scopes of those with one name are added up.

    Raises:
        ValueError: two have the same name but different kinds.
    """
    by_name: dict[str, DecodeOption] = {}
    for option in options:
        first = by_name.get(option.name)
        if first is None:
            by_name[option.name] = option
            continue
        if first.kind != option.kind:
            raise ValueError(f"its decode option {option.name} is a {option.kind}; another family's is a {first.kind}")
        more = tuple(choice for choice in option.choices if choice[0] not in first.values)
        by_name[option.name] = replace(
            first,
            choices=first.choices + more,
            scopes=first.scopes | option.scopes,
            recorded=first.recorded or option.recorded,
        )
    return by_name
