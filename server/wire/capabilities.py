"""Capabilities of this server, for the page and scripts: `Capabilities`, sent in `hello` and at /api/capabilities.

The page has no built-in list of protocols, export formats or kinds of links; it offers the ones listed here.
server/services/capability_list.py collects them from the registries.
"""

from dataclasses import dataclass, field
from typing import Literal

DecodeOptionKind = Literal["text", "choice", "flag", "secret", "file"]


@dataclass(slots=True)
class DecodeOptionChoice:
    value: str
    words: str


@dataclass(slots=True)
class DecodeOptionInput:
    """An option of how the bytes of a device are decoded, set by the user."""

    name: str  # as in the request that sets it
    title: str
    kind: DecodeOptionKind  # a secret is typed unseen, and never returned
    choices: list[DecodeOptionChoice]  # of a choice; an empty value: not given
    default: str = ""  # in effect if the option is not set
    early: bool = False  # also offered while the protocol is not known
    pattern: str = ""  # regular expression of the whole text; "" for any
    malformed: str = ""  # error if the text does not match
    example: str = ""  # one that does


@dataclass(slots=True)
class PayloadNumber:
    """A number that a payload can consist of."""

    name: str  # "i16"
    size: int  # in bytes


@dataclass(slots=True)
class ProtocolCapability:
    """Registered protocol family: its names, options and simulator."""

    name: str  # "xbus"
    title: str  # "Xsens MTi (Xbus)"
    short: str  # short title: "Xbus"
    simulator: bool = False  # `sim:NAME` is a simulated device
    options: list[DecodeOptionInput] = field(default_factory=list)
    payload_option: str = ""  # option by which the user describes a vendor's own payload types; "" for none
    # initial text for it: {size} in bytes, {id} in hex, {type} and {count}, whose line is left out for one
    payload_template: str = ""
    payload_numbers: list[PayloadNumber] = field(default_factory=list)  # the first whose size fits is the {type}
    attitude_hint: str = ""  # outputs to enable for an attitude
    identify_hint: str = ""  # why a device has no name yet, and how to get it
    pause_hint: str = ""  # effect of reading its settings
    abbreviations: list[str] = field(default_factory=list)  # parts of its names to write in capitals
    plots: list[str] = field(default_factory=list)  # titles or names of quantities to plot first
    panels: list[str] = field(default_factory=list)  # ids of panels to place first
    counts_losses: bool = False  # its samples are numbered, so that lost ones are known
    counter: str = ""  # name of the channel that has the numbers, where a device can be set not to send it


@dataclass(slots=True)
class ExportCapability:
    """A format that recordings can be exported to."""

    name: str  # "csv"
    title: str  # "CSV"
    words: str  # "full precision, units, one table per message"
    suffix: str  # ".csv"
    single: bool = False  # holds the bytes of one device, and no choice of channels
    protocol: str = ""  # only for devices with this protocol; "" for any
    takes_units: bool = False  # those of the page, SI or as sent
    per_byte: float = 1.0  # rough size, for each byte of the recording, until it is measured


@dataclass(slots=True)
class SourceExample:
    source: str  # "tcp://192.168.1.20:2000"
    words: str  # "a serial server or a device on the network"


@dataclass(slots=True)
class LinkCapability:
    """Registered kind of link, with the form of its addresses."""

    name: str  # DeviceInfo.link: "tcp"
    title: str  # as displayed: "TCP"
    examples: list[SourceExample] = field(default_factory=list)
    shareable: bool = False  # its port can be shared with other programs
    counts_messages: bool = False  # messages of its sources are numbered, so that lost ones are known


@dataclass(slots=True)
class AbsentExtension:
    """An extension whose packages are not installed."""

    name: str  # "rerun"
    title: str  # "Rerun"
    install: str  # the command that adds it: "pip install 'imuscope[viewers]'"


@dataclass(slots=True)
class Capabilities:
    """Everything that can be added without changing the page."""

    protocols: list[ProtocolCapability] = field(default_factory=list)
    exports: list[ExportCapability] = field(default_factory=list)
    links: list[LinkCapability] = field(default_factory=list)
    absent: list[AbsentExtension] = field(default_factory=list)
