"""The wire: protocol between the server and the page. This docstring is its specification.

One WebSocket at `/ws`, subprotocol `imuscope.v1`, permessage-deflate off. Text frames are JSON objects with an `op`;
binary frames carry samples. TypeScript types are generated from the dataclasses below (`python -m
server.generate_ts_types` writes web/src/wire/types.ts; a test fails when that file is stale), so fields are added only
here.

## Server to browser, text

    hello             first, once: versions, server clock, length of history, capabilities of this server
                      (server/capabilities.py)
    devices           every device with its link and state; the whole list, sent on every change
    channels          channels not sent to the browser before (ids are never reused within a server run)
    health            figures of every device, twice a second; an older one not yet sent is replaced
    unknown_payloads  payloads without a description, as bytes, if any: sent with health, replaced by newer ones
                      in the same way
    events            events, in order of `seq`; never dropped
    jobs              jobs of each device: its queue, the running job, a pending rollback; the whole list, sent on
                      every change
    recorder          state of the recorder, once a second while it records; library: the list of recordings has
                      changed; exports: exports that run or can be downloaded, on every change
    traffic           frames sent to devices, their answers, and notes on them, in order of `seq`; never dropped
    history_end       response to `subscribe`: all history has been sent
    pong              response to `ping`: the browser estimates the server's clock from it
    error             the last request failed: {kind, message, hint}

## Browser to server, text

    subscribe  channels (null: all, also future ones) and seconds of history to send; replaces the previous one
    interval   s: interval at which the page can use new samples; they are sent no faster, but at least ten times a
               second
    ping       t: any number, returned
    (all changes are made over HTTP)

## Samples, binary

A binary WebSocket message is one or more sample frames back to back. Little-endian; each frame:

    0   u8    opcode, 1 = samples
    1   u8    flags; bit 0: history (sent because of a subscribe, older than the live samples)
    2   u16   number of columns, counting the two time columns
    4   u32   channel id
    8   u32   n, samples in this frame
    12  u32   dropped: samples of this channel dropped for this browser just before these
    16  u64   sequence number of the first sample, counted from 0 since the channel exists
    24  u32   length of the frame in bytes, header and padding included; a multiple of 8
    28  u32   reserved, 0
    32  f64   server clock when sent, unix seconds
    40  columns, each n values of its dtype, each padded to a multiple of 8 bytes

Columns come in the order: `arrival` (f8, unix seconds at which the bytes arrived at the host), `time` (f8, unix
seconds: device time mapped to host time; NaN where the message has no device clock), then the channel's columns as
advertised. Every column starts 8-byte aligned within the message, so `new Float32Array(buffer, offset, n)` needs no
copy. Padding bytes have no meaning.

A channel is one quantity of one device (an MTData2 item, an ISB data set). The nine columns of a `matrix` are in row
order. A `table` channel is a table: several rows share one time (satellites); the rows with the newest time are the
present table.

## History

After a `subscribe` the page discards its samples. Live frames are sent at once and are appended. History frames are
sent between them, newest block first, so that plots fill from right to left and the newest seconds are shown at once on
any link. Within a frame samples ascend, and each history frame of a channel ends exactly where the previous one began
(`sequence + n` equals that frame's `sequence`; for the first, the sequence of the first live sample). So history is
prepended, live data is appended, and no sorting is needed. `history_end` follows the last history frame.

## Delivery

Samples may be dropped, oldest first, when a browser does not keep up; `dropped` is their number and `health` has the
total. Text is never dropped, except that an unsent `devices` or `health` is replaced by a newer one. A browser that
accepts no byte for 5 s is disconnected. A browser never slows down a device or a recording.

64-bit integers are BigInt64Array/BigUint64Array columns in binary frames. In JSON an integer beyond ±(2^53 − 1), which
JavaScript cannot hold, is a decimal string, bytes are a hex string, and a non-finite number is null.

When a device changes the layout of a quantity (float32 to float64, ENU to NED) a channel of the same name is advertised
again; the one with the higher id is active.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any, Literal

from server.capabilities import Capabilities

SUBPROTOCOL = "imuscope.v1"
OPCODE_SAMPLES = 1
FLAG_HISTORY = 1
HEADER = struct.Struct("<BBHIIIQIId")
HEADER_FIELDS = ("opcode", "flags", "columns", "channel", "n", "dropped", "sequence", "size", "reserved", "now")
assert HEADER.size == 40

Dtype = Literal["f4", "f8", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"]
Severity = Literal["", "warning", "error"]
DeviceStatus = Literal["connecting", "live", "lost", "denied", "idle", "ended"]
Wants = Literal["", "key", "rearm"]
EventKind = Literal["gap", "reject", "clock", "link", "reply", "text", "marker", "device", "command"]
Level = Literal["info", "warning", "error"]


@dataclass(slots=True)
class BitsInfo:
    """One flag (width 1) or bit group of a status column; drawn as a lane."""

    name: str
    low: int
    width: int
    choices: dict[str, str] = field(default_factory=dict)  # value (decimal, as JSON keys are strings) → meaning
    severity: Severity = ""
    normal_set: bool = False
    doc: str = ""


@dataclass(slots=True)
class ColumnInfo:
    """One column of a channel, after `arrival` and `time`."""

    name: str  # unique in the channel: "x", "yaw", "itow", "q0"
    dtype: Dtype
    unit: str = ""
    label: str = ""  # short label on the plot; "" means name
    axis: Literal["", "x", "y", "z", "w"] = ""  # determines its colour
    choices: dict[str, str] = field(default_factory=dict)
    bits: list[BitsInfo] = field(default_factory=list)
    decimals: int = -1  # digits after the decimal point; -1: chosen by the page
    period: float = 0.0  # wraps at this value; 0: never
    doc: str = ""


@dataclass(slots=True)
class ChannelInfo:
    """One quantity of one device."""

    id: int
    device: str  # DeviceInfo.id
    message: str  # message name in the protocol document: "MTData2"
    name: str  # quantity name in the protocol document: "Acceleration"
    title: str  # displayed: "Acceleration"; if a device sends several with one title, `group` distinguishes them
    kind: Literal["vector", "quaternion", "matrix", "euler", "status", "scalar", "record", "table", "counter"]
    unit: str
    frame: str  # "ENU", "NED", "NWU", "ECEF", "ENU from body" or ""
    columns: list[ColumnInfo]
    doc: str = ""
    source: str = ""
    verified: bool = True  # false: its samples are shown although their sender could not be verified
    group: str = ""  # displayed name of its message: "INS 1"; "" if the title is sufficient


@dataclass(slots=True)
class Attempt:
    """One attempt to connect to a device, as text."""

    what: str  # "921 600 Bd"
    outcome: str  # "2 304 B, no frame in them"
    time: float


@dataclass(slots=True)
class DeviceInfo:
    """A device and the link it is on."""

    id: str  # stable for this server run: "1"; of a further device on the link of "1": "1.102"
    name: str  # displayed name: "MTi-630"
    source: str  # as given: "/dev/ttyUSB0", "sim:xbus"
    link: str  # a name of LinkCapability: "serial", "tcp", "file"
    status: DeviceStatus
    protocol: str = ""  # "xbus", "" while unknown
    product: str = ""  # "MTi-630 AHRS"
    serial_number: str = ""
    firmware: str = ""
    protection: str = ""  # of its frames, if the protocol has several: "Safety, CRC-32", "Secure, unverified: no key"
    baud: int | None = None
    message: str = ""  # one sentence about the state: "/dev/ttyUSB0 is gone."
    hint: str = ""  # next step for the user
    attempts: list[Attempt] = field(default_factory=list)
    next_attempt: float | None = None  # unix seconds of the next attempt
    last_arrival: float | None = None
    notices: list[str] = field(default_factory=list)  # permanent notices: a high USB latency timer and its fix
    rearm: list[str] = field(default_factory=list)  # senders whose sequence restarted: an operator may re-arm them
    wants: Wants = ""  # required user action, while no data can be shown
    decode_options: dict[str, str] = field(default_factory=dict)  # given ones by name, without secrets and files
    parent: str = ""  # first device on the same link, if there are several; link, retry and removal belong to it
    is_open: bool = False  # state of its link: a silent device on an open link may still answer
    absent: list[str] = field(default_factory=list)  # flags of its status words that this product does not have


@dataclass(slots=True)
class MessageHealth:
    """Figures of one message of one device."""

    name: str
    rate: float  # samples/s over the last second
    count: int  # since the session began


@dataclass(slots=True)
class JitterCause:
    """Cause of uneven arrival times, and its remedy."""

    kind: Literal["bursts", "resets", "stalls", "network"]
    text: str  # one sentence or two
    remedy: str


@dataclass(slots=True)
class DeviceHealth:
    """Figures of one device; rates over the last second, counts since the session began. Rejected, verified and
    unverified frames are counted since the decode options were set: a new key restarts these counts.
    """

    device: str
    time: float
    rate: float  # samples/s of the fastest message
    messages: list[MessageHealth]
    gaps: int
    lost: int  # missing samples, according to counters
    rejects: int
    bytes: int
    bytes_per_s: float
    capacity: float | None  # bytes/s the link can carry, if known
    jitter_ms: float | None  # p99 of arrival minus expected arrival over the last seconds
    last_arrival: float | None
    drift_ppm: float | None  # device clock against host clock
    uncertainty_ms: float | None  # ± of the mapping from device time to host time
    rejects_by: dict[str, int] = field(default_factory=dict)  # reason → how many of `rejects`: "bad_checksum", "no_key"
    verified: int | None = None  # samples whose frames passed all checks; null if the protocol has no such check
    unverified: int | None = None  # samples shown although their frames could not be checked
    dropped: int = 0  # samples dropped for this browser
    jitter_cause: JitterCause | None = None  # cause of uneven arrival times; null while they are even


@dataclass(slots=True)
class UnknownPayload:
    """Newest payload of a type without a description: a vendor-specific type, or one newer than the tables."""

    device: str
    name: str  # "0x80", "0x4FF0", "DID_RTK_DEBUG_2"
    id: int  # type number in the protocol
    message: str  # displayed name of its message
    count: int  # since the session began
    rate: float  # per second
    size: int  # bytes of the payload
    hex: str  # at most its first 1024 bytes
    arrival: float  # of this one, unix seconds
    doc: str = ""
    verified: bool = True


@dataclass(slots=True)
class EventInfo:
    """An event. `t0`..`t1` (host time) is the time span concerned, for example hatched as a gap."""

    seq: int
    time: float
    device: str  # "" for the server itself
    kind: EventKind
    level: Level
    text: str
    t0: float | None = None
    t1: float | None = None
    samples: int = 0
    data: dict[str, Any] = field(default_factory=dict)


@dataclass(slots=True)
class Hello:
    version: str
    server_time: float
    host: str
    run: str  # changes when the server restarts; the page then discards its channels
    history: float  # seconds kept in memory
    capabilities: Capabilities = field(default_factory=Capabilities)
    op: Literal["hello"] = "hello"


@dataclass(slots=True)
class Devices:
    devices: list[DeviceInfo]
    op: Literal["devices"] = "devices"


@dataclass(slots=True)
class Channels:
    channels: list[ChannelInfo]
    op: Literal["channels"] = "channels"


@dataclass(slots=True)
class HealthReport:
    devices: list[DeviceHealth]
    op: Literal["health"] = "health"


@dataclass(slots=True)
class UnknownPayloads:
    payloads: list[UnknownPayload]
    op: Literal["unknown_payloads"] = "unknown_payloads"


@dataclass(slots=True)
class Events:
    events: list[EventInfo]
    op: Literal["events"] = "events"


@dataclass(slots=True)
class TrafficEntry:
    """One frame of a transaction, or a note between frames."""

    seq: int
    time: float
    device: str
    way: Literal["tx", "rx", "note"]
    name: str  # of the frame: "SetOutputConfiguration"; "" for a note
    hex: str = ""
    text: str = ""  # decoded content or result: "12 of 12 entries as requested"
    ms: float | None = None  # for an answer: time since the request
    level: Level = "info"


@dataclass(slots=True)
class FieldOutcome:
    """A field whose requested value the device did not accept."""

    setting: str
    path: str
    title: str
    asked: str
    got: str  # "" if it was rejected
    why: str = ""


@dataclass(slots=True)
class Job:
    """One task of a device, queued, running or finished."""

    id: int
    device: str
    title: str  # "Write Output configuration"
    state: Literal["waiting", "running", "done", "failed", "stopped"]
    step: str = ""  # current step: "GoToConfig, second try"
    message: str = ""  # result of a finished job, one sentence
    hint: str = ""
    snapshot: str = ""  # name of the snapshot taken before or by the job
    values: dict[str, Any] = field(default_factory=dict)  # the answer of a command
    outcomes: list[FieldOutcome] = field(default_factory=list)
    started: float | None = None
    ended: float | None = None


@dataclass(slots=True)
class PendingRollback:
    """Settings that are rolled back unless the user confirms them."""

    device: str
    state: Literal["applying", "pending", "rolling-back", "confirmed", "rolled-back", "unreachable"]
    changes: list[str]  # as text: "Baud rate 115 200 → 921 600"
    words: str  # "The device answers at 921 600 Bd. Unless confirmed, it goes back to 115 200 Bd."
    deadline: float | None = None  # unix seconds, while pending
    seconds: float = 20.0


@dataclass(slots=True)
class DeviceJobs:
    """Queue and state of one device."""

    device: str
    state: str  # "Measurement", "Config", "" if the protocol has no states
    running: Job | None = None
    queue: list[Job] = field(default_factory=list)
    done: list[Job] = field(default_factory=list)  # the last five, newest first
    pending_rollback: PendingRollback | None = None
    unfinished: str = ""  # unfinished work of a command, lost on a change of state: a reset that is not stored


@dataclass(slots=True)
class RecorderState:
    """State of the recorder."""

    running: bool
    id: str = ""  # RecordingInfo.id of the file being written
    title: str = ""
    devices: list[str] = field(default_factory=list)
    started: float | None = None  # unix seconds
    bytes: int = 0  # size of this recording, all parts
    behind_s: float = 0.0  # age of the oldest byte not yet passed to the disk
    free: int | None = None  # free bytes on the disk
    seconds_left: float | None = None  # until the disk is full, at the present rate
    message: str = ""  # why it stopped unexpectedly; "" otherwise
    hint: str = ""
    op: Literal["recorder"] = "recorder"


@dataclass(slots=True)
class LibraryChanged:
    op: Literal["library"] = "library"


@dataclass(slots=True)
class ExportJob:
    """One export."""

    id: int
    recording: str
    format: str
    title: str  # description: "CSV, 12.5 s, 3 channels"
    state: Literal["waiting", "running", "done", "failed", "cancelled"]
    progress: float = 0.0  # 0..1
    size: int = 0
    file: str = ""
    message: str = ""
    hint: str = ""


@dataclass(slots=True)
class Exports:
    jobs: list[ExportJob]
    op: Literal["exports"] = "exports"


@dataclass(slots=True)
class JobsReport:
    devices: list[DeviceJobs]
    op: Literal["jobs"] = "jobs"


@dataclass(slots=True)
class Traffic:
    entries: list[TrafficEntry]
    op: Literal["traffic"] = "traffic"


@dataclass(slots=True)
class HistoryEnd:
    op: Literal["history_end"] = "history_end"


@dataclass(slots=True)
class Pong:
    t: float
    server_time: float
    op: Literal["pong"] = "pong"


@dataclass(slots=True)
class Problem:
    """The shape of every error, here and in HTTP responses."""

    kind: str
    message: str
    hint: str = ""
    op: Literal["error"] = "error"


@dataclass(slots=True)
class Subscribe:
    """The page discards its samples, appends live frames and prepends history frames (newest block first, each
    ending where the previous one began; flags bit 0).
    """

    history: float  # seconds of history wanted
    channels: list[int] | None = None  # None: all, also future ones
    op: Literal["subscribe"] = "subscribe"


@dataclass(slots=True)
class Interval:
    """Drawing interval of the page: a longer one reduces the load of server, network and page."""

    s: float  # minimum time between sample frames; 0: as often as the server sends
    op: Literal["interval"] = "interval"


@dataclass(slots=True)
class Ping:
    t: float
    op: Literal["ping"] = "ping"


ServerText = (
    Hello
    | Devices
    | Channels
    | HealthReport
    | UnknownPayloads
    | Events
    | JobsReport
    | Traffic
    | RecorderState
    | LibraryChanged
    | Exports
    | HistoryEnd
    | Pong
    | Problem
)
BrowserText = Subscribe | Interval | Ping
