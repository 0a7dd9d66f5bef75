"""The vocabulary in which every specification is written, as data.

A protocol document is a set of tables: which messages there are, which fields each carries, what a field's number
means. Those tables are written here as rows, once, and everything else reads them: the decoder makes numpy layouts of
them, the wire advertises them to the page, the forms, the command line and the documentation print the same words.

    Command, Setting ── have many ──┐
    Message ── has many ──> Field ── may have ──> Bits (named flags or bit groups of an integer)
                              └── may have ──> Field (a record: its own fields, fixed or repeated)

Rules for editing: adding a message is adding a row; a row never holds code. `doc` is one sentence for a person,
`source` the section of the document the row was read from. Units are written as in SI ("m/s²", "°/s", "rad/s"); a
field whose wire unit differs from the shown one carries `scale`, shown = wire × scale + bias.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Severity = Literal["", "caution", "fault"]

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
        severity: how a set flag reads on the page: "" is plain information.
        normal_set: True where the set state is the healthy one (FilterValid), so that a *cleared* bit is what is shown.
        doc: one sentence for the lane's hover.
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
class Field:
    """One named quantity of a message.

    Args:
        name: the document's name ("Acceleration", "itow").
        dtype: wire type: a numpy dtype with byte order (">f4", ">u2", "u1"), or one of the wire encodings numpy lacks,
            "fp1220", "fp1632" (Xsens fixed point), "bytes" (opaque, shown as hex) or "ascii"; "" for a record.
        shape: () for a scalar, (3,) for a vector, (3, 3) for a matrix; -1 means "as many as the payload holds".
        unit: unit of the shown value.
        scale, bias: shown = wire × scale + bias.
        axes: one label per element ("x", "y", "z"; "roll", "pitch", "yaw"); empty for a scalar.
        choices: meaning of each value of an enumeration.
        bits: meaning of the bits of a flag word.
        fields: the fields of a record; a record with shape (-1,) or (n,) repeats.
        decimals: digits after the point on the page; -1 lets the page choose.
        period: the value at which the quantity wraps (360 for a heading in °); 0 for none.
        title: name for a person where `name` is terse ("Magnetic field"); "" means `name`.
        frame: coordinate frame of a vector, or both frames of a rotation ("ENU", "ENU from body").
        id: number in the document where the field has one (an Xsens data identifier), else -1.
        column_major: a matrix that travels column by column; the shown one is row by row, as is its `axes`.
        pad: the byte that fills an "ascii" field up to its length and is no part of the value (0x20 or 0); -1: none.
        low, high: allowed range of the wire value where it is narrower than its type; None where the type decides.
        default: wire value that a form starts with; None: none.
        most: greatest number of elements of an open shape; 0 where the payload decides.
        simple: False for what most people never change: a form shows it one click away.
        read_only: told by the device, never written.
        momentary: what is so now and is not kept: a temperature, a counter, the state of something that runs. It is
            shown; it is no difference between two states of a device, and is not put back.
        base: 16 for an identifier that is printed in hex on the label; the wire value stays a number.
        options: texts that a text field is known to take; a device may know others.
        doc, source: one sentence; section of the document.
    """

    name: str
    dtype: str = ""
    shape: tuple[int, ...] = ()
    unit: str = ""
    scale: float = 1.0
    bias: float = 0.0
    axes: tuple[str, ...] = ()
    choices: Mapping[int, str] = field(default_factory=lambda: NO_CHOICES)
    bits: tuple[Bits, ...] = ()
    fields: tuple[Field, ...] = ()
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
    most: int = 0
    simple: bool = True
    read_only: bool = False
    momentary: bool = False
    base: int = 10
    options: tuple[str, ...] = ()
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
        split: True when every field is a quantity of its own that a page subscribes to alone (the items of MTData2).
        apart: fields that a page subscribes to alone (the vectors, status words and lists of a message whose other
            fields stay together); each is a channel called message.field.
        direction: who sends it.
        title, doc, source: for a person; one sentence; section of the document.
    """

    id: int
    name: str
    fields: tuple[Field, ...] = ()
    time: str = ""
    tick_ns: int = 0
    wrap: int = 0
    kind: Literal["data", "reply", "indication", "command"] = "data"
    split: bool = False
    apart: tuple[str, ...] = ()
    direction: Direction = "to_host"
    title: str = ""
    doc: str = ""
    source: str = ""


Caution = Literal["", "restarts", "stops-output", "cuts-line", "loses-settings", "wears-flash", "moves-frame"]


@dataclass(frozen=True, slots=True)
class Command:
    """Something that a device can be told or asked: one form, one line of `imuscope send`, one row of documentation.

    Args:
        name: the document's name ("SetOutputConfiguration", "DID_SYS_CMD.softwareReset").
        arguments: what a person fills in; `fields` of the message on the wire, or what it is made of.
        kind: "ask" changes nothing; "set" writes a setting; "do" starts something.
        group: heading under which it is listed.
        reply: name of the message that answers; "" when nothing does.
        timeout_s: how long its answer may take.
        caution: what kind of harm it can do; a person is asked once more, in the words of `consequence`.
        consequence: one sentence that names what is lost or cut ("All settings return to the factory's.").
        harmless: argument → values with which the caution does not apply (a command that asks, or that ends something).
        simple: False for what is one click away.
        title, doc, source: for a person; one sentence; section of the document.
    """

    name: str
    arguments: tuple[Field, ...] = ()
    kind: Literal["ask", "set", "do"] = "do"
    group: str = ""
    reply: str = ""
    timeout_s: float = 0.5
    caution: Caution = ""
    consequence: str = ""
    simple: bool = True
    title: str = ""
    doc: str = ""
    source: str = ""
    harmless: Mapping[str, tuple[int, ...]] = field(default_factory=lambda: NO_HARMLESS)

    def harms(self, values: Mapping[str, Any]) -> bool:
        """Does the caution apply with these arguments?"""
        return bool(self.caution) and not any(values.get(name) in those for name, those in self.harmless.items())


@dataclass(frozen=True, slots=True)
class Setting:
    """Values that a device keeps: read by one exchange, written by one, compared and put back by name.

    Args:
        name: key in a snapshot, without "Req" and "Set" ("OutputConfiguration", "DID_FLASH_CONFIG").
        fields: wire values by name, as `imuscope inspect` prints them.
        read, write: names of the commands; write "" for what a device only tells.
        partial: True where single fields can be written alone (an ISB data set by offset).
        editor: "" for a plain form; "outputs" (Xsens output configuration) and "streams" (ISB streams) have their own.
        after: what makes a written value take effect: "" at once, "measurement" on leaving Config, "reset".
        caution, consequence: as for a command.
        group, simple, title, doc, source: as for a command.
    """

    name: str
    fields: tuple[Field, ...]
    read: str = ""
    write: str = ""
    partial: bool = False
    editor: Literal["", "outputs", "streams"] = ""
    after: Literal["", "measurement", "reset"] = ""
    caution: Caution = ""
    consequence: str = ""
    group: str = ""
    simple: bool = True
    title: str = ""
    doc: str = ""
    source: str = ""
