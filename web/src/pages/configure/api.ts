/** The routes of one device's configuration, a function each. */
import type { ApplyRequest, CompareRequest } from "../../wire/form-types";
import type { FormValues } from "../../forms/values";
import { addressOf, request } from "../../requests/http";

export const configureApi = {
  forms: (device: string) => request("GET /api/devices/{device}/forms", { path: { device } }),
  values: (device: string) => request("GET /api/devices/{device}/values", { path: { device } }),
  previewSetting: (device: string, setting: string, values: FormValues) =>
    request("POST /api/devices/{device}/preview", { path: { device }, body: { setting, values } }),
  previewCommand: (device: string, command: string, values: FormValues) =>
    request("POST /api/devices/{device}/preview", { path: { device }, body: { command, values } }),
  read: (device: string, confirmed = false) =>
    request("POST /api/devices/{device}/read", { path: { device }, body: { confirmed } }),
  apply: (device: string, body: ApplyRequest) =>
    request("POST /api/devices/{device}/apply", { path: { device }, body }),
  run: (device: string, command: string, values: FormValues, confirmed: boolean) =>
    request("POST /api/devices/{device}/run", { path: { device }, body: { command, values, confirmed } }),
  confirm: (device: string) => request("POST /api/devices/{device}/confirm", { path: { device } }),
  rollBack: (device: string) => request("POST /api/devices/{device}/roll-back", { path: { device } }),
  restore: (device: string) => request("POST /api/devices/{device}/restore", { path: { device } }),
  stop: (device: string, job: number) => request("DELETE /api/devices/{device}/jobs/{job}", { path: { device, job } }),
  snapshots: (device: string) => request("GET /api/devices/{device}/snapshots", { path: { device } }),
  snapshot: (device: string, name: string) =>
    request("GET /api/devices/{device}/snapshots/{name}", { path: { device, name } }),
  snapshotUrl: (device: string, name: string) =>
    addressOf("GET /api/devices/{device}/snapshots/{name}", { path: { device, name } }),
  keepSnapshot: (device: string, title: string, text = "") =>
    request("POST /api/devices/{device}/snapshots", { path: { device }, body: { title, text } }),
  deleteSnapshot: (device: string, name: string) =>
    request("DELETE /api/devices/{device}/snapshots/{name}", { path: { device, name } }),
  compare: (device: string, body: Omit<CompareRequest, "take_rest"> & { readonly take_rest?: false }) =>
    request("POST /api/devices/{device}/compare", { path: { device }, body }),
  fit: (device: string, setting: string, values: FormValues, baud: number | null) =>
    request("POST /api/devices/{device}/fit-rates", { path: { device }, body: { setting, values, baud } }),
};
