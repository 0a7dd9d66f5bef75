/** What the export dialog is opened with. */
import { signal } from "@preact/signals";
import type { RecordingDetail, RecordingInfo } from "../wire/recording-types";
import { perApp } from "../page/app-state";

export interface ExportRange {
  readonly name: string;
  readonly t0: number;
  readonly t1: number;
}

/** Subject of the dialog: the recording, and if it is open, its channels and selected ranges. */
export interface Exporting {
  readonly info: RecordingInfo;
  readonly detail: RecordingDetail | undefined;
  readonly ranges: readonly ExportRange[];
  /** Start of the recording, unix s. */
  readonly first: number;
  readonly base: "device" | "arrival";
  /** The range that is chosen at first; absent: the whole recording. */
  readonly chosen?: ExportRange;
}

/** What is being exported, while its dialog is open. */
export const exportingOf = perApp(() => signal<Exporting | undefined>(undefined));
