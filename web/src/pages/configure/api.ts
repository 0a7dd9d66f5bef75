/** The routes of server/configuration/api_models.py, one function each. */
import type { Apply, Compare, Corrections, Difference, FitAnswer, Forms, PreviewAnswer, SnapshotBody, SnapshotInfo } from "../../forms/types";
import type { Values } from "../../forms/values";
import { request } from "../../ui/http";
import type { ControlState, ExchangeEntry, Job } from "../../wire/types";

const of = (device: string, path: string): string => `/api/devices/${encodeURIComponent(device)}/${path}`;
const named = (name: string): string => `snapshots/${encodeURIComponent(name)}`;

export const server = {
  build: () => request<{ readonly role: "view" | "control" }>("GET", "/api/build"),
  forms: (device: string) => request<Forms>("GET", of(device, "forms")),
  values: (device: string) => request<SnapshotBody>("GET", of(device, "values")),
  previewSetting: (device: string, setting: string, values: Values) => request<PreviewAnswer>("POST", of(device, "preview"), { setting, values }),
  previewCommand: (device: string, command: string, values: Values) => request<PreviewAnswer>("POST", of(device, "preview"), { command, values }),
  read: (device: string, confirmed = false) => request<Job>("POST", of(device, "read"), { settings: null, reason: "", confirmed }),
  apply: (device: string, body: Apply) => request<Job>("POST", of(device, "apply"), body),
  run: (device: string, command: string, values: Values, confirmed: boolean) => request<Job>("POST", of(device, "run"), { command, values, confirmed }),
  raw: (device: string, hex: string) => request<Job>("POST", of(device, "raw"), { hex, confirmed: true }),
  keep: (device: string) => request<ControlState>("POST", of(device, "keep"), {}),
  revert: (device: string) => request<ControlState>("POST", of(device, "revert"), {}),
  restore: (device: string) => request<Job>("POST", of(device, "restore"), {}),
  stop: (device: string, job: number) => request<unknown>("DELETE", of(device, `jobs/${job}`)),
  exchange: (device: string, before: number | undefined, limit: number) =>
    request<readonly ExchangeEntry[]>("GET", of(device, `exchange?limit=${limit}${before === undefined ? "" : `&before=${before}`}`)),
  snapshots: (device: string) => request<readonly SnapshotInfo[]>("GET", of(device, "snapshots")),
  snapshotText: (device: string, name: string) => request<string>("GET", of(device, named(name))),
  snapshotUrl: (device: string, name: string) => of(device, named(name)),
  keepSnapshot: (device: string, title: string, text = "") => request<SnapshotInfo>("POST", of(device, "snapshots"), { title, text }),
  deleteSnapshot: (device: string, name: string) => request<unknown>("DELETE", of(device, named(name))),
  compare: (device: string, body: Compare) => request<Difference>("POST", of(device, "compare"), body),
  fit: (device: string, setting: string, values: Values, baud: number | null) => request<FitAnswer>("POST", of(device, "fit"), { setting, values, baud }),
  corrections: (device: string) => request<Corrections>("GET", of(device, "corrections")),
  startCorrections: (device: string, source: string) => request<Corrections>("PUT", of(device, "corrections"), { source }),
  stopCorrections: (device: string) => request<Corrections>("DELETE", of(device, "corrections")),
};
