/** Types of the forms. Generated from server/configuration/api_models.py by `python -m imuscope.server.generators.ts_types`; do not edit. */

import type { BitsInfo } from "./types";

/** A few bytes of a frame and their meaning. */
export interface ByteRange {
  readonly offset: number;
  readonly size: number;
  readonly label: string;
  /** the field: "outputs.3.output_frequency"; "" for the envelope */
  readonly path: string;
}

/** Bytes and messages per second that one output adds to the link. */
export interface OutputLoad {
  /** the output in its setting: "outputs.3"; "" for what belongs to none */
  readonly path: string;
  readonly title: string;
  readonly bytes_per_s: number;
}

/** Meaning of a field while another field of its record has certain values; in place of what the field says. */
export interface Meaning {
  /** of the other field; empty: all that no meaning before names */
  readonly values: readonly number[];
  readonly title: string;
  readonly unit: string;
  /** shown = wire × scale */
  readonly scale: number;
  readonly decimals: number;
  /** allowed wire values; null: those of the field */
  readonly low: number | null;
  readonly high: number | null;
  /** the unsigned wire value is a two's complement; low and high are signed */
  readonly signed: boolean;
  readonly doc: string;
}

/** Texts that the device lists in a setting. */
export interface TextList {
  readonly setting: string;
  /** field of the setting: a list of records */
  readonly records: string;
  /** field of a record */
  readonly text: string;
  /** field that is 0 in an unused record */
  readonly used: string;
}

export interface VariantChoice {
  /** of the key */
  readonly bits: number;
  /** "Float32" */
  readonly words: string;
}

/** A property of an output that is in bits of its key. */
export interface KeyVariant {
  /** class of its column: "precision", "frame" */
  readonly name: string;
  readonly title: string;
  readonly mask: number;
  readonly choices: readonly VariantChoice[];
  /** words for an output without a choice */
  readonly fixed: string;
}

/** One quantity that a device can send. */
export interface RateRow {
  /** its key, without variants */
  readonly id: number;
  readonly title: string;
  readonly group: string;
  /** in the vendor's documents */
  readonly name: string;
  /** allowed, Hz, fastest first; empty: with every message */
  readonly rates: readonly number[];
  /** variant → available bits */
  readonly variants: Readonly<Record<string, readonly number[]>>;
  /** at divisor 1; 0: unknown until the device reports it */
  readonly interval_ms: number;
  readonly basic: boolean;
  readonly doc: string;
}

/** The table of a list: names of the fields of its entries, and its rows. */
export interface RateTable {
  /** field with the number of the quantity */
  readonly key: string;
  /** field with the rate, or the divisor */
  readonly rate: string;
  /** of the column of titles */
  readonly heading: string;
  readonly rows: readonly RateRow[];
  /** bits of the key that name the quantity */
  readonly key_mask: number;
  /** hexadecimal digits of a displayed key; 0: decimal */
  readonly key_digits: number;
  /** rate of every message, or the highest; 0: none */
  readonly every: number;
  /** field with the measured interval at divisor 1, ms; "": rates are in Hz */
  readonly interval: string;
  /** offered ones */
  readonly divisors: readonly number[];
  readonly variants: readonly KeyVariant[];
  /** the group of a row is shown beside its title */
  readonly grouped: boolean;
}

export type Editor = "number" | "integer" | "choice" | "flags" | "bool" | "text" | "hex" | "record" | "list" | "vector";

export type CautionKind = "" | "restarts" | "stops-output" | "cuts-line" | "loses-settings" | "wears-flash" | "moves-frame";

export type Side = "device" | "factory" | "snapshot" | "text" | "other";

/** Input of one field: its type, range, unit and help. */
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
  /** maximum number of list elements; 0: limited by the payload only */
  readonly max_length: number;
  readonly axes: readonly string[];
  /** value (decimal) → meaning */
  readonly choices: Readonly<Record<string, string>>;
  readonly bits: readonly BitsInfo[];
  /** of a record, or of each element of a list */
  readonly fields: readonly FieldForm[];
  readonly basic: boolean;
  readonly read_only: boolean;
  /** 16: an identifier, shown in hex as on the label */
  readonly base: number;
  /** known values of a text field */
  readonly options: readonly string[];
  /** if the device lists the values; a value may join several with "/" */
  readonly listed: TextList | null;
  /** field of the same record on which the meaning depends */
  readonly meaning_of: string;
  readonly meanings: readonly Meaning[];
  readonly doc: string;
  readonly source: string;
}

/** Values that the device stores. */
export interface SettingForm {
  readonly name: string;
  readonly title: string;
  readonly group: string;
  readonly fields: readonly FieldForm[];
  readonly writable: boolean;
  /** single fields can be written alone */
  readonly partial: boolean;
  /** by which its list is edited; None for a plain form */
  readonly table: RateTable | null;
  /** when a written value takes effect */
  readonly after: "" | "measurement" | "reset";
  readonly caution: CautionKind;
  readonly consequence: string;
  readonly basic: boolean;
  readonly doc: string;
  readonly source: string;
}

/** Form of a command: its arguments and its caution. */
export interface CommandForm {
  readonly name: string;
  readonly title: string;
  readonly group: string;
  readonly kind: "ask" | "set" | "do";
  readonly arguments: readonly FieldForm[];
  readonly reply: string;
  readonly caution: CautionKind;
  readonly consequence: string;
  readonly basic: boolean;
  readonly doc: string;
  readonly source: string;
  /** argument → values to which no caution applies */
  readonly harmless: Readonly<Record<string, readonly number[]>>;
  /** setting whose fields are the arguments; the form opens with the values of the device */
  readonly writes: string;
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
  /** accepts RTCM */
  readonly corrections: boolean;
  /** its factory settings are documented */
  readonly factory: boolean;
  /** the part that is not known yet, one sentence */
  readonly note: string;
}

export interface FrameInfo {
  readonly name: string;
  readonly hex: string;
  readonly spans: readonly ByteRange[];
}

/** Problem of a value, shown at its input. */
export interface FieldProblem {
  readonly path: string;
  readonly message: string;
  readonly hint: string;
}

/** Bytes per second of the outputs, and the capacity of the link. */
export interface LoadInfo {
  readonly parts: readonly OutputLoad[];
  /** bytes/s */
  readonly total: number;
  /** bytes/s, at the baud rate after the change; null if the link has no such limit */
  readonly capacity: number | null;
  readonly baud: number | null;
  /** per-message limits that are exceeded */
  readonly limits: readonly string[];
  /** bytes/s now */
  readonly measured: number | null;
}

/** Exactly one of `setting` and `command`. */
export interface PreviewRequest {
  readonly values: Readonly<Record<string, unknown>>;
  readonly setting: string;
  readonly command: string;
}

export interface PreviewResult {
  readonly frames: readonly FrameInfo[];
  readonly problems: readonly FieldProblem[];
  readonly load: LoadInfo | null;
  /** how this change could cut the line; "" if it cannot */
  readonly line: string;
  /** further consequences of single values, for a user */
  readonly risks: readonly string[];
}

export interface ReadRequest {
  readonly settings: readonly string[] | null;
  /** stored in the snapshot */
  readonly reason: string;
  /** unfinished work of a command (DeviceJobs.unfinished) may be discarded */
  readonly confirmed: boolean;
}

/** Settings to write: complete ones, or single fields if the setting is `partial`. */
export interface ApplyRequest {
  readonly changes: Readonly<Record<string, Readonly<Record<string, unknown>>>>;
  readonly reason: string;
  /** the user accepts the consequence; without it a dangerous change is refused (409) */
  readonly confirmed: boolean;
  /** further devices of the same protocol, written with the same */
  readonly devices: readonly string[];
  /** product of these settings (of a profile); another product needs confirmation (409) */
  readonly product: string;
  /** the settings when they were edited; if the device */
  readonly base: Readonly<Record<string, Readonly<Record<string, unknown>>>>;
  /** any change is temporary, and rolled back unless it is confirmed in this time, s */
  readonly confirm_s: number | null;
}

export interface RunRequest {
  readonly command: string;
  readonly values: Readonly<Record<string, unknown>>;
  readonly confirmed: boolean;
}

export interface RawRequest {
  readonly hex: string;
  readonly confirmed: boolean;
}

export interface SaveRequest {
  readonly title: string;
  /** YAML; "" stores the present values of the device */
  readonly text: string;
}

/** One side of a comparison. */
export interface SideRef {
  readonly side: Side;
  /** SnapshotInfo.name, for "snapshot" */
  readonly snapshot: string;
  /** DeviceInfo.id, for "other"; for "snapshot" its owner, "" for this device */
  readonly device: string;
  /** YAML, for "text" */
  readonly text: string;
}

export interface CompareRequest {
  readonly left: SideRef;
  readonly right: SideRef;
  /** DifferenceRow.key → take */
  readonly take: Readonly<Record<string, boolean>>;
  /** whether the others are taken; null: as by default */
  readonly take_rest: boolean | null;
}

export interface DifferenceRow {
  readonly setting: string;
  readonly path: string;
  readonly title: string;
  readonly unit: string;
  /** as text: "400 Hz", "ENU"; "" if that side does not have it */
  readonly left: string;
  readonly right: string;
  /** wire value */
  readonly left_value: unknown;
  readonly right_value: unknown;
  readonly writable: boolean;
  /** the changes contain it */
  readonly take: boolean;
  /** of this difference in CompareRequest.take */
  readonly key: string;
  /** why the left device cannot have the right value, which is then not writable */
  readonly why: string;
}

export interface Difference {
  /** title: "Device now", "Before this change, 14:31" */
  readonly left: string;
  readonly right: string;
  readonly rows: readonly DifferenceRow[];
  /** fields that agree */
  readonly same: number;
  /** setting → why it could not be compared */
  readonly missing: Readonly<Record<string, string>>;
  /** for an ApplyRequest: the rows to take */
  readonly changes: Readonly<Record<string, Readonly<Record<string, unknown>>>>;
  /** all writable values of the right side */
  readonly profile: Readonly<Record<string, Readonly<Record<string, unknown>>>>;
  /** of the right side; "" if it is not known */
  readonly product: string;
  /** problems of the right side, at their paths */
  readonly problems: readonly FieldProblem[];
  /** risks of writing the right side to the device */
  readonly dangers: readonly string[];
  /** why it cannot be written: more than the line can carry */
  readonly blocked: string;
  /** the changes could cut the line: they are rolled back unless they are confirmed */
  readonly temporary: boolean;
}

export interface FitRatesRequest {
  readonly values: Readonly<Record<string, unknown>>;
  readonly setting: string;
  /** null: the present rate */
  readonly baud: number | null;
}

export interface FitRatesResult {
  readonly values: Readonly<Record<string, unknown>>;
  readonly load: LoadInfo;
  /** lowered rates: "Acceleration 400 → 100 Hz" */
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
  /** by this version; if not, `reason` gives the cause and what to do */
  readonly readable: boolean;
}

export interface SnapshotBody {
  readonly info: SnapshotInfo;
  readonly values: Readonly<Record<string, Readonly<Record<string, unknown>>>>;
  /** setting → why it is missing */
  readonly missing: Readonly<Record<string, string>>;
}

/** A stream of RTCM 3 forwarded to the device in whole messages. */
export interface Corrections {
  /** ntrip://user:password@host:2101/MOUNT, tcp://host:port, a file; returned without the password */
  readonly source: string;
  /** continues by itself, and is retried if it breaks */
  readonly running: boolean;
  /** the last message reached the device; false while the source or the link fails */
  readonly forwarding: boolean;
  readonly message: string;
  readonly hint: string;
  /** since the last forwarded message */
  readonly age_s: number | null;
  readonly bytes_per_s: number;
  /** RTCM message number → count */
  readonly messages: Readonly<Record<string, number>>;
  readonly rejected: number;
  /** forwarded, but rejected by the device */
  readonly refused: number;
}
