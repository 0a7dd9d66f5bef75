/** Types of the recordings. Generated from server/library/api_models.py by `python -m server.generate_ts_types`; do not edit. */

import type { ChannelInfo, DeviceInfo, EventInfo } from "../wire/types";

export type ExportFormat = "csv" | "csv-aligned" | "parquet" | "mcap" | "rrd" | "mtb" | "raw" | "bytes";

/** One device in a recording, as the list tells it. */
export interface RecordedDevice {
  readonly id: string;
  readonly name: string;
  readonly protocol: string;
  readonly product: string;
  readonly serial_number: string;
  /** frames; 0 where it sent nothing, null until they have been counted */
  readonly messages: number | null;
  readonly lost: number;
  readonly rejects: number;
}

/** One recording, as the list tells it. */
export interface RecordingInfo {
  /** the file's name without suffix */
  readonly id: string;
  readonly title: string;
  /** name of the file */
  readonly file: string;
  /** "mcap", "mtb", "raw", "dat", "bin", "csv" */
  readonly format: string;
  /** bytes */
  readonly size: number;
  readonly started: number | null;
  /** s; null while it is not known */
  readonly duration: number | null;
  readonly devices: readonly RecordedDevice[];
  readonly tags: readonly string[];
  readonly notes: string;
  readonly pinned: boolean;
  /** it is being recorded now */
  readonly recording: boolean;
  /** its columns are there: it opens at once */
  readonly opened: boolean;
  /** one sentence; "" when it is whole */
  readonly damaged: string;
  readonly markers: number;
  /** least and greatest of |rate of turn| or such, 0..1 */
  readonly thumbnail: readonly (readonly number[])[];
  /** where samples were lost, 0..1 of the duration */
  readonly losses: readonly number[];
  /** when, while it is in the bin */
  readonly deleted: number | null;
}

export interface Marker {
  readonly time: number;
  readonly kind: "marker" | "note";
  readonly text: string;
  readonly device: string;
  readonly id: number;
}

/** A recording that is being decoded for the first time. */
export interface OpeningState {
  readonly id: string;
  /** 0..1 */
  readonly progress: number;
  readonly message: string;
}

/** Everything about an opened recording but its samples. */
export interface RecordingDetail {
  readonly info: RecordingInfo;
  readonly t0: number;
  readonly t1: number;
  readonly devices: readonly DeviceInfo[];
  readonly channels: readonly ChannelInfo[];
  readonly events: readonly EventInfo[];
  readonly markers: readonly Marker[];
  /** device → configuration */
  readonly snapshots: Readonly<Record<string, Readonly<Record<string, unknown>>>>;
  /** channel id → usual time between samples */
  readonly longest_s: Readonly<Record<string, number>>;
  /** less while it is decoded for the first time: as much of it is there */
  readonly progress: number;
}

export interface SettingRow {
  /** of the field; "" where a setting has but one */
  readonly title: string;
  /** "400 Hz", "ENU" */
  readonly words: string;
}

/** What one setting of a device was when it was recorded. */
export interface RecordedSetting {
  readonly name: string;
  readonly title: string;
  readonly group: string;
  readonly rows: readonly SettingRow[];
}

export interface RecordedSettings {
  /** in the order of Configure */
  readonly settings: readonly RecordedSetting[];
  /** title → why it could not be read */
  readonly missing: Readonly<Record<string, string>>;
}

export interface Start {
  /** null: all */
  readonly devices: readonly string[] | null;
  readonly title: string;
}

export interface Mark {
  readonly text: string;
  readonly kind: "marker" | "note";
  /** null: now */
  readonly time: number | null;
  readonly device: string;
}

/** What is null stays. */
export interface Edit {
  readonly title: string | null;
  readonly tags: readonly string[] | null;
  readonly notes: string | null;
  readonly pinned: boolean | null;
  /** another name for its file, and so another id; the suffix stays */
  readonly file: string | null;
}

/** Which part of a recording is exported, or measured. */
export interface ExportPart {
  /** null: from the beginning */
  readonly t0: number | null;
  readonly t1: number | null;
  /** null: all */
  readonly channels: readonly number[] | null;
  readonly base: "device" | "arrival";
}

export interface Export extends ExportPart {
  readonly format: ExportFormat;
  /** for formats that hold one device */
  readonly device: string;
}

/** About how large exports would be, bytes; what could not be measured is left out. */
export interface ExportSizes {
  /** format → size */
  readonly sizes: Readonly<Record<string, number>>;
  /** device → its bytes as they came */
  readonly devices: Readonly<Record<string, number>>;
}

export interface Play {
  readonly speed: number;
  readonly loop: boolean;
  readonly t0: number | null;
  readonly t1: number | null;
}
