/** Types of the wire. Generated from server/wire.py by `python -m server.generate_ts_types`; do not edit. */

export const SUBPROTOCOL = "imuscope.v1";
export const OPCODE_SAMPLES = 1;
/** Bit of `flags`: history. Prepend it; the newest block comes first, live frames may come between. */
export const FLAG_HISTORY = 1;
/** Size of a sample frame's header in bytes; the columns follow. */
export const HEADER_SIZE = 40;
/** Where each header field stands in a frame, in bytes (u8, u8, u16, u32, u32, u32, u64, u32, f64). */
export const HEADER = {
  opcode: 0,
  flags: 1,
  columns: 2,
  channel: 4,
  n: 8,
  dropped: 12,
  sequence: 16,
  size: 24,
  now: 32,
} as const;
/** Bytes of one value of each dtype. */
export const DTYPE_SIZE = {
  f4: 4,
  f8: 8,
  i1: 1,
  u1: 1,
  i2: 2,
  u2: 2,
  i4: 4,
  u4: 4,
  i8: 8,
  u8: 8,
} as const;

export type Dtype = "f4" | "f8" | "i1" | "u1" | "i2" | "u2" | "i4" | "u4" | "i8" | "u8";

export type Severity = "" | "caution" | "fault";

export type DeviceStatus = "connecting" | "live" | "lost" | "denied" | "idle" | "ended";

export type Wants = "" | "key" | "rearm";

export type EventKind = "gap" | "reject" | "clock" | "link" | "reply" | "text" | "marker" | "device" | "command";

export type Level = "info" | "caution" | "fault";

/** One flag (width 1) or bit group of a status column; drawn as a lane. */
export interface BitsInfo {
  readonly name: string;
  readonly low: number;
  readonly width: number;
  /** value (decimal, as JSON keys are strings) → meaning */
  readonly choices: Readonly<Record<string, string>>;
  readonly severity: Severity;
  readonly normal_set: boolean;
  readonly doc: string;
}

/** One column of a channel, after `arrival` and `time`. */
export interface ColumnInfo {
  /** unique in the channel: "x", "yaw", "itow", "q0" */
  readonly name: string;
  readonly dtype: Dtype;
  readonly unit: string;
  /** short label on the plot; "" means name */
  readonly label: string;
  /** which axis colour it has */
  readonly axis: "" | "x" | "y" | "z" | "w";
  readonly choices: Readonly<Record<string, string>>;
  readonly bits: readonly BitsInfo[];
  /** digits after the point; -1: the page chooses */
  readonly decimals: number;
  /** wraps at this value; 0: never */
  readonly period: number;
  readonly doc: string;
}

/** One quantity of one device. */
export interface ChannelInfo {
  readonly id: number;
  /** DeviceInfo.id */
  readonly device: string;
  /** the document's message name: "MTData2" */
  readonly message: string;
  /** the document's quantity name: "Acceleration" */
  readonly name: string;
  /** for a person: "Acceleration"; where a device sends several of one title, `group` tells them apart */
  readonly title: string;
  readonly kind: "vector" | "quaternion" | "matrix" | "euler" | "status" | "scalar" | "record" | "rows" | "counter";
  readonly unit: string;
  /** "ENU", "NED", "NWU", "ECEF", "ENU from body" or "" */
  readonly frame: string;
  readonly columns: readonly ColumnInfo[];
  readonly doc: string;
  readonly source: string;
  /** false: its samples are shown although nobody could check who sent them */
  readonly verified: boolean;
  /** the message it came in, for a person: "INS 1"; "" where a quantity stands for itself */
  readonly group: string;
}

/** One attempt to reach a device, in words. */
export interface Try {
  /** "921 600 Bd" */
  readonly what: string;
  /** "2 304 B, no frame in them" */
  readonly outcome: string;
  readonly time: number;
}

/** A device and the link it is on. */
export interface DeviceInfo {
  /** stable for this server run: "1"; of a further device on the link of "1": "1.102" */
  readonly id: string;
  /** what the rail shows: "MTi-630" */
  readonly name: string;
  /** as given: "/dev/ttyUSB0", "twin:xbus" */
  readonly source: string;
  readonly link: "serial" | "tcp" | "tcp-listen" | "udp" | "file" | "twin";
  readonly status: DeviceStatus;
  /** "xbus", "" while unknown */
  readonly protocol: string;
  /** "MTi-630 AHRS" */
  readonly product: string;
  readonly serial_number: string;
  readonly firmware: string;
  /** of its frames, where they differ: "Safety, CRC-32", "Secure, unverified: no key" */
  readonly protection: string;
  readonly baud: number | null;
  /** one sentence about the state: "/dev/ttyUSB0 is gone." */
  readonly message: string;
  /** what to do next */
  readonly hint: string;
  readonly tries: readonly Try[];
  /** unix seconds of the next attempt */
  readonly next_try: number | null;
  readonly last_arrival: number | null;
  /** standing remarks: a high USB latency timer and its fix */
  readonly notices: readonly string[];
  /** senders whose sequence restarted: an operator may re-arm them */
  readonly rearm: readonly string[];
  /** what it waits for while nothing of it can be shown */
  readonly wants: Wants;
  /** as which its timestamps are read, where that is a setting: "ms"; "" for the usual one */
  readonly time_unit: string;
  /** which way its quaternion turns, where that is a setting: "body_from_enu"; "" for the usual one */
  readonly rotation: string;
  /** the first device on the same link, where that has several; link, retry and removal are its own */
  readonly parent: string;
  /** its link: a device that is silent on an open one may still answer */
  readonly is_open: boolean;
  /** flags of its status words that this product does not have */
  readonly absent: readonly string[];
}

/** Figures of one message of one device. */
export interface MessageHealth {
  readonly name: string;
  /** samples/s over the last second */
  readonly rate: number;
  /** since the session began */
  readonly count: number;
}

/** What makes the arrival times of a device uneven, and what helps. */
export interface TimeCause {
  readonly kind: "bursts" | "resets" | "stalls" | "network";
  /** one sentence or two */
  readonly text: string;
  readonly remedy: string;
}

/**
 * Figures of one device; rates over the last second, counts since the session began. What was refused, verified
 * or not is counted since its bytes are read in this way: a key that is given later begins anew.
 */
export interface DeviceHealth {
  readonly device: string;
  readonly time: number;
  /** samples/s of the fastest message */
  readonly rate: number;
  readonly messages: readonly MessageHealth[];
  readonly gaps: number;
  /** samples that counters say are missing */
  readonly lost: number;
  readonly rejects: number;
  readonly bytes: number;
  readonly bytes_per_s: number;
  /** bytes/s the link can carry, where known */
  readonly capacity: number | null;
  /** p99 of arrival minus expected arrival over the last seconds */
  readonly jitter_ms: number | null;
  readonly last_arrival: number | null;
  /** device clock against host clock */
  readonly drift_ppm: number | null;
  /** ± of the mapping from device time to host time */
  readonly uncertainty_ms: number | null;
  /** reason → how many of `rejects`: "bad_checksum", "no_key" */
  readonly rejects_by: Readonly<Record<string, number>>;
  /** samples whose frames passed every check; null where a protocol does not tell */
  readonly verified: number | null;
  /** samples shown although their frames could not be checked */
  readonly unverified: number | null;
  /** samples dropped for this browser */
  readonly dropped: number;
  /** why arrival times are uneven; null while they are not */
  readonly time_cause: TimeCause | null;
}

/** The newest payload of a kind that nobody has described: a vendor's own type, a number newer than the tables. */
export interface RawPayload {
  readonly device: string;
  /** "0x80", "0x4FF0", "DID_RTK_DEBUG_2" */
  readonly name: string;
  /** its number in the protocol */
  readonly id: number;
  /** the message it came in, for a person */
  readonly message: string;
  /** since the session began */
  readonly count: number;
  /** per second */
  readonly rate: number;
  /** bytes of the payload */
  readonly size: number;
  /** its bytes, at most the first 1024 */
  readonly hex: string;
  /** of this one, unix seconds */
  readonly arrival: number;
  readonly doc: string;
  readonly verified: boolean;
}

/** Something that happened. `t0`..`t1` (host time) is the span it concerns: a gap is hatched there. */
export interface EventInfo {
  readonly seq: number;
  readonly time: number;
  /** "" for the server itself */
  readonly device: string;
  readonly kind: EventKind;
  readonly level: Level;
  readonly text: string;
  readonly t0: number | null;
  readonly t1: number | null;
  readonly samples: number;
  readonly data: Readonly<Record<string, unknown>>;
}

export interface Hello {
  readonly version: string;
  readonly server_time: number;
  readonly host: string;
  /** changes when the server restarts: a page then forgets its channels */
  readonly run: string;
  /** seconds kept in memory */
  readonly history: number;
  readonly op: "hello";
}

export interface Devices {
  readonly devices: readonly DeviceInfo[];
  readonly op: "devices";
}

export interface Channels {
  readonly channels: readonly ChannelInfo[];
  readonly op: "channels";
}

export interface HealthReport {
  readonly devices: readonly DeviceHealth[];
  readonly op: "health";
}

export interface Raws {
  readonly payloads: readonly RawPayload[];
  readonly op: "raws";
}

export interface Events {
  readonly events: readonly EventInfo[];
  readonly op: "events";
}

/** One frame of a command exchange, or a note between them. */
export interface ExchangeEntry {
  readonly seq: number;
  readonly time: number;
  readonly device: string;
  readonly way: "tx" | "rx" | "note";
  /** of the frame: "SetOutputConfiguration"; "" for a note */
  readonly name: string;
  readonly hex: string;
  /** what it says, or what was made of it: "12 of 12 entries as asked" */
  readonly text: string;
  /** an answer: time since the request */
  readonly ms: number | null;
  readonly level: Level;
}

/** A field that the device did not take as asked. */
export interface FieldOutcome {
  readonly setting: string;
  readonly path: string;
  readonly title: string;
  readonly asked: string;
  /** "" where it was refused */
  readonly got: string;
  readonly why: string;
}

/** One thing that is done, or waits to be done, to a device. */
export interface Job {
  readonly id: number;
  readonly device: string;
  /** "Write Output configuration" */
  readonly title: string;
  readonly state: "waiting" | "running" | "done" | "failed" | "stopped";
  /** what it is at: "GoToConfig, second try" */
  readonly step: string;
  /** of a finished one: one sentence */
  readonly message: string;
  readonly hint: string;
  /** the one taken before, or by it */
  readonly snapshot: string;
  /** the answer of a command */
  readonly values: Readonly<Record<string, unknown>>;
  readonly outcomes: readonly FieldOutcome[];
  readonly started: number | null;
  readonly ended: number | null;
}

/** Settings that go back unless a person keeps them. */
export interface Trial {
  readonly device: string;
  readonly state: "applying" | "asking" | "reverting" | "kept" | "reverted" | "unreachable";
  /** in words: "Baud rate 115 200 → 921 600" */
  readonly changes: readonly string[];
  /** "The device answers at 921 600 Bd. If you say nothing, it goes back to 115 200 Bd." */
  readonly words: string;
  /** unix seconds, while it asks */
  readonly deadline: number | null;
  readonly seconds: number;
}

/** What is done to one device. */
export interface ControlState {
  readonly device: string;
  /** "Measurement", "Config", "" where the protocol has none */
  readonly state: string;
  readonly running: Job | null;
  readonly queue: readonly Job[];
  /** the last five, newest first */
  readonly done: readonly Job[];
  readonly trial: Trial | null;
  /** what a command left open that a change of state discards: a reset that is not stored */
  readonly unfinished: string;
}

/** What is being recorded. */
export interface RecorderState {
  readonly running: boolean;
  /** RecordingInfo.id of the file that is written now */
  readonly id: string;
  readonly title: string;
  readonly devices: readonly string[];
  /** unix seconds */
  readonly started: number | null;
  /** of this recording, over all its parts */
  readonly bytes: number;
  /** age of the oldest byte that is not on its way to the disk */
  readonly behind_s: number;
  /** bytes left on the disk */
  readonly free: number | null;
  /** until it is full at this rate */
  readonly seconds_left: number | null;
  /** why it stopped by itself; "" otherwise */
  readonly message: string;
  readonly hint: string;
  readonly op: "recorder";
}

export interface LibraryChanged {
  readonly op: "library";
}

/** One export. */
export interface ExportJob {
  readonly id: number;
  readonly recording: string;
  readonly format: string;
  /** what it is, in words: "CSV, 12.5 s, 3 channels" */
  readonly title: string;
  readonly state: "waiting" | "running" | "done" | "failed" | "cancelled";
  /** 0..1 */
  readonly progress: number;
  readonly size: number;
  readonly file: string;
  readonly message: string;
  readonly hint: string;
}

export interface Exports {
  readonly jobs: readonly ExportJob[];
  readonly op: "exports";
}

export interface Control {
  readonly devices: readonly ControlState[];
  readonly op: "control";
}

export interface Exchange {
  readonly entries: readonly ExchangeEntry[];
  readonly op: "exchange";
}

export interface Backfilled {
  readonly op: "backfilled";
}

export interface Pong {
  readonly t: number;
  readonly server_time: number;
  readonly op: "pong";
}

/** The one shape of errors, here and in every HTTP answer. */
export interface Problem {
  readonly kind: string;
  readonly message: string;
  readonly hint: string;
  readonly op: "error";
}

/**
 * Starts afresh: the page forgets its samples, appends live frames and prepends history frames (newest block first,
 * each ending where the one before it began; flags bit 0).
 */
export interface Subscribe {
  /** seconds of history wanted */
  readonly history: number;
  /** None: all, also those that appear later */
  readonly channels: readonly number[] | null;
  readonly op: "subscribe";
}

/** How often the page draws: a slow display costs its server, its network and itself less. */
export interface Interval {
  /** between two frames of samples, at least; 0: as often as the server sends */
  readonly s: number;
  readonly op: "interval";
}

export interface Ping {
  readonly t: number;
  readonly op: "ping";
}

export type ServerText = Hello | Devices | Channels | HealthReport | Raws | Events | Control | Exchange | RecorderState | LibraryChanged | Exports | Backfilled | Pong | Problem;

export type BrowserText = Subscribe | Interval | Ping;
