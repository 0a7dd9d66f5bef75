/** The routes of server/library/api_models.py, one function each. */
import { type Outcome, type Problem, request } from "../ui/http";
import type { ExportJob, RecorderState } from "../wire/types";
import type { Fared } from "./health-history";
import type { Asked, ColumnStatistics } from "./statistics-feed";
import type { Edit, Export, ExportPart, ExportSizes, Mark, Marker, OpeningState, Play, RecordedSettings, RecordingDetail, RecordingInfo, Start } from "./types";

const ROOT = "/api/recordings";
const of = (id: string, more = ""): string => `${ROOT}/${encodeURIComponent(id)}${more}`;

/** What is asked of a stretch of time. */
export interface WindowQuery {
  readonly t0: number;
  readonly t1: number;
  /** How many stretches rows may be summarised to; 0: rows as they are. */
  readonly width: number;
  readonly base: "device" | "arrival";
  readonly channels: readonly number[];
}

export const server = {
  list: (query = "") => request<readonly RecordingInfo[]>("GET", `${ROOT}${query ? `?q=${encodeURIComponent(query)}` : ""}`),
  start: (body: Start) => request<RecorderState>("POST", `${ROOT}/start`, body),
  /** What is being recorded; changes are told over the WebSocket. */
  recorder: () => request<RecorderState>("GET", "/api/recorder"),
  stop: () => request<RecorderState>("POST", `${ROOT}/stop`, {}),
  mark: (body: Mark) => request<unknown>("POST", `${ROOT}/mark`, body),
  /** Opens it: until something of it is there the answer is how far that is; `progress` tells how much is there. */
  detail: (id: string) => request<RecordingDetail | OpeningState>("GET", of(id, "?partial=1")),
  edit: (id: string, edit: Partial<Edit>) => send<RecordingInfo>("PATCH", of(id), { title: null, tags: null, notes: null, pinned: null, file: null, ...edit }),
  remove: (id: string) => request<RecordingInfo>("DELETE", of(id)),
  undelete: (id: string) => request<RecordingInfo>("POST", of(id, "/undelete"), {}),
  markLater: (id: string, body: Mark) => request<Marker>("POST", of(id, "/markers"), body),
  /** What a device was set to when it was recorded, in the words of Configure. */
  settings: (id: string, device: string) => request<RecordedSettings>("GET", of(id, `/settings?device=${encodeURIComponent(device)}`)),
  export: (id: string, body: Export) => request<ExportJob>("POST", of(id, "/exports"), body),
  /** Measured on samples, which takes a second or some. */
  exportSizes: (id: string, body: ExportPart) => request<ExportSizes>("POST", of(id, "/export-sizes"), body),
  exports: () => request<readonly ExportJob[]>("GET", `${ROOT}/exports`),
  cancelExport: (job: number) => request<unknown>("DELETE", `${ROOT}/exports/${job}`),
  play: (id: string, body: Play) => request<readonly { readonly id: string }[]>("POST", of(id, "/play"), body),
  downloadUrl: (id: string) => of(id, "/download"),
  originalUrl: (id: string, device: string) => of(id, `/original?device=${encodeURIComponent(device)}`),
  exportUrl: (job: number) => `${ROOT}/exports/${job}/file`,
};

/** PATCH is a method that `request` has no need of elsewhere. */
function send<T>(method: "PATCH", path: string, body: unknown): Promise<Outcome<T>> {
  return request<T>(method as "PUT", path, body);
}

export function isOpening(answer: RecordingDetail | OpeningState): answer is OpeningState {
  return !("channels" in answer);
}

/** Samples of a stretch of time: the body as the wire has it, and whether its rows are as they came. */
export interface WindowAnswer {
  readonly buffer: ArrayBuffer;
  readonly exact: boolean;
}

export async function fetchWindow(id: string, query: WindowQuery, signal: AbortSignal): Promise<WindowAnswer | Problem> {
  const given = new URLSearchParams({ t0: String(query.t0), t1: String(query.t1), width: String(query.width), base: query.base });
  given.set("channels", query.channels.join(","));
  given.set("partial", "1");
  const answer = await fetch(of(id, `/window?${given}`), { credentials: "same-origin", signal });
  if (answer.ok) return { buffer: await answer.arrayBuffer(), exact: answer.headers.get("x-exact") !== "0" };
  const told = (await answer.json().catch(() => ({}))) as Partial<Problem>;
  return { kind: told.kind ?? "http", message: told.message ?? `The server answered ${answer.status}.`, hint: told.hint ?? "", status: answer.status };
}

/** What a window amounts to, channel by channel; undefined where that cannot be had. */
export async function fetchStatistics(id: string, { channels, from, to, base }: Asked, signal: AbortSignal): Promise<Readonly<Record<string, readonly ColumnStatistics[]>> | undefined> {
  const given = new URLSearchParams({ t0: String(from), t1: String(to), base, channels: channels.join(","), partial: "1" });
  try {
    const answer = await fetch(of(id, `/statistics?${given}`), { credentials: "same-origin", signal });
    return answer.ok ? ((await answer.json()) as Readonly<Record<string, readonly ColumnStatistics[]>>) : undefined;
  } catch {
    return undefined;
  }
}

/** How a device fared, second by second; undefined where that cannot be had. */
export async function fetchFared(id: string, device: string, t0: number, t1: number, signal: AbortSignal): Promise<Fared | undefined> {
  const given = new URLSearchParams({ device, t0: String(t0), t1: String(t1), partial: "1" });
  try {
    const answer = await fetch(of(id, `/fared?${given}`), { credentials: "same-origin", signal });
    return answer.ok ? ((await answer.json()) as Fared) : undefined;
  } catch {
    return undefined;
  }
}

/** Hands a file over, telling how much of it has gone (0..1). */
export function upload(file: File, progress: (share: number) => void): { readonly done: Promise<Outcome<RecordingInfo>>; readonly cancel: () => void } {
  // fetch tells nothing of what has been sent; this does.
  const going = new XMLHttpRequest();
  const done = new Promise<Outcome<RecordingInfo>>((resolve) => {
    const failed = (message: string, hint: string): void => resolve({ ok: false, problem: { kind: "upload", message, hint, status: going.status } });
    going.upload.onprogress = (event) => event.lengthComputable && progress(event.loaded / event.total);
    going.onload = () => {
      const told = parsed(going.responseText);
      if (going.status < 300) resolve({ ok: true, value: told as unknown as RecordingInfo });
      else failed(String(told["message"] ?? `The server answered ${going.status}.`), String(told["hint"] ?? ""));
    };
    going.onerror = () => failed(`${file.name} could not be handed over.`, "Is the server still running? Try again.");
    going.onabort = () => failed(`${file.name} was not added.`, "");
  });
  going.open("PUT", `${ROOT}/upload?name=${encodeURIComponent(file.name)}`);
  going.setRequestHeader("content-type", "application/octet-stream");
  going.send(file);
  return { done, cancel: () => going.abort() };
}

function parsed(text: string): Record<string, unknown> {
  try {
    return JSON.parse(text) as Record<string, unknown>;
  } catch {
    return {};
  }
}
