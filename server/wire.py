"""The wire: what the server and the page say to each other. This docstring is its specification.

One WebSocket at `/ws`, subprotocol `imuscope.v1`, permessage-deflate off. Text frames are JSON objects with an `op`;
binary frames carry samples. TypeScript types are generated from the dataclasses below (`python -m
server.generate_ts_types` writes web/src/wire/types.ts; a test fails when that file is stale), so a field is added here
and nowhere else.

## Server to browser, text

    hello      first, once: versions, server clock, how much history is kept
    devices    every device with its link and state; the whole list, sent on every change
    channels   channels that the browser has not been told of yet (ids are never reused within a server run)
    health     figures of every device, twice a second; an older one not yet sent is replaced
    raws       payloads that nobody has described, as bytes, where there are any: with health, replaced likewise
    events     what happened, in order of `seq`; never dropped
    control    what is done to each device: its queue, the job that runs, a trial; the whole, sent on every change
    recorder   what is being recorded, once a second while it is; library: which recordings there are has changed;
               exports: every export that runs or waits to be fetched, on every change
    exchange   frames sent to devices, what they answered, and what was done about it, in order of `seq`; never dropped
    backfilled the answer to `subscribe`: everything older has been sent
    pong       the answer to `ping`: the browser estimates the server's clock from it
    error      the last request could not be served: {kind, message, hint}

## Browser to server, text

    subscribe  channels (null: all, also future ones) and how many seconds of history to send; replaces the last one
    interval   s: how often the page can use new samples; they come at most so often, and at least ten times a second
    ping       t: any number, returned
    (everything that changes something goes over HTTP)

## Samples, binary

A binary WebSocket message is one or more sample frames back to back. Little-endian; each frame:

    0   u8    opcode, 1 = samples
    1   u8    flags; bit 0: history (sent because of a subscribe, older than what was live then)
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

A channel is one quantity of one device (an MTData2 item, an ISB data set). The nine columns of a `matrix` are row by
row. A `rows` channel is a table: several rows share one time (satellites); the rows with the newest time are the table
now.

## History

A `subscribe` starts afresh: the page forgets the samples it holds. Live frames flow at once and are appended. Between
them come history frames, newest block first, so that a plot fills from its right edge leftwards and the newest seconds
are there at once on any link: within a frame samples ascend, and each history frame of a channel ends exactly where
the one before it began (`sequence + n` equals that frame's `sequence`; for the first, the sequence of the first live
sample). So history is prepended, live is appended, and nothing is sorted. `backfilled` follows the last history frame.

## Delivery

Samples may be dropped, oldest first, when a browser does not keep up; `dropped` says how many and `health` keeps the
total. Text is never dropped, except that an unsent `devices` or `health` is replaced by a newer one. A browser that
cannot take a byte for 5 s is disconnected. Nothing a browser does slows a device or a recording.

64-bit integers are BigInt64Array/BigUint64Array columns in binary frames. In JSON an integer beyond ±(2^53 − 1), which
JavaScript cannot hold, is a decimal string, bytes are a hex string, and a non-finite number is null.

When a device changes the layout of a quantity (float32 to float64, ENU to NED) a channel of the same name is advertised
anew; the one with the higher id is the one that lives.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any, Literal

SUBPROTOCOL = "imuscope.v1"
OPCODE_SAMPLES = 1
FLAG_HISTORY = 1
HEADER = struct.Struct("<BBHIIIQIId")
HEADER_FIELDS = ("opcode", "flags", "columns", "channel", "n", "dropped", "sequence", "size", "reserved", "now")
assert HEADER.size == 40

Dtype = Literal["f4", "f8", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"]
Severity = Literal["", "caution", "fault"]
DeviceStatus = Literal["connecting", "live", "lost", "denied", "idle", "ended"]
Wants = Literal["", "key", "rearm"]
EventKind = Literal["gap", "reject", "clock", "link", "reply", "text", "marker", "device", "command"]
Level = Literal["info", "caution", "fault"]


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
    axis: Literal["", "x", "y", "z", "w"] = ""  # which axis colour it has
    choices: dict[str, str] = field(default_factory=dict)
    bits: list[BitsInfo] = field(default_factory=list)
    decimals: int = -1  # digits after the point; -1: the page chooses
    period: float = 0.0  # wraps at this value; 0: never
    doc: str = ""


@dataclass(slots=True)
class ChannelInfo:
    """One quantity of one device."""

    id: int
    device: str  # DeviceInfo.id
    message: str  # the document's message name: "MTData2"
    name: str  # the document's quantity name: "Acceleration"
    title: str  # for a person: "Acceleration"; where a device sends several of one title, `group` tells them apart
    kind: Literal["vector", "quaternion", "matrix", "euler", "status", "scalar", "record", "rows", "counter"]
    unit: str
    frame: str  # "ENU", "NED", "NWU", "ECEF", "ENU from body" or ""
    columns: list[ColumnInfo]
    doc: str = ""
    source: str = ""
    verified: bool = True  # false: its samples are shown although nobody could check who sent them
    group: str = ""  # the message it came in, for a person: "INS 1"; "" where a quantity stands for itself


@dataclass(slots=True)
class Try:
    """One attempt to reach a device, in words."""

    what: str  # "921 600 Bd"
    outcome: str  # "2 304 B, no frame in them"
    time: float


@dataclass(slots=True)
class DeviceInfo:
    """A device and the link it is on."""

    id: str  # stable for this server run: "1"; of a further device on the link of "1": "1.102"
    name: str  # what the rail shows: "MTi-630"
    source: str  # as given: "/dev/ttyUSB0", "twin:xbus"
    link: Literal["serial", "tcp", "tcp-listen", "udp", "file", "twin"]
    status: DeviceStatus
    protocol: str = ""  # "xbus", "" while unknown
    product: str = ""  # "MTi-630 AHRS"
    serial_number: str = ""
    firmware: str = ""
    protection: str = ""  # of its frames, where they differ: "Safety, CRC-32", "Secure, unverified: no key"
    baud: int | None = None
    message: str = ""  # one sentence about the state: "/dev/ttyUSB0 is gone."
    hint: str = ""  # what to do next
    tries: list[Try] = field(default_factory=list)
    next_try: float | None = None  # unix seconds of the next attempt
    last_arrival: float | None = None
    notices: list[str] = field(default_factory=list)  # standing remarks: a high USB latency timer and its fix
    rearm: list[str] = field(default_factory=list)  # senders whose sequence restarted: an operator may re-arm them
    wants: Wants = ""  # what it waits for while nothing of it can be shown
    time_unit: str = ""  # as which its timestamps are read, where that is a setting: "ms"; "" for the usual one
    rotation: str = ""  # which way its quaternion turns, where that is a setting: "body_from_enu"; "" for the usual one
    parent: str = ""  # the first device on the same link, where that has several; link, retry and removal are its own
    is_open: bool = False  # its link: a device that is silent on an open one may still answer
    absent: list[str] = field(default_factory=list)  # flags of its status words that this product does not have


@dataclass(slots=True)
class MessageHealth:
    """Figures of one message of one device."""

    name: str
    rate: float  # samples/s over the last second
    count: int  # since the session began


@dataclass(slots=True)
class TimeCause:
    """What makes the arrival times of a device uneven, and what helps."""

    kind: Literal["bursts", "resets", "stalls", "network"]
    text: str  # one sentence or two
    remedy: str


@dataclass(slots=True)
class DeviceHealth:
    """Figures of one device; rates over the last second, counts since the session began. What was refused, verified
    or not is counted since its bytes are read in this way: a key that is given later begins anew."""

    device: str
    time: float
    rate: float  # samples/s of the fastest message
    messages: list[MessageHealth]
    gaps: int
    lost: int  # samples that counters say are missing
    rejects: int
    bytes: int
    bytes_per_s: float
    capacity: float | None  # bytes/s the link can carry, where known
    jitter_ms: float | None  # p99 of arrival minus expected arrival over the last seconds
    last_arrival: float | None
    drift_ppm: float | None  # device clock against host clock
    uncertainty_ms: float | None  # ± of the mapping from device time to host time
    rejects_by: dict[str, int] = field(default_factory=dict)  # reason → how many of `rejects`: "bad_checksum", "no_key"
    verified: int | None = None  # samples whose frames passed every check; null where a protocol does not tell
    unverified: int | None = None  # samples shown although their frames could not be checked
    dropped: int = 0  # samples dropped for this browser
    time_cause: TimeCause | None = None  # why arrival times are uneven; null while they are not


@dataclass(slots=True)
class RawPayload:
    """The newest payload of a kind that nobody has described: a vendor's own type, a number newer than the tables."""

    device: str
    name: str  # "0x80", "0x4FF0", "DID_RTK_DEBUG_2"
    id: int  # its number in the protocol
    message: str  # the message it came in, for a person
    count: int  # since the session began
    rate: float  # per second
    size: int  # bytes of the payload
    hex: str  # its bytes, at most the first 1024
    arrival: float  # of this one, unix seconds
    doc: str = ""
    verified: bool = True


@dataclass(slots=True)
class EventInfo:
    """Something that happened. `t0`..`t1` (host time) is the span it concerns: a gap is hatched there."""

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
    run: str  # changes when the server restarts: a page then forgets its channels
    history: float  # seconds kept in memory
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
class Raws:
    payloads: list[RawPayload]
    op: Literal["raws"] = "raws"


@dataclass(slots=True)
class Events:
    events: list[EventInfo]
    op: Literal["events"] = "events"


@dataclass(slots=True)
class ExchangeEntry:
    """One frame of a command exchange, or a note between them."""

    seq: int
    time: float
    device: str
    way: Literal["tx", "rx", "note"]
    name: str  # of the frame: "SetOutputConfiguration"; "" for a note
    hex: str = ""
    text: str = ""  # what it says, or what was made of it: "12 of 12 entries as asked"
    ms: float | None = None  # an answer: time since the request
    level: Level = "info"


@dataclass(slots=True)
class FieldOutcome:
    """A field that the device did not take as asked."""

    setting: str
    path: str
    title: str
    asked: str
    got: str  # "" where it was refused
    why: str = ""


@dataclass(slots=True)
class Job:
    """One thing that is done, or waits to be done, to a device."""

    id: int
    device: str
    title: str  # "Write Output configuration"
    state: Literal["waiting", "running", "done", "failed", "stopped"]
    step: str = ""  # what it is at: "GoToConfig, second try"
    message: str = ""  # of a finished one: one sentence
    hint: str = ""
    snapshot: str = ""  # the one taken before, or by it
    values: dict[str, Any] = field(default_factory=dict)  # the answer of a command
    outcomes: list[FieldOutcome] = field(default_factory=list)
    started: float | None = None
    ended: float | None = None


@dataclass(slots=True)
class Trial:
    """Settings that go back unless a person keeps them."""

    device: str
    state: Literal["applying", "asking", "reverting", "kept", "reverted", "unreachable"]
    changes: list[str]  # in words: "Baud rate 115 200 → 921 600"
    words: str  # "The device answers at 921 600 Bd. If you say nothing, it goes back to 115 200 Bd."
    deadline: float | None = None  # unix seconds, while it asks
    seconds: float = 20.0


@dataclass(slots=True)
class ControlState:
    """What is done to one device."""

    device: str
    state: str  # "Measurement", "Config", "" where the protocol has none
    running: Job | None = None
    queue: list[Job] = field(default_factory=list)
    done: list[Job] = field(default_factory=list)  # the last five, newest first
    trial: Trial | None = None
    unfinished: str = ""  # what a command left open that a change of state discards: a reset that is not stored


@dataclass(slots=True)
class RecorderState:
    """What is being recorded."""

    running: bool
    id: str = ""  # RecordingInfo.id of the file that is written now
    title: str = ""
    devices: list[str] = field(default_factory=list)
    started: float | None = None  # unix seconds
    bytes: int = 0  # of this recording, over all its parts
    behind_s: float = 0.0  # age of the oldest byte that is not on its way to the disk
    free: int | None = None  # bytes left on the disk
    seconds_left: float | None = None  # until it is full at this rate
    message: str = ""  # why it stopped by itself; "" otherwise
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
    title: str  # what it is, in words: "CSV, 12.5 s, 3 channels"
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
class Control:
    devices: list[ControlState]
    op: Literal["control"] = "control"


@dataclass(slots=True)
class Exchange:
    entries: list[ExchangeEntry]
    op: Literal["exchange"] = "exchange"


@dataclass(slots=True)
class Backfilled:
    op: Literal["backfilled"] = "backfilled"


@dataclass(slots=True)
class Pong:
    t: float
    server_time: float
    op: Literal["pong"] = "pong"


@dataclass(slots=True)
class Problem:
    """The one shape of errors, here and in every HTTP answer."""

    kind: str
    message: str
    hint: str = ""
    op: Literal["error"] = "error"


@dataclass(slots=True)
class Subscribe:
    """Starts afresh: the page forgets its samples, appends live frames and prepends history frames (newest block first,
    each ending where the one before it began; flags bit 0)."""

    history: float  # seconds of history wanted
    channels: list[int] | None = None  # None: all, also those that appear later
    op: Literal["subscribe"] = "subscribe"


@dataclass(slots=True)
class Interval:
    """How often the page draws: a slow display costs its server, its network and itself less."""

    s: float  # between two frames of samples, at least; 0: as often as the server sends
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
    | Raws
    | Events
    | Control
    | Exchange
    | RecorderState
    | LibraryChanged
    | Exports
    | Backfilled
    | Pong
    | Problem
)
BrowserText = Subscribe | Interval | Ping
