"""HTTP API of the Configure page: the shapes of the HTTP API under /api/devices/{id}.

docs/http-api.md lists the routes, with their bodies and answers.

`preview`, `fit-rates` and `compare` send nothing to a device, and a view token is sufficient for them. A request that
could do harm is answered with 409, kind "confirm" and the consequence as its message, until it is sent with
`confirmed`. A command that writes a setting is applied like a change of that setting: with snapshot, read-back, and a
pending rollback where the link could be lost. Further refusals: 409 "not-now" (no rollback is pending; a job that
cannot be stopped), "full" (the queue), "not-read", "no-driver", "no-settings", "no-defaults", "not-alike"; 422
"bad-value", "too-much" (for the line), "bad-snapshot"; 404 "not-found"; 507 "disk".

A job is returned at once (202); its progress is sent over the WebSocket (`jobs`, `traffic`), and its result stays in
`DeviceJobs.done` until five newer jobs have ended. Values are wire values by field name, as `imuscope inspect` prints
them; a field with `scale` is shown as wire × scale + bias in `unit`. Errors have the one shape {kind, message, hint};
an invalid value is reported as a FieldProblem, not as an error.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from imuscope.protocols.commands.rate_tables import RateTable
from imuscope.protocols.commands.transactions import ByteRange, OutputLoad
from imuscope.protocols.schema.fields import Meaning, TextList
from imuscope.server.wire import BitsInfo

Editor = Literal["number", "integer", "choice", "flags", "bool", "text", "hex", "record", "list", "vector"]
CautionKind = Literal["", "restarts", "stops-output", "cuts-line", "loses-settings", "wears-flash", "moves-frame"]
Side = Literal["device", "factory", "snapshot", "text", "other"]


@dataclass(slots=True)
class FieldForm:
    """Input of one field: its type, range, unit and help."""

    name: str
    title: str
    editor: Editor
    unit: str = ""  # of the shown value
    scale: float = 1.0  # shown = wire × scale + bias
    bias: float = 0.0
    low: float | None = None  # allowed wire values
    high: float | None = None
    limited: list[Literal["low", "high"]] = field(default_factory=list)  # by the setting, not only by its type
    step: float | None = None  # 1 for integers
    default: Any = None
    decimals: int = -1
    length: int = 0  # bytes or characters of a text or hex; elements of a vector; 0: open
    max_length: int = 0  # maximum number of list elements; 0: limited by the payload only
    axes: list[str] = field(default_factory=list)
    frame: str = ""  # of a vector; of a rotation both: "output from sensor"
    choices: dict[str, str] = field(default_factory=dict)  # value (decimal) → meaning
    bits: list[BitsInfo] = field(default_factory=list)
    fields: list[FieldForm] = field(default_factory=list)  # of a record, or of each element of a list
    basic: bool = True
    read_only: bool = False
    base: int = 10  # 16: an identifier, shown in hex as on the label
    options: list[str] = field(default_factory=list)  # known values of a text field
    listed: TextList | None = None  # if the device lists the values; a value may join several with "/"
    meaning_of: str = ""  # field of the same record on which the meaning depends
    meanings: tuple[Meaning, ...] = ()
    doc: str = ""
    source: str = ""


@dataclass(slots=True)
class SettingForm:
    """Values that the device stores."""

    name: str
    title: str
    group: str
    fields: list[FieldForm]
    writable: bool
    partial: bool  # single fields can be written alone
    table: RateTable | None = None  # by which its list is edited; None for a plain form
    after: Literal["", "measurement", "reset"] = ""  # when a written value takes effect
    caution: CautionKind = ""
    consequence: str = ""
    basic: bool = True
    doc: str = ""
    source: str = ""


@dataclass(slots=True)
class CommandForm:
    """Form of a command: its arguments and its caution."""

    name: str
    title: str
    group: str
    kind: Literal["ask", "set", "do"]
    arguments: list[FieldForm]
    reply: str = ""
    caution: CautionKind = ""
    consequence: str = ""
    basic: bool = True
    doc: str = ""
    source: str = ""
    harmless: dict[str, list[int]] = field(default_factory=dict)  # argument → values to which no caution applies
    writes: str = ""  # setting whose fields are the arguments; the form opens with the values of the device


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
    corrections: bool = False  # accepts RTCM
    factory: bool = False  # its factory settings are documented
    axes: Literal["FLU", "FRD"] = "FLU"  # of its body
    note: str = ""  # the part that is not known yet, one sentence


@dataclass(slots=True)
class FrameInfo:
    name: str
    hex: str
    spans: list[ByteRange]


@dataclass(slots=True)
class FieldProblem:
    """Problem of a value, shown at its input."""

    path: str
    message: str
    hint: str = ""


@dataclass(slots=True)
class LoadInfo:
    """Bytes per second of the outputs, and the capacity of the link."""

    parts: list[OutputLoad]
    total: float  # bytes/s
    capacity: float | None  # bytes/s, at the baud rate after the change; null if the link has no such limit
    baud: int | None
    limits: list[str] = field(default_factory=list)  # per-message limits that are exceeded
    measured: float | None = None  # bytes/s now


@dataclass(slots=True)
class PreviewRequest:
    """Exactly one of `setting` and `command`."""

    values: dict[str, Any]
    setting: str = ""
    command: str = ""


@dataclass(slots=True)
class PreviewResult:
    frames: list[FrameInfo]
    problems: list[FieldProblem]
    load: LoadInfo | None = None
    line: str = ""  # how this change could cut the line; "" if it cannot
    risks: list[str] = field(default_factory=list)  # further consequences of single values, for a user


@dataclass(slots=True)
class ReadRequest:
    settings: list[str] | None = None
    reason: str = ""  # stored in the snapshot
    confirmed: bool = False  # unfinished work of a command (DeviceJobs.unfinished) may be discarded


@dataclass(slots=True)
class ApplyRequest:
    """Settings to write: complete ones, or single fields if the setting is `partial`."""

    changes: dict[str, dict[str, Any]]
    reason: str = ""
    confirmed: bool = False  # the user accepts the consequence; without it a dangerous change is refused (409)
    devices: list[str] = field(default_factory=list)  # further devices of the same protocol, written with the same
    product: str = ""  # product of these settings (of a profile); another product needs confirmation (409)
    base: dict[str, dict[str, Any]] = field(default_factory=dict)  # the settings when they were edited; if the device
    # has another value by now, nothing is written
    confirm_s: float | None = None  # any change is temporary, and rolled back unless it is confirmed in this time, s
    # null: only a change that could cut the link, for `rollback_s` of the configuration


@dataclass(slots=True)
class RunRequest:
    command: str
    values: dict[str, Any] = field(default_factory=dict)
    confirmed: bool = False


@dataclass(slots=True)
class RawRequest:
    hex: str
    confirmed: bool = False


@dataclass(slots=True)
class SaveRequest:
    title: str
    text: str = ""  # YAML; "" stores the present values of the device


@dataclass(slots=True)
class SideRef:
    """One side of a comparison."""

    side: Side
    snapshot: str = ""  # SnapshotInfo.name, for "snapshot"
    device: str = ""  # DeviceInfo.id, for "other"; for "snapshot" its owner, "" for this device
    text: str = ""  # YAML, for "text"


@dataclass(slots=True)
class CompareRequest:
    left: SideRef
    right: SideRef
    take: dict[str, bool] = field(default_factory=dict)  # DifferenceRow.key → take
    take_rest: bool | None = None  # whether the others are taken; null: as by default


@dataclass(slots=True)
class DifferenceRow:
    setting: str
    path: str
    title: str
    unit: str
    left: str  # as text: "400 Hz", "ENU"; "" if that side does not have it
    right: str
    left_value: Any = None  # wire value
    right_value: Any = None
    writable: bool = True
    take: bool = False  # the changes contain it
    key: str = ""  # of this difference in CompareRequest.take
    why: str = ""  # why the left device cannot have the right value, which is then not writable


@dataclass(slots=True)
class Difference:
    left: str  # title: "Device now", "Before this change, 14:31"
    right: str
    rows: list[DifferenceRow]
    same: int  # fields that agree
    missing: dict[str, str] = field(default_factory=dict)  # setting → why it could not be compared
    changes: dict[str, dict[str, Any]] = field(default_factory=dict)  # for an ApplyRequest: the rows to take
    profile: dict[str, dict[str, Any]] = field(default_factory=dict)  # all writable values of the right side
    product: str = ""  # of the right side; "" if it is not known
    problems: list[FieldProblem] = field(default_factory=list)  # problems of the right side, at their paths
    dangers: list[str] = field(default_factory=list)  # risks of writing the right side to the device
    blocked: str = ""  # why it cannot be written: more than the line can carry
    temporary: bool = False  # the changes could cut the line: they are rolled back unless they are confirmed


@dataclass(slots=True)
class FitRatesRequest:
    values: dict[str, Any]
    setting: str
    baud: int | None = None  # null: the present rate


@dataclass(slots=True)
class FitRatesResult:
    values: dict[str, Any]
    load: LoadInfo
    words: list[str]  # lowered rates: "Acceleration 400 → 100 Hz"


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
    readable: bool = True  # by this version; if not, `reason` gives the cause and what to do


@dataclass(slots=True)
class SnapshotBody:
    info: SnapshotInfo
    values: dict[str, dict[str, Any]]
    missing: dict[str, str]  # setting → why it is missing
    ports: list[str] = field(default_factory=list)  # fields of the port of this link, now; several: of one of them


@dataclass(slots=True)
class Corrections:
    """A stream of RTCM 3 forwarded to the device in whole messages."""

    source: str  # ntrip://user:password@host:2101/MOUNT, tcp://host:port, a file; returned without the password
    running: bool = False  # continues by itself, and is retried if it breaks
    forwarding: bool = False  # the last message reached the device; false while the source or the link fails
    message: str = ""
    hint: str = ""
    age_s: float | None = None  # since the last forwarded message
    bytes_per_s: float = 0.0
    messages: dict[str, int] = field(default_factory=dict)  # RTCM message number → count
    rejected: int = 0
    refused: int = 0  # forwarded, but rejected by the device
