"""The wire: protocol between the server and the page. This docstring is its specification.

One WebSocket at `/ws`, subprotocol `imuscope.v1`, permessage-deflate off. Text frames are JSON objects with an `op`;
binary frames carry samples. TypeScript types are generated from the dataclasses of this package (`python
-m imuscope.server.generators` writes web/src/wire/types.ts, and the check does), so fields are added only here.

## Server to browser, text

    hello             first, once: versions, server clock, length of history, capabilities of this server
                      (server/wire/capabilities.py)
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

import struct

from imuscope.server.wire.channels import (
    BitsInfo,
    ChannelInfo,
    ColumnInfo,
    Dtype,
    Severity,
)
from imuscope.server.wire.devices import (
    Attempt,
    Behind,
    BusyReason,
    DeviceHealth,
    DeviceInfo,
    DeviceStatus,
    JitterCause,
    MessageHealth,
    RequiredAction,
    UnknownPayload,
    key_of,
    lasting_name,
)
from imuscope.server.wire.events import (
    EventInfo,
    EventKind,
    Level,
)
from imuscope.server.wire.jobs import (
    DeviceJobs,
    FieldOutcome,
    Job,
    PendingRollback,
    TrafficEntry,
)
from imuscope.server.wire.messages import (
    BrowserText,
    Channels,
    Devices,
    Events,
    Exports,
    HealthReport,
    Hello,
    HistoryEnd,
    Interval,
    JobsReport,
    LibraryChanged,
    Ping,
    Pong,
    Problem,
    ServerText,
    Subscribe,
    Traffic,
    UnknownPayloads,
)
from imuscope.server.wire.recordings import (
    ExportJob,
    RecorderState,
)

__all__ = [
    "FLAG_HISTORY",
    "HEADER",
    "HEADER_FIELDS",
    "OPCODE_SAMPLES",
    "SUBPROTOCOL",
    "Attempt",
    "Behind",
    "BitsInfo",
    "BrowserText",
    "BusyReason",
    "ChannelInfo",
    "Channels",
    "ColumnInfo",
    "DeviceHealth",
    "DeviceInfo",
    "DeviceJobs",
    "DeviceStatus",
    "Devices",
    "Dtype",
    "EventInfo",
    "EventKind",
    "Events",
    "ExportJob",
    "Exports",
    "FieldOutcome",
    "HealthReport",
    "Hello",
    "HistoryEnd",
    "Interval",
    "JitterCause",
    "Job",
    "JobsReport",
    "Level",
    "LibraryChanged",
    "MessageHealth",
    "PendingRollback",
    "Ping",
    "Pong",
    "Problem",
    "RecorderState",
    "RequiredAction",
    "ServerText",
    "Severity",
    "Subscribe",
    "Traffic",
    "TrafficEntry",
    "UnknownPayload",
    "UnknownPayloads",
    "key_of",
    "lasting_name",
]

SUBPROTOCOL = "imuscope.v1"
OPCODE_SAMPLES = 1
FLAG_HISTORY = 1
HEADER = struct.Struct("<BBHIIIQIId")
HEADER_FIELDS = ("opcode", "flags", "columns", "channel", "n", "dropped", "sequence", "size", "reserved", "now")
assert HEADER.size == 40
