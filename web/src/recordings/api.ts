/** The routes of the library and of a recording, a function each. */
import { addressOf, type Outcome, type HttpProblem, problemOf, request, respond, parseJson } from "../requests/http";
import type { ColumnStatistics, EvidenceRequest, HealthHistory } from "../wire/routes";
import type { StatisticsRequest } from "./statistics-feed";
import type {
  EditRequest,
  ExportJobRequest,
  ExportSelection,
  KeepRequest,
  MarkerRequest,
  OpeningState,
  PlayRequest,
  RecordingDetail,
  RecordingInfo,
  SaveMemoryRequest,
  StartRequest,
} from "../wire/recording-types";
import { TEXT } from "../texts/recordings";

/** Query for a time range. */
export interface WindowQuery {
  readonly t0: number;
  readonly t1: number;
  /** Most intervals that rows may be summarised to; 0: rows as stored. */
  readonly width: number;
  readonly base: "device" | "arrival";
  readonly channels: readonly number[];
}

export const recordingsApi = {
  list: (q = "") => request("GET /api/recordings", { query: q ? { q } : {} }),
  start: (body: StartRequest) => request("POST /api/recordings/start", { body }),
  /** State of the recorder; changes come over the WebSocket. */
  recorder: () => request("GET /api/recorder"),
  /** Bytes of live links that are in memory. */
  memory: () => request("GET /api/recorder/memory"),
  storage: () => request("GET /api/recorder/storage"),
  saveMemory: (body: SaveMemoryRequest) => request("POST /api/recordings/save-memory", { body }),
  readHeaders: () => request("POST /api/recordings/read-headers"),
  stop: () => request("POST /api/recordings/stop"),
  mark: (body: MarkerRequest) => request("POST /api/recordings/mark", { body }),
  /** Opens it: the answer is the progress until part of it is available; `progress` gives the available part. */
  detail: (recording: string) =>
    request("GET /api/recordings/{recording}", { path: { recording }, query: { partial: true } }),
  edit: (recording: string, body: Partial<EditRequest>) =>
    request("PATCH /api/recordings/{recording}", { path: { recording }, body }),
  remove: (recording: string) => request("DELETE /api/recordings/{recording}", { path: { recording } }),
  undelete: (recording: string) => request("POST /api/recordings/{recording}/undelete", { path: { recording } }),
  markLater: (recording: string, body: MarkerRequest) =>
    request("POST /api/recordings/{recording}/markers", { path: { recording }, body }),
  /** Settings of a device at the time of recording, in the words of Configure. */
  settings: (recording: string, device: string) =>
    request("GET /api/recordings/{recording}/settings", { path: { recording }, query: { device } }),
  export: (recording: string, body: ExportJobRequest) =>
    request("POST /api/recordings/{recording}/exports", { path: { recording }, body }),
  evidence: (recording: string, body: EvidenceRequest) =>
    request("POST /api/recordings/{recording}/evidence", { path: { recording }, body }),
  /** Measured on samples, which takes about a second. */
  exportSizes: (recording: string, body: ExportSelection) =>
    request("POST /api/recordings/{recording}/export-sizes", { path: { recording }, body }),
  /** A range as a recording of its own. */
  keep: (recording: string, body: Partial<KeepRequest> & Pick<KeepRequest, "t0" | "t1">) =>
    request("POST /api/recordings/{recording}/keep", { path: { recording }, body }),
  exports: () => request("GET /api/recordings/exports"),
  cancelExport: (job: number) => request("DELETE /api/recordings/exports/{job}", { path: { job } }),
  play: (recording: string, body: PlayRequest) =>
    request("POST /api/recordings/{recording}/play", { path: { recording }, body }),
  downloadUrl: (recording: string) => addressOf("GET /api/recordings/{recording}/download", { path: { recording } }),
  exportUrl: (job: number) => addressOf("GET /api/recordings/exports/{job}/file", { path: { job } }),
};

export function isOpening(answer: RecordingDetail | OpeningState): answer is OpeningState {
  return !("channels" in answer);
}

/** Samples of a time range: the body as on the wire, and whether its rows are unsummarised. */
export interface WindowAnswer {
  readonly buffer: ArrayBuffer;
  readonly exact: boolean;
}

export async function fetchWindow(
  recording: string,
  { t0, t1, width, base, channels }: WindowQuery,
  signal: AbortSignal,
): Promise<WindowAnswer | HttpProblem> {
  const query = { t0, t1, width, base, channels: channels.join(","), partial: true };
  const answer = await respond("GET /api/recordings/{recording}/window", { path: { recording }, query, signal });
  if (!(answer instanceof Response)) return answer;
  return { buffer: await answer.arrayBuffer(), exact: answer.headers.get("x-exact") !== "0" };
}

/** Statistics of a window, channel by channel; undefined if unavailable. */
export async function fetchStatistics(
  recording: string,
  { channels, from, to, base }: StatisticsRequest,
  signal: AbortSignal,
): Promise<Readonly<Record<string, readonly ColumnStatistics[]>> | undefined> {
  const query = { t0: from, t1: to, base, channels: channels.join(","), partial: true };
  return valueOf(await request("GET /api/recordings/{recording}/statistics", { path: { recording }, query, signal }));
}

/** Per-second figures of a device; undefined if unavailable. */
export async function fetchFared(
  recording: string,
  device: string,
  t0: number,
  t1: number,
  signal: AbortSignal,
): Promise<HealthHistory | undefined> {
  return valueOf(
    await request("GET /api/recordings/{recording}/health", {
      path: { recording },
      query: { device, t0, t1, partial: true },
      signal,
    }),
  );
}

function valueOf<T>(outcome: Outcome<T>): T | undefined {
  return outcome.ok ? outcome.value : undefined;
}

/** Uploads a file, reporting the fraction sent (0..1). */
export function upload(
  file: File,
  progress: (share: number) => void,
): { readonly done: Promise<Outcome<RecordingInfo>>; readonly cancel: () => void } {
  // fetch does not report upload progress, XMLHttpRequest does
  const going = new XMLHttpRequest();
  const done = new Promise<Outcome<RecordingInfo>>((resolve) => {
    const failed = (message: string, hint: string): void =>
      resolve({ ok: false, problem: { kind: "upload", message, hint, status: going.status } });
    going.upload.onprogress = (event) => event.lengthComputable && progress(event.loaded / event.total);
    going.onload = () => {
      const answer = parseJson(going.responseText);
      if (going.status < 300) resolve({ ok: true, value: answer as RecordingInfo });
      else resolve({ ok: false, problem: { ...problemOf(answer, going.status), kind: "upload" } });
    };
    going.onerror = () => failed(TEXT.uploadFailed(file.name), TEXT.checkServer);
    going.onabort = () => failed(TEXT.fileNotAdded(file.name), "");
  });
  going.open("PUT", addressOf("PUT /api/recordings/upload", { query: { name: file.name }, body: file }));
  going.setRequestHeader("content-type", "application/octet-stream");
  going.send(file);
  return { done, cancel: () => going.abort() };
}
