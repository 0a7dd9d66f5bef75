/** Types of the recordings. Generated from server/library/api_models.py by `python -m imuscope.server.generators.ts_types`; do not edit. */

import type { ChannelInfo, DeviceInfo, EventInfo } from "./types";

/** Identity of a recorded device, as far as the probed part contains it. */
export interface RecordedDevice {
  readonly id: string;
  readonly name: string;
  readonly protocol: string;
  readonly product: string;
  readonly serial_number: string;
  /** frames; null until they are counted */
  readonly messages: number | null;
  readonly lost: number;
  readonly rejects: number;
  readonly simulated: boolean;
  /** whether lost frames are known: none lost means that none are missing */
  readonly counts_losses: boolean;
}

/** A marker or note that was added later. */
export interface MarkerInfo {
  /** unix s */
  readonly time: number;
  readonly kind: "marker" | "note";
  readonly text: string;
  readonly device: string;
  readonly id: number;
}

/** Row of the library: file, size, times, devices and notes. */
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
  /** s; null if unknown */
  readonly duration: number | null;
  readonly devices: readonly RecordedDevice[];
  readonly tags: readonly string[];
  readonly notes: string;
  readonly pinned: boolean;
  /** still being recorded */
  readonly recording: boolean;
  /** already decoded, so it opens at once */
  readonly opened: boolean;
  /** one sentence; "" if undamaged */
  readonly damaged: string;
  /** sentences: what of it is left out, and how it was read */
  readonly remark: string;
  readonly markers: number;
  /** min and max of |rate of turn| or similar, 0..1 */
  readonly thumbnail: readonly (readonly number[])[];
  /** positions of lost samples, 0..1 of the duration */
  readonly losses: readonly number[];
  /** time of deletion, while it is in the bin */
  readonly deleted: number | null;
}

/** A recording that is being decoded for the first time. */
export interface OpeningState {
  readonly id: string;
  /** 0..1 */
  readonly progress: number;
  readonly message: string;
}

/** Details of an opened recording, without its samples. */
export interface RecordingDetail {
  readonly info: RecordingInfo;
  readonly t0: number;
  readonly t1: number;
  readonly devices: readonly DeviceInfo[];
  readonly channels: readonly ChannelInfo[];
  readonly events: readonly EventInfo[];
  readonly markers: readonly MarkerInfo[];
  /** device → configuration */
  readonly snapshots: Readonly<Record<string, Readonly<Record<string, unknown>>>>;
  /** channel id → usual time between samples */
  readonly longest_s: Readonly<Record<string, number>>;
  /** below 1 while it is decoded for the first time: the decoded share */
  readonly progress: number;
  /** device → time of its first sample */
  readonly begins: Readonly<Record<string, number>>;
}

export interface SettingRow {
  /** of the field; "" if the setting has only one */
  readonly title: string;
  /** "400 Hz", "ENU" */
  readonly words: string;
}

/** A setting of a device at the time of recording. */
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

export interface StartRequest {
  /** null: all */
  readonly devices: readonly string[] | null;
  readonly title: string;
  /** begin with the bytes of the last seconds, as far as they are in memory */
  readonly before_s: number;
  /** request the Configuration of an MTi, which pauses it for about 90 ms; null: as */
  readonly with_head: boolean | null;
}

export interface SaveMemoryRequest {
  /** null: all */
  readonly devices: readonly string[] | null;
  /** the last ones only; null: everything in memory */
  readonly seconds: number | null;
  /** instead of `seconds`: only bytes that arrived from t0 on … */
  readonly t0: number | null;
  /** … and before t1 */
  readonly t1: number | null;
  readonly title: string;
}

/** A recording made of the bytes in memory. */
export interface SavedMemory {
  readonly id: string;
  readonly devices: readonly string[];
  /** time of its first bytes */
  readonly t0: number;
  /** time of its last bytes */
  readonly t1: number;
  /** received and sent */
  readonly bytes: number;
}

/** Bytes of a link that are in memory. */
export interface HeldBytes {
  readonly device: string;
  readonly t0: number;
  readonly t1: number;
  /** of memory */
  readonly size: number;
}

export interface MarkerRequest {
  readonly text: string;
  readonly kind: "marker" | "note";
  /** null: now */
  readonly time: number | null;
  readonly device: string;
}

/** Changes to a recording; null leaves a value unchanged. */
export interface EditRequest {
  readonly title: string | null;
  readonly tags: readonly string[] | null;
  readonly notes: string | null;
  /** notes that were read: refused with 412 if they are others by now; null: replaced */
  readonly notes_before: string | null;
  readonly pinned: boolean | null;
  /** new name of the file, which changes the id; the suffix stays */
  readonly file: string | null;
}

/** Part of a recording to export or measure. */
export interface ExportSelection {
  /** null: from the beginning */
  readonly t0: number | null;
  readonly t1: number | null;
  /** null: all */
  readonly channels: readonly number[] | null;
  readonly base: "device" | "arrival";
}

export interface ExportJobRequest extends ExportSelection {
  /** a name of ExportCapability */
  readonly format: string;
  /** for formats of one device */
  readonly device: string;
}

/** Estimated sizes of exports, bytes, without those that could not be measured. */
export interface ExportSizes {
  /** format → size */
  readonly sizes: Readonly<Record<string, number>>;
  /** device → its received bytes */
  readonly devices: Readonly<Record<string, number>>;
}

export interface PlayRequest {
  readonly speed: number;
  readonly loop: boolean;
  readonly t0: number | null;
  readonly t1: number | null;
}
