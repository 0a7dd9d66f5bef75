"""What the Configure page and the server say to each other: the shapes of the HTTP API under /api/devices/{id}.

    GET    …/forms                       Forms: every setting and command of this device, as forms
    POST   …/preview      Preview        PreviewAnswer: frames, annotated; problems; load. Sends nothing, wants no lock
    POST   …/read         ReadWish       Job: read settings (null: all of them) into a snapshot
    POST   …/apply        Apply          Job: snapshot, write, read back; on trial where the line could be cut
    POST   …/run          Run            Job: one command
    POST   …/raw          Raw            Job: bytes as they are, hex
    POST   …/keep         {}             ends a trial: the settings stay
    POST   …/revert       {}             ends a trial: back now
    POST   …/restore      {}             Job: the guided restore-communication procedure
    DELETE …/jobs/{job}                  takes a job out of the queue, or stops it where that is safe
    GET    …/control                     ControlState
    GET    …/values                      SnapshotBody: what the device has, as last read; `taken` 0: never read
    GET    …/exchange?before=&limit=     the log of the exchange, newest last: list[ExchangeEntry]
    GET    …/snapshots                   list[SnapshotInfo], newest first, by serial number
    GET    …/snapshots/{name}            the snapshot as YAML (application/yaml); ?format=json for SnapshotBody
    POST   …/snapshots    Keep           keeps a text (a file of the person's) or the present values under a name
    DELETE …/snapshots/{name}
    POST   …/compare      Compare        Difference: two sides, field by field
    POST   …/fit          Fit            FitAnswer: the same outputs with rates that fit
    GET, PUT, DELETE …/corrections       Corrections: a stream of RTCM, forwarded

`preview`, `fit` and `compare` send nothing to a device, and a view token is enough for them. What could
harm is answered with 409, kind "confirm" and the consequence as its message, until it comes with `confirmed`. A command
that writes a setting is applied like a change of that setting: with snapshot, reading back, and a trial where the line
could be cut. Further refusals: 409 "not-now" (nothing is on trial; a job that cannot be stopped), "full" (the queue),
"not-read", "no-driver", "no-settings", "no-defaults", "not-alike"; 422 "bad-value", "too-much" (for the line),
"bad-snapshot"; 404 "not-found"; 507 "disk".

A job comes back at once (202); how it goes is told over the WebSocket (`control`, `exchange`, `jobs`), and its result
is in `ControlState.done` until five newer ones are. Values are wire values by field name, as `imuscope inspect` prints
them; a field with `scale` is shown as wire × scale + bias in `unit`. Errors have the one shape {kind, message, hint};
what is wrong with a value is not an error but a FieldProblem.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from server.wire import BitsInfo

Editor = Literal["number", "integer", "choice", "flags", "bool", "text", "hex", "record", "list", "vector"]
CautionKind = Literal["", "restarts", "stops-output", "cuts-line", "loses-settings", "wears-flash", "moves-frame"]
Side = Literal["device", "factory", "snapshot", "text", "other"]


@dataclass(slots=True)
class FieldForm:
    """One field to fill in."""

    name: str
    title: str
    editor: Editor
    unit: str = ""  # of the shown value
    scale: float = 1.0  # shown = wire × scale + bias
    bias: float = 0.0
    low: float | None = None  # allowed wire values
    high: float | None = None
    step: float | None = None  # 1 for integers
    default: Any = None
    decimals: int = -1
    length: int = 0  # bytes or characters of a text or hex; elements of a vector; 0: open
    most: int = 0  # greatest number of list elements; 0: what the payload holds
    axes: list[str] = field(default_factory=list)
    choices: dict[str, str] = field(default_factory=dict)  # value (decimal) → meaning
    bits: list[BitsInfo] = field(default_factory=list)
    fields: list[FieldForm] = field(default_factory=list)  # of a record, or of each element of a list
    simple: bool = True
    read_only: bool = False
    base: int = 10  # 16: an identifier, shown in hex as on the label
    options: list[str] = field(default_factory=list)  # texts that a text field is known to take
    doc: str = ""
    source: str = ""


@dataclass(slots=True)
class SettingForm:
    """Values that the device keeps."""

    name: str
    title: str
    group: str
    fields: list[FieldForm]
    writable: bool
    partial: bool  # single fields can be written alone
    editor: Literal["", "outputs", "streams"] = ""
    after: Literal["", "measurement", "reset"] = ""  # when a written value takes effect
    caution: CautionKind = ""
    consequence: str = ""
    simple: bool = True
    doc: str = ""
    source: str = ""


@dataclass(slots=True)
class CommandForm:
    """Something the device can be told or asked."""

    name: str
    title: str
    group: str
    kind: Literal["ask", "set", "do"]
    arguments: list[FieldForm]
    reply: str = ""
    caution: CautionKind = ""
    consequence: str = ""
    simple: bool = True
    doc: str = ""
    source: str = ""
    harmless: dict[str, list[int]] = field(default_factory=dict)  # argument → values to which no caution applies
    writes: str = ""  # the setting of which its arguments are the fields: its form opens with what the device has


@dataclass(slots=True)
class OutputChoice:
    """One quantity that an Xsens output configuration can ask for."""

    data_identifier: int  # with Float32 and ENU where they can be chosen
    title: str
    group: str
    rates: list[int]  # allowed, Hz, fastest first; empty: with every message (0xFFFF)
    formats: list[int]  # precision bits that it can have; empty: fixed
    frames: list[int]  # coordinate bits that it can have; empty: fixed
    size: int  # bytes of its data at Float32
    unit: str = ""
    simple: bool = True
    doc: str = ""


@dataclass(slots=True)
class StreamChoice:
    """One data set that an Inertial Sense device can stream."""

    did: int
    name: str
    title: str
    group: str
    size: int  # bytes of its data; −1: as long as there is to tell
    rmc_bit: int = -1  # bit of the RMC word; −1: by GET_DATA only
    source_ms: float = 0.0  # period of one, ms; 0: not known before the device has told
    simple: bool = True
    doc: str = ""


@dataclass(slots=True)
class Forms:
    """Every setting and command of a device."""

    protocol: str
    product: str
    serial_number: str
    firmware: str
    groups: list[str]  # in the order in which they are listed
    settings: list[SettingForm]
    commands: list[CommandForm]
    outputs: list[OutputChoice] = field(default_factory=list)
    streams: list[StreamChoice] = field(default_factory=list)
    corrections: bool = False  # takes RTCM
    factory: bool = False  # the document tells its factory settings
    note: str = ""  # what is not known yet, in one sentence


@dataclass(slots=True)
class SpanInfo:
    """A few bytes of a frame and what they mean."""

    offset: int
    size: int
    label: str
    path: str = ""  # the field: "outputs.3.output_frequency"; "" for the envelope


@dataclass(slots=True)
class FrameInfo:
    name: str
    hex: str
    spans: list[SpanInfo]


@dataclass(slots=True)
class FieldProblem:
    """What is wrong with a value, said where it is typed."""

    path: str
    message: str
    hint: str = ""


@dataclass(slots=True)
class PartInfo:
    path: str
    title: str
    bytes_per_s: float


@dataclass(slots=True)
class LoadInfo:
    """What the line has to carry."""

    parts: list[PartInfo]
    total: float  # bytes/s
    capacity: float | None  # bytes/s, at the rate that will be in effect; null where the link has no such limit
    baud: int | None
    limits: list[str] = field(default_factory=list)  # per-message limits that are broken
    measured: float | None = None  # bytes/s now


@dataclass(slots=True)
class Preview:
    """Exactly one of `setting` and `command`."""

    values: dict[str, Any]
    setting: str = ""
    command: str = ""


@dataclass(slots=True)
class PreviewAnswer:
    frames: list[FrameInfo]
    problems: list[FieldProblem]
    load: LoadInfo | None = None
    line: str = ""  # how this change could cut the line; "" when it cannot


@dataclass(slots=True)
class ReadWish:
    settings: list[str] | None = None
    reason: str = ""  # kept with the snapshot
    confirmed: bool = False  # what a command left unfinished (ControlState.unfinished) may be discarded


@dataclass(slots=True)
class Apply:
    """Settings to write: whole ones, or single fields where the setting is `partial`."""

    changes: dict[str, dict[str, Any]]
    reason: str = ""
    confirmed: bool = False  # the person has read the consequence; without it a dangerous change is refused (409)
    devices: list[str] = field(default_factory=list)  # further devices of the same protocol that get the same
    product: str = ""  # whose settings these are (a profile's); a device of another product asks once more (409)
    base: dict[str, dict[str, Any]] = field(default_factory=dict)  # what the settings were when they were edited: where
    # the device has another value by now, nothing is written


@dataclass(slots=True)
class Run:
    command: str
    values: dict[str, Any] = field(default_factory=dict)
    confirmed: bool = False


@dataclass(slots=True)
class Raw:
    hex: str
    confirmed: bool = False


@dataclass(slots=True)
class Keep:
    title: str
    text: str = ""  # YAML; "" keeps what the device has now


@dataclass(slots=True)
class SideRef:
    """One side of a comparison."""

    side: Side
    snapshot: str = ""  # SnapshotInfo.name, for "snapshot"
    device: str = ""  # DeviceInfo.id, for "other"; for "snapshot" whose it is, "" for this device's
    text: str = ""  # YAML, for "text"


@dataclass(slots=True)
class Compare:
    left: SideRef
    right: SideRef


@dataclass(slots=True)
class DifferenceRow:
    setting: str
    path: str
    title: str
    unit: str
    left: str  # in words: "400 Hz", "ENU"; "" where that side does not have it
    right: str
    left_value: Any = None  # wire value
    right_value: Any = None
    writable: bool = True


@dataclass(slots=True)
class Difference:
    left: str  # what it is: "Device now", "Before this change, 14:31"
    right: str
    rows: list[DifferenceRow]
    same: int  # fields that agree
    missing: dict[str, str] = field(default_factory=dict)  # setting → why it could not be compared
    changes: dict[str, dict[str, Any]] = field(default_factory=dict)  # as Apply takes them, to make left what right is
    profile: dict[str, dict[str, Any]] = field(default_factory=dict)  # all of the right side that can be written
    product: str = ""  # of the right side; "" where it is not known
    problems: list[FieldProblem] = field(default_factory=list)  # what is wrong with the right side, at its path
    dangers: list[str] = field(default_factory=list)  # what writing the right side to the device could cost
    blocked: str = ""  # why it cannot be written: more than the line carries


@dataclass(slots=True)
class Fit:
    values: dict[str, Any]
    setting: str
    baud: int | None = None  # null: the present rate


@dataclass(slots=True)
class FitAnswer:
    values: dict[str, Any]
    load: LoadInfo
    words: list[str]  # what was lowered: "Acceleration 400 → 100 Hz"


@dataclass(slots=True)
class SnapshotInfo:
    name: str  # file name without suffix, unique per serial number
    title: str  # "Before this change", "First contact"
    taken: float  # unix seconds
    reason: str
    product: str
    serial_number: str
    firmware: str
    settings: int
    missing: int
    pinned: bool = False
    readable: bool = True  # by this version; if not, `reason` says why, and what to do


@dataclass(slots=True)
class SnapshotBody:
    info: SnapshotInfo
    values: dict[str, dict[str, Any]]
    missing: dict[str, str]  # setting → why it is not there


@dataclass(slots=True)
class Corrections:
    """A stream of RTCM 3 forwarded to the device in whole messages."""

    source: str  # ntrip://user:password@host:2101/MOUNT, tcp://host:port, a file; the password is never told again
    running: bool = False  # it goes on by itself, and is tried again where it broke
    forwarding: bool = False  # the last message reached the device; false while the source or the link refuses
    message: str = ""
    hint: str = ""
    age_s: float | None = None  # since the last message that was forwarded
    bytes_per_s: float = 0.0
    messages: dict[str, int] = field(default_factory=dict)  # RTCM message number → how many
    rejected: int = 0
    refused: int = 0  # forwarded, and the device said no
