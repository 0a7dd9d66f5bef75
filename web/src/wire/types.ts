/** Types of the wire. Generated from server/wire/ by `python -m imuscope.server.generators.ts_types`; do not edit. */

export const SUBPROTOCOL = "imuscope.v1";
export const OPCODE_SAMPLES = 1;
/** Bit of `flags`: history. Prepend it; the newest block is sent first, live frames may come between. */
export const FLAG_HISTORY = 1;
/** Size of a sample frame's header in bytes; the columns follow. */
export const HEADER_SIZE = 40;
/** Offset of each header field in a frame, in bytes (u8, u8, u16, u32, u32, u32, u64, u32, f64). */
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

import type { Capabilities } from "./capability-types";

export type Dtype = "f4" | "f8" | "i1" | "u1" | "i2" | "u2" | "i4" | "u4" | "i8" | "u8";

export type Severity = "" | "warning" | "error";

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
  /** determines its colour */
  readonly axis: "" | "x" | "y" | "z" | "w";
  readonly choices: Readonly<Record<string, string>>;
  readonly bits: readonly BitsInfo[];
  /** digits after the decimal point; -1: chosen by the page */
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
  /** message name in the protocol document: "MTData2" */
  readonly message: string;
  /** quantity name in the protocol document: "Acceleration" */
  readonly name: string;
  /** displayed: "Acceleration"; if a device sends several with one title, `group` distinguishes them */
  readonly title: string;
  readonly kind: "vector" | "quaternion" | "matrix" | "euler" | "status" | "scalar" | "record" | "table" | "counter";
  readonly unit: string;
  /** "ENU", "NED", "NWU", "ECEF", "ENU from body" or "" */
  readonly frame: string;
  readonly columns: readonly ColumnInfo[];
  readonly doc: string;
  readonly source: string;
  /** false: its samples are shown although their sender could not be verified */
  readonly verified: boolean;
  /** displayed name of its message: "INS 1"; "" if the title is sufficient */
  readonly group: string;
}

export type DeviceStatus = "connecting" | "live" | "lost" | "denied" | "idle" | "ended";

export type RequiredAction = "" | "key" | "rearm";

/** One attempt to connect to a device, as text. */
export interface Attempt {
  /** "921 600 Bd" */
  readonly what: string;
  /** "2 304 B, no frame in them" */
  readonly outcome: string;
  readonly time: number;
}

/** A device and the link it is on. */
export interface DeviceInfo {
  /** of its source, in later runs too: "1"; of a further device on the link of "1": "1.102" */
  readonly id: string;
  /** displayed name of the product: "MTi-630" */
  readonly name: string;
  /** as given: "/dev/ttyUSB0", "sim:xbus" */
  readonly source: string;
  /** a name of LinkCapability: "serial", "tcp", "file" */
  readonly link: string;
  readonly status: DeviceStatus;
  /** "xbus", "" while unknown */
  readonly protocol: string;
  /** "MTi-630 AHRS" */
  readonly product: string;
  readonly serial_number: string;
  readonly firmware: string;
  /** of its frames, if the protocol has several: "Safety, CRC-32", "Secure, unverified: no key" */
  readonly protection: string;
  readonly baud: number | null;
  /** one sentence about the state: "/dev/ttyUSB0 is gone." */
  readonly message: string;
  /** next step for the user */
  readonly hint: string;
  readonly attempts: readonly Attempt[];
  /** unix seconds of the next attempt */
  readonly next_attempt: number | null;
  readonly last_arrival: number | null;
  /** permanent notices: a high USB latency timer and its fix */
  readonly notices: readonly string[];
  /** senders whose sequence restarted: an operator may re-arm them */
  readonly rearm: readonly string[];
  /** what the user has to do, while no data can be shown */
  readonly required_action: RequiredAction;
  /** given ones by name, without secrets and files */
  readonly decode_options: Readonly<Record<string, string>>;
  /** first device on the same link, if there are several; link, retry and removal belong to it */
  readonly parent: string;
  /** state of its link: a silent device on an open link may still answer */
  readonly is_open: boolean;
  /** flags of its status words that this product does not have */
  readonly absent: readonly string[];
  /** names the sensor on any port and in later runs: "xbus-0080800006"; its source if it sent no number */
  readonly key: string;
  /** given by users, stored with the key; "" if none */
  readonly own_name: string;
  /** command that makes a device send again that is quiet for a known reason: "GoToMeasurement" */
  readonly resume: string;
  /** name under which others subscribe to it, in later runs too: "imu", "imu_2"; "" of a file */
  readonly topic: string;
  /** displayed name when it was identified last, before this run; "" if it never was */
  readonly former_name: string;
  /** unix s at which it became quiet for a known reason, which `message` gives */
  readonly quiet_since: number | null;
  /** a simulator made its data, also those of a recording that is played */
  readonly simulated: boolean;
  /** unix seconds at which its link came back: another sensor may be there */
  readonly unconfirmed_since: number | null;
}

/** Figures of one message of one device. */
export interface MessageHealth {
  readonly name: string;
  /** samples/s over the last second */
  readonly rate: number;
  /** since the session began */
  readonly count: number;
}

/** Cause of uneven arrival times, and its remedy. */
export interface JitterCause {
  readonly kind: "bursts" | "resets" | "stalls" | "network";
  /** one sentence or two */
  readonly text: string;
  readonly remedy: string;
}

export type BusyReason = "" | "others" | "decoding";

/** Time by which the newest samples of a device are late, s, by where that arises; 0 while all keeps up. */
export interface Behind {
  /** until its bytes arrive here, by the device's clock, over its fastest ones */
  readonly link: number;
  /** of the oldest bytes that have arrived and are not decoded */
  readonly decoding: number;
  /** why decoding is behind, if it is and that is known */
  readonly reason: BusyReason;
}

/**
 * Figures of one device; rates over the last second, counts since the session began. Rejected, verified and
 * unverified frames are counted since the decode options were set: a new key restarts these counts.
 */
export interface DeviceHealth {
  readonly device: string;
  readonly time: number;
  /** samples/s of the fastest message */
  readonly rate: number;
  readonly messages: readonly MessageHealth[];
  readonly gaps: number;
  /** missing samples, according to counters */
  readonly lost: number;
  readonly rejects: number;
  readonly bytes: number;
  readonly bytes_per_s: number;
  /** bytes/s the link can carry, if known */
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
  /** bytes that belong to no accepted frame and no known message; those of rejected frames count */
  readonly unclaimed: number;
  /** samples whose frames passed all checks; null if the protocol has no such check */
  readonly verified: number | null;
  /** samples shown although their frames could not be checked */
  readonly unverified: number | null;
  /** samples dropped for this browser */
  readonly dropped: number;
  /** measured here; a page adds its own part */
  readonly behind: Behind;
  /** cause of uneven arrival times; null while they are even */
  readonly jitter_cause: JitterCause | null;
  /** samples received that counters number; lost ones are a share of both together */
  readonly numbered: number;
}

/** Newest payload of a type without a description: a vendor-specific type, or one newer than the tables. */
export interface UnknownPayload {
  readonly device: string;
  /** "0x80", "0x4FF0", "DID_RTK_DEBUG_2" */
  readonly name: string;
  /** type number in the protocol */
  readonly id: number;
  /** displayed name of its message */
  readonly message: string;
  /** since the session began */
  readonly count: number;
  /** per second */
  readonly rate: number;
  /** bytes of the payload */
  readonly size: number;
  /** at most its first 1024 bytes */
  readonly hex: string;
  /** of this one, unix seconds */
  readonly arrival: number;
  readonly doc: string;
  readonly verified: boolean;
}

export type EventKind = "gap" | "reject" | "clock" | "link" | "reply" | "text" | "marker" | "device" | "command" | "alarm";

export type Level = "info" | "warning" | "error";

/** An event. `t0`..`t1` (host time) is the time span concerned, for example hatched as a gap. */
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

/** One frame of a transaction, or a note between frames. */
export interface TrafficEntry {
  readonly seq: number;
  readonly time: number;
  readonly device: string;
  readonly direction: "tx" | "rx" | "note";
  /** of the frame: "SetOutputConfiguration"; "" for a note */
  readonly name: string;
  readonly hex: string;
  /** decoded content or result: "12 of 12 entries as requested" */
  readonly text: string;
  /** for an answer: time since the request */
  readonly ms: number | null;
  readonly level: Level;
}

/** A field whose requested value the device did not accept. */
export interface FieldOutcome {
  readonly setting: string;
  readonly path: string;
  readonly title: string;
  readonly requested: string;
  /** "" if it was rejected */
  readonly actual: string;
  /** if there is no answer or it was rejected */
  readonly reason: string;
}

/** One task of a device, queued, running or finished. */
export interface Job {
  readonly id: number;
  readonly device: string;
  /** "Write Output configuration" */
  readonly title: string;
  readonly state: "waiting" | "running" | "done" | "failed" | "stopped";
  /** current step: "GoToConfig, second try" */
  readonly step: string;
  /** result of a finished job, one sentence */
  readonly message: string;
  readonly hint: string;
  /** name of the snapshot taken before or by the job */
  readonly snapshot: string;
  /** the answer of a command */
  readonly values: Readonly<Record<string, unknown>>;
  readonly outcomes: readonly FieldOutcome[];
  readonly started: number | null;
  readonly ended: number | null;
}

/** Settings that are rolled back unless the user confirms them. */
export interface PendingRollback {
  readonly device: string;
  readonly state: "applying" | "pending" | "rolling-back" | "confirmed" | "rolled-back" | "unreachable";
  /** as text: "Baud rate 115 200 → 921 600" */
  readonly changes: readonly string[];
  /** "The device answers at 921 600 Bd. Unless confirmed, it goes back to 115 200 Bd." */
  readonly words: string;
  /** unix seconds, while pending */
  readonly deadline: number | null;
  readonly seconds: number;
}

/** Queue and state of one device. */
export interface DeviceJobs {
  readonly device: string;
  /** "Measurement", "Config", "" if the protocol has no states */
  readonly state: string;
  readonly running: Job | null;
  readonly queue: readonly Job[];
  /** the last five, newest first */
  readonly done: readonly Job[];
  readonly pending_rollback: PendingRollback | null;
  /** unfinished work of a command, lost on a change of state: a reset that is not stored */
  readonly unfinished: string;
}

/** Whether a recording runs, its file, size and problem. */
export interface RecorderState {
  readonly running: boolean;
  /** RecordingInfo.id of the file being written */
  readonly id: string;
  readonly title: string;
  readonly devices: readonly string[];
  /** unix seconds */
  readonly started: number | null;
  /** size of this recording, all parts */
  readonly bytes: number;
  /** age of the oldest byte not yet passed to the disk */
  readonly behind_s: number;
  /** free bytes on the disk */
  readonly free: number | null;
  /** until the disk is full, at the present rate */
  readonly seconds_left: number | null;
  /** why it stopped unexpectedly; "" otherwise */
  readonly message: string;
  readonly hint: string;
  /** names of MTi whose configuration is not in it, for an .mtb */
  readonly headless: readonly string[];
  readonly op: "recorder";
}

/** State, progress and result of an export. */
export interface ExportJob {
  readonly id: number;
  readonly recording: string;
  readonly format: string;
  /** description: "CSV, 12.5 s, 3 channels" */
  readonly title: string;
  readonly state: "waiting" | "running" | "done" | "failed" | "cancelled";
  /** 0..1 */
  readonly progress: number;
  readonly size: number;
  readonly file: string;
  readonly message: string;
  readonly hint: string;
}

export interface Hello {
  readonly version: string;
  readonly server_time: number;
  readonly host: string;
  /** changes when the server restarts; the page then discards its channels */
  readonly run: string;
  /** seconds kept in memory */
  readonly history: number;
  readonly capabilities: Capabilities;
  /** what the token of this client allows */
  readonly role: "view" | "control";
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

export interface UnknownPayloads {
  readonly payloads: readonly UnknownPayload[];
  readonly op: "unknown_payloads";
}

export interface Events {
  readonly events: readonly EventInfo[];
  readonly op: "events";
}

export interface LibraryChanged {
  readonly op: "library";
}

export interface Exports {
  readonly jobs: readonly ExportJob[];
  readonly op: "exports";
}

export interface JobsReport {
  readonly devices: readonly DeviceJobs[];
  readonly op: "jobs";
}

export interface Traffic {
  readonly entries: readonly TrafficEntry[];
  readonly op: "traffic";
}

export interface HistoryEnd {
  readonly op: "history_end";
}

export interface Pong {
  readonly t: number;
  readonly server_time: number;
  readonly op: "pong";
}

/** The shape of every error, here and in HTTP responses. */
export interface Problem {
  readonly kind: string;
  readonly message: string;
  readonly hint: string;
  readonly op: "error";
}

/**
 * The page discards its samples, appends live frames and prepends history frames (newest block first, each
 * ending where the previous one began; flags bit 0).
 */
export interface Subscribe {
  /** seconds of history wanted, before the newest sample of each device */
  readonly history: number;
  /** None: all, also future ones */
  readonly channels: readonly number[] | null;
  readonly op: "subscribe";
}

/** Drawing interval of the page: a longer one reduces the load of server, network and page. */
export interface Interval {
  /** minimum time between sample frames; 0: as often as the server sends */
  readonly s: number;
  readonly op: "interval";
}

export interface Ping {
  readonly t: number;
  readonly op: "ping";
}

export type ServerText = Hello | Devices | Channels | HealthReport | UnknownPayloads | Events | JobsReport | Traffic | RecorderState | LibraryChanged | Exports | HistoryEnd | Pong | Problem;

export type BrowserText = Subscribe | Interval | Ping;
