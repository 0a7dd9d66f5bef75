/** Types of the forms. Generated from server/configuration/api_models.py by `python -m server.generate_ts_types`; do not edit. */

import type { BitsInfo } from "../wire/types";

export type Editor = "number" | "integer" | "choice" | "flags" | "bool" | "text" | "hex" | "record" | "list" | "vector";

export type CautionKind = "" | "restarts" | "stops-output" | "cuts-line" | "loses-settings" | "wears-flash" | "moves-frame";

export type Side = "device" | "factory" | "snapshot" | "text" | "other";

/** One field to fill in. */
export interface FieldForm {
  readonly name: string;
  readonly title: string;
  readonly editor: Editor;
  /** of the shown value */
  readonly unit: string;
  /** shown = wire × scale + bias */
  readonly scale: number;
  readonly bias: number;
  /** allowed wire values */
  readonly low: number | null;
  readonly high: number | null;
  /** 1 for integers */
  readonly step: number | null;
  readonly default: unknown;
  readonly decimals: number;
  /** bytes or characters of a text or hex; elements of a vector; 0: open */
  readonly length: number;
  /** greatest number of list elements; 0: what the payload holds */
  readonly most: number;
  readonly axes: readonly string[];
  /** value (decimal) → meaning */
  readonly choices: Readonly<Record<string, string>>;
  readonly bits: readonly BitsInfo[];
  /** of a record, or of each element of a list */
  readonly fields: readonly FieldForm[];
  readonly simple: boolean;
  readonly read_only: boolean;
  /** 16: an identifier, shown in hex as on the label */
  readonly base: number;
  /** texts that a text field is known to take */
  readonly options: readonly string[];
  readonly doc: string;
  readonly source: string;
}

/** Values that the device keeps. */
export interface SettingForm {
  readonly name: string;
  readonly title: string;
  readonly group: string;
  readonly fields: readonly FieldForm[];
  readonly writable: boolean;
  /** single fields can be written alone */
  readonly partial: boolean;
  readonly editor: "" | "outputs" | "streams";
  /** when a written value takes effect */
  readonly after: "" | "measurement" | "reset";
  readonly caution: CautionKind;
  readonly consequence: string;
  readonly simple: boolean;
  readonly doc: string;
  readonly source: string;
}

/** Something the device can be told or asked. */
export interface CommandForm {
  readonly name: string;
  readonly title: string;
  readonly group: string;
  readonly kind: "ask" | "set" | "do";
  readonly arguments: readonly FieldForm[];
  readonly reply: string;
  readonly caution: CautionKind;
  readonly consequence: string;
  readonly simple: boolean;
  readonly doc: string;
  readonly source: string;
  /** argument → values to which no caution applies */
  readonly harmless: Readonly<Record<string, readonly number[]>>;
  /** the setting of which its arguments are the fields: its form opens with what the device has */
  readonly writes: string;
}

/** One quantity that an Xsens output configuration can ask for. */
export interface OutputChoice {
  /** with Float32 and ENU where they can be chosen */
  readonly data_identifier: number;
  readonly title: string;
  readonly group: string;
  /** allowed, Hz, fastest first; empty: with every message (0xFFFF) */
  readonly rates: readonly number[];
  /** precision bits that it can have; empty: fixed */
  readonly formats: readonly number[];
  /** coordinate bits that it can have; empty: fixed */
  readonly frames: readonly number[];
  /** bytes of its data at Float32 */
  readonly size: number;
  readonly unit: string;
  readonly simple: boolean;
  readonly doc: string;
}

/** One data set that an Inertial Sense device can stream. */
export interface StreamChoice {
  readonly did: number;
  readonly name: string;
  readonly title: string;
  readonly group: string;
  /** bytes of its data; −1: as long as there is to tell */
  readonly size: number;
  /** bit of the RMC word; −1: by GET_DATA only */
  readonly rmc_bit: number;
  /** period of one, ms; 0: not known before the device has told */
  readonly source_ms: number;
  readonly simple: boolean;
  readonly doc: string;
}

/** Every setting and command of a device. */
export interface Forms {
  readonly protocol: string;
  readonly product: string;
  readonly serial_number: string;
  readonly firmware: string;
  /** in the order in which they are listed */
  readonly groups: readonly string[];
  readonly settings: readonly SettingForm[];
  readonly commands: readonly CommandForm[];
  readonly outputs: readonly OutputChoice[];
  readonly streams: readonly StreamChoice[];
  /** takes RTCM */
  readonly corrections: boolean;
  /** the document tells its factory settings */
  readonly factory: boolean;
  /** what is not known yet, in one sentence */
  readonly note: string;
}

/** A few bytes of a frame and what they mean. */
export interface SpanInfo {
  readonly offset: number;
  readonly size: number;
  readonly label: string;
  /** the field: "outputs.3.output_frequency"; "" for the envelope */
  readonly path: string;
}

export interface FrameInfo {
  readonly name: string;
  readonly hex: string;
  readonly spans: readonly SpanInfo[];
}

/** What is wrong with a value, said where it is typed. */
export interface FieldProblem {
  readonly path: string;
  readonly message: string;
  readonly hint: string;
}

export interface PartInfo {
  readonly path: string;
  readonly title: string;
  readonly bytes_per_s: number;
}

/** What the line has to carry. */
export interface LoadInfo {
  readonly parts: readonly PartInfo[];
  /** bytes/s */
  readonly total: number;
  /** bytes/s, at the rate that will be in effect; null where the link has no such limit */
  readonly capacity: number | null;
  readonly baud: number | null;
  /** per-message limits that are broken */
  readonly limits: readonly string[];
  /** bytes/s now */
  readonly measured: number | null;
}

/** Exactly one of `setting` and `command`. */
export interface Preview {
  readonly values: Readonly<Record<string, unknown>>;
  readonly setting: string;
  readonly command: string;
}

export interface PreviewAnswer {
  readonly frames: readonly FrameInfo[];
  readonly problems: readonly FieldProblem[];
  readonly load: LoadInfo | null;
  /** how this change could cut the line; "" when it cannot */
  readonly line: string;
}

export interface ReadWish {
  readonly settings: readonly string[] | null;
  /** kept with the snapshot */
  readonly reason: string;
  /** what a command left unfinished (ControlState.unfinished) may be discarded */
  readonly confirmed: boolean;
}

/** Settings to write: whole ones, or single fields where the setting is `partial`. */
export interface Apply {
  readonly changes: Readonly<Record<string, Readonly<Record<string, unknown>>>>;
  readonly reason: string;
  /** the person has read the consequence; without it a dangerous change is refused (409) */
  readonly confirmed: boolean;
  /** further devices of the same protocol that get the same */
  readonly devices: readonly string[];
  /** whose settings these are (a profile's); a device of another product asks once more (409) */
  readonly product: string;
  /** what the settings were when they were edited: where */
  readonly base: Readonly<Record<string, Readonly<Record<string, unknown>>>>;
}

export interface Run {
  readonly command: string;
  readonly values: Readonly<Record<string, unknown>>;
  readonly confirmed: boolean;
}

export interface Raw {
  readonly hex: string;
  readonly confirmed: boolean;
}

export interface Keep {
  readonly title: string;
  /** YAML; "" keeps what the device has now */
  readonly text: string;
}

/** One side of a comparison. */
export interface SideRef {
  readonly side: Side;
  /** SnapshotInfo.name, for "snapshot" */
  readonly snapshot: string;
  /** DeviceInfo.id, for "other"; for "snapshot" whose it is, "" for this device's */
  readonly device: string;
  /** YAML, for "text" */
  readonly text: string;
}

export interface Compare {
  readonly left: SideRef;
  readonly right: SideRef;
}

export interface DifferenceRow {
  readonly setting: string;
  readonly path: string;
  readonly title: string;
  readonly unit: string;
  /** in words: "400 Hz", "ENU"; "" where that side does not have it */
  readonly left: string;
  readonly right: string;
  /** wire value */
  readonly left_value: unknown;
  readonly right_value: unknown;
  readonly writable: boolean;
}

export interface Difference {
  /** what it is: "Device now", "Before this change, 14:31" */
  readonly left: string;
  readonly right: string;
  readonly rows: readonly DifferenceRow[];
  /** fields that agree */
  readonly same: number;
  /** setting → why it could not be compared */
  readonly missing: Readonly<Record<string, string>>;
  /** as Apply takes them, to make left what right is */
  readonly changes: Readonly<Record<string, Readonly<Record<string, unknown>>>>;
  /** all of the right side that can be written */
  readonly profile: Readonly<Record<string, Readonly<Record<string, unknown>>>>;
  /** of the right side; "" where it is not known */
  readonly product: string;
  /** what is wrong with the right side, at its path */
  readonly problems: readonly FieldProblem[];
  /** what writing the right side to the device could cost */
  readonly dangers: readonly string[];
  /** why it cannot be written: more than the line carries */
  readonly blocked: string;
}

export interface Fit {
  readonly values: Readonly<Record<string, unknown>>;
  readonly setting: string;
  /** null: the present rate */
  readonly baud: number | null;
}

export interface FitAnswer {
  readonly values: Readonly<Record<string, unknown>>;
  readonly load: LoadInfo;
  /** what was lowered: "Acceleration 400 → 100 Hz" */
  readonly words: readonly string[];
}

export interface SnapshotInfo {
  /** file name without suffix, unique per serial number */
  readonly name: string;
  /** "Before this change", "First contact" */
  readonly title: string;
  /** unix seconds */
  readonly taken: number;
  readonly reason: string;
  readonly product: string;
  readonly serial_number: string;
  readonly firmware: string;
  readonly settings: number;
  readonly missing: number;
  readonly pinned: boolean;
  /** by this version; if not, `reason` says why, and what to do */
  readonly readable: boolean;
}

export interface SnapshotBody {
  readonly info: SnapshotInfo;
  readonly values: Readonly<Record<string, Readonly<Record<string, unknown>>>>;
  /** setting → why it is not there */
  readonly missing: Readonly<Record<string, string>>;
}

/** A stream of RTCM 3 forwarded to the device in whole messages. */
export interface Corrections {
  /** ntrip://user:password@host:2101/MOUNT, tcp://host:port, a file; the password is never told again */
  readonly source: string;
  /** it goes on by itself, and is tried again where it broke */
  readonly running: boolean;
  /** the last message reached the device; false while the source or the link refuses */
  readonly forwarding: boolean;
  readonly message: string;
  readonly hint: string;
  /** since the last message that was forwarded */
  readonly age_s: number | null;
  readonly bytes_per_s: number;
  /** RTCM message number → how many */
  readonly messages: Readonly<Record<string, number>>;
  readonly rejected: number;
  /** forwarded, and the device said no */
  readonly refused: number;
}
