"""Vocabulary of all specifications, as data.

A protocol document is a set of tables: messages, their fields, the meaning of a field's number. Those tables are
written here as rows, once, and everything else reads them: the decoder makes numpy layouts from them, the wire
advertises them to the page, and the forms, the command line and the documentation print the same words.

    Command, Setting ── have many ──┐
    Message ── has many ──> Field ── may have ──> Bits (named flags or bit groups of an integer)
                              └── may have ──> Field (a record: its own fields, fixed or repeated)

Rules for editing: adding a message is adding a row; a row never holds code. `doc` is one sentence for the user,
`source` the section of the document of the row. Units are written as in SI ("m/s²", "°/s", "rad/s"); a
field whose wire unit differs from the displayed one carries `scale`, shown = wire × scale + bias.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Severity = Literal["", "warning", "error"]

NO_CHOICES: Mapping[int, str] = {}
NO_HARMLESS: Mapping[str, tuple[int, ...]] = {}


@dataclass(frozen=True, slots=True)
class Bits:
    """One named flag, or one bit group with named values, of an integer field.

    Args:
        name: the document's name ("ClipAccX", "RtkStatus").
        low: lowest bit, 0 = least significant.
        width: number of bits; 1 is a flag.
        choices: meaning of each value of a group; empty for a flag.
        severity: severity of a set flag on the page: "" is plain information.
        normal_set: True if the set state is the healthy one (FilterValid), so that a *cleared* bit is shown.
        doc: one sentence for the lane's tooltip.
    """

    name: str
    low: int
    width: int = 1
    choices: Mapping[int, str] = field(default_factory=lambda: NO_CHOICES)
    severity: Severity = ""
    normal_set: bool = False
    doc: str = ""

    def of(self, word: int) -> int:
        """The value of this group in `word`."""
        return (word >> self.low) & ((1 << self.width) - 1)


@dataclass(frozen=True, slots=True)
class Meaning:
    """Meaning of a field while another field of its record has certain values; in place of what the field says."""

    values: tuple[int, ...]  # of the other field; empty: all that no meaning before names
    title: str
    unit: str = ""
    scale: float = 1.0  # shown = wire × scale
    decimals: int = -1
    low: float | None = None  # allowed wire values; null: those of the field
    high: float | None = None
    signed: bool = False  # the unsigned wire value is a two's complement; low and high are signed
    doc: str = ""


@dataclass(frozen=True, slots=True)
class TextList:
    """Texts that the device lists in a setting."""

    setting: str
    records: str  # field of the setting: a list of records
    text: str  # field of a record
    used: str  # field that is 0 in an unused record


@dataclass(frozen=True, slots=True)
class Field:
    """One named quantity of a message.

    Args:
        name: the document's name ("Acceleration", "itow").
        dtype: wire type: a numpy dtype with byte order (">f4", ">u2", "u1"), or one of the wire encodings numpy lacks,
            "fp1220", "fp1632" (Xsens fixed point), "bytes" (opaque, shown as hex) or "ascii"; "" for a record.
        shape: () for a scalar, (3,) for a vector, (3, 3) for a matrix; -1 means "as many as the payload holds".
        unit: unit of the displayed value.
        scale, bias: displayed = wire × scale + bias.
        sent_unit: that of the wire, if columns stay as sent and are multiplied by `scale` only where they are read.
        axes: one label per element ("x", "y", "z"; "roll", "pitch", "yaw"); empty for a scalar.
        choices: meaning of each value of an enumeration.
        bits: meaning of the bits of a flag word.
        fields: the fields of a record; a record with shape (-1,) or (n,) repeats.
        decimals: digits after the point on the page; -1 lets the page choose.
        period: the value at which the quantity wraps (360 for a heading in °); 0 for none.
        title: display name if `name` is terse ("Magnetic field"); "" means `name`.
        frame: coordinate frame of a vector, or both frames of a rotation ("ENU", "ENU from body").
        id: number in the document if the field has one (an Xsens data identifier), else -1.
        column_major: a matrix sent column by column; the displayed one is row by row, as is its `axes`.
        pad: the byte that fills an "ascii" field up to its length and is not part of the value (0x20 or 0); -1: none.
        low, high: allowed range of the wire value if narrower than its type; None: the type decides.
        default: initial wire value of a form; None: none.
        max_length: greatest number of elements of an open shape; 0 if the payload decides.
        basic: False for rarely changed ones: a form shows them one click away.
        read_only: reported by the device, never written.
        momentary: a present state that is not stored: a temperature, a counter, the state of a process. It is
            displayed; it is not a difference between two states of a device, and not restored.
        base: 16 for an identifier that is printed in hex on the label; the wire value stays a number.
        key_mask: for the key of a record, the number that names its quantity (an entry of a list of outputs): the bits
            that do; the others choose a variant of it. 0: not a key. ConfigurationTraits.entry_words gives its title.
        options: known values of a text field; a device may know others.
        listed: where the device lists the texts that it takes; a value may join several of them by "/".
        meaning_of: name of the field of the same record on which the meaning of this one depends; "" for none.
        meanings: the meanings, by values of that field.
        doc, source: one sentence; section of the document.
    """

    name: str
    dtype: str = ""
    shape: tuple[int, ...] = ()
    unit: str = ""
    scale: float = 1.0
    bias: float = 0.0
    sent_unit: str = ""
    axes: tuple[str, ...] = ()
    choices: Mapping[int, str] = field(default_factory=lambda: NO_CHOICES)
    bits: tuple[Bits, ...] = ()
    fields: "tuple[Field, ...]" = ()
    decimals: int = -1
    period: float = 0.0
    title: str = ""
    frame: str = ""
    id: int = -1
    column_major: bool = False
    pad: int = -1
    low: float | None = None
    high: float | None = None
    default: Any = None
    max_length: int = 0
    basic: bool = True
    read_only: bool = False
    momentary: bool = False
    base: int = 10
    key_mask: int = 0
    options: tuple[str, ...] = ()
    listed: TextList | None = None
    meaning_of: str = ""
    meanings: tuple[Meaning, ...] = ()
    doc: str = ""
    source: str = ""


Direction = Literal["to_host", "to_device", "both"]


@dataclass(frozen=True, slots=True)
class Message:
    """A kind of payload.

    Args:
        id: the number on the wire (MID, DID, payload type).
        name: the document's name.
        fields: in the order of the wire.
        time: name of the field that is the device clock, "" when the message has none.
        tick_ns: length of one tick of that clock.
        wrap: ticks at which it wraps; 0 when the rule is found from the data or it never does.
        kind: "data" streams into plots; "reply" and "indication" are events; "command" is sent by the host.
        channel_per_field: True if every field is a quantity with a channel of its own (the items of MTData2).
        separate_channels: fields with channels of their own (the vectors, status words and lists of a message whose
            other fields stay together), named message.field.
        direction: its sender.
        title, doc, source: display name; one sentence; section of the document.
        sealed: only its maker can read its bytes, so that no definition of a payload is missing.
        refusals: values of the first field that refuse a request for its state, and say nothing of the device's health.
    """

    id: int
    name: str
    fields: tuple[Field, ...] = ()
    time: str = ""
    tick_ns: int = 0
    wrap: int = 0
    kind: Literal["data", "reply", "indication", "command"] = "data"
    channel_per_field: bool = False
    separate_channels: tuple[str, ...] = ()
    direction: Direction = "to_host"
    title: str = ""
    doc: str = ""
    source: str = ""
    sealed: bool = False
    refusals: tuple[int, ...] = ()


Caution = Literal["", "restarts", "stops-output", "cuts-line", "loses-settings", "wears-flash", "moves-frame"]


@dataclass(frozen=True, slots=True)
class Command:
    """A command or request of a device: one form, one line of `imuscope send`, one row of documentation.

    Args:
        name: the document's name ("SetOutputConfiguration", "DID_SYS_CMD.softwareReset").
        arguments: values to fill in; `fields` of the message on the wire, or their source.
        kind: "ask" changes nothing; "set" writes a setting; "do" starts something.
        group: heading under which it is listed.
        reply: name of the message that answers; "" for none.
        timeout_s: longest time of its answer.
        caution: kind of possible harm; the user must confirm, in the words of `consequence`.
        consequence: one sentence on the effect or loss ("All settings return to the factory's.").
        harmless_values: argument → values without the caution (a command that asks, or that ends something).
        basic: False for those one click away.
        title, doc, source: display name; one sentence; section of the document.
    """

    name: str
    arguments: tuple[Field, ...] = ()
    kind: Literal["ask", "set", "do"] = "do"
    group: str = ""
    reply: str = ""
    timeout_s: float = 0.5
    caution: Caution = ""
    consequence: str = ""
    basic: bool = True
    title: str = ""
    doc: str = ""
    source: str = ""
    harmless_values: Mapping[str, tuple[int, ...]] = field(default_factory=lambda: NO_HARMLESS)

    def is_risky(self, values: Mapping[str, Any]) -> bool:
        """Whether the caution applies with these arguments."""
        return bool(self.caution) and not any(values.get(name) in those for name, those in self.harmless_values.items())


@dataclass(frozen=True, slots=True)
class Setting:
    """Values stored by a device: read by one transaction, written by one, compared and restored by name.

    Args:
        name: key in a snapshot, without "Req" and "Set" ("OutputConfiguration", "DID_FLASH_CONFIG").
        fields: wire values by name, as `imuscope inspect` prints them.
        read, write: names of the commands; write "" for read-only values.
        partial: True if single fields can be written alone (an ISB data set by offset).
        editor: "" for a plain form, else the name of a table of the family (ConfigurationTraits.tables).
        per_sensor: it distinguishes one sensor from others (a number given to it), so another's value is not offered.
        after: when a written value takes effect: "" at once, "measurement" on leaving Config, "reset".
        caution, consequence: as for a command.
        group, basic, title, doc, source: as for a command.
    """

    name: str
    fields: tuple[Field, ...]
    read: str = ""
    write: str = ""
    partial: bool = False
    per_sensor: bool = False
    editor: str = ""
    after: Literal["", "measurement", "reset"] = ""
    caution: Caution = ""
    consequence: str = ""
    group: str = ""
    basic: bool = True
    title: str = ""
    doc: str = ""
    source: str = ""
