/** What the export dialog is opened with. */
import { effect, signal } from "@preact/signals";
import type { RecordingDetail, RecordingInfo } from "../wire/recording-types";
import type { ExportJob } from "../wire/types";
import { perApp } from "../page/app-state";
import { download } from "../ui/dom/download";
import { recordingsApi } from "./api";

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

/** Lists a job that this page asked for; its file is downloaded once it is made. */
export const takeExport = perApp(({ store: { exports } }) => {
  const wanted = new Set<number>();
  effect(() => {
    const jobs = exports.value;
    for (const id of wanted) {
      const job = jobs.find((one) => one.id === id);
      if (job?.state === "waiting" || job?.state === "running") continue;
      wanted.delete(id); // another run of the server counts its jobs anew
      if (job?.state === "done") download(recordingsApi.exportUrl(id), job.file);
    }
  });
  return (job: ExportJob): void => {
    wanted.add(job.id);
    const listed = exports.peek();
    exports.value = listed.some(({ id }) => id === job.id) ? [...listed] : [...listed, job];
  };
});
