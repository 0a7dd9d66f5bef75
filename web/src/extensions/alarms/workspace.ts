/**
 * Alarms that travel with a workspace: in its file, and with one stored by name. The server has them, whatever workspace is shown, so a
 * workspace that has others than the server offers to add them.
 *
 *     {"format": "imuscope-workspace", "version": 1, "parts": {…}, "alarms": [{"name": "Hot", "condition": {…}, …}]}
 */
import { type HttpProblem, request } from "../../requests/http";
import type { AlarmDefinition, AlarmInfo, DeviceFilter } from "../../wire/routes";
import type { DeviceInfo } from "../../wire/types";
import { signal } from "@preact/signals";
import { madeFor } from "../../page/app-state";
import type { Companion } from "../../workspace/companions";
import { isObject, type Json } from "../../data/json";
import type { WorkspaceSession } from "../../workspace/session";
import { TEXT } from "./texts";

/** As many as a server has. */
const MAX_DEFINITIONS = 1000;

/** Whether an alarm is for a device, as the server decides it (server/extensions/alarms/definitions.py). */
export function isFor({ device, product, family }: Partial<DeviceFilter>, of: DeviceInfo): boolean {
  const names: readonly string[] = ["", of.serial_number, of.source, of.name];
  return (
    names.includes(device ?? "") &&
    (of.product || of.name).toLowerCase().startsWith((product ?? "").toLowerCase()) &&
    ["", of.protocol].includes(family ?? "")
  );
}

/** The alarms of the devices. Webhooks stay behind: their addresses are secrets of this server. */
export function travelling(
  alarms: readonly AlarmInfo[],
  devices: readonly DeviceInfo[],
): readonly AlarmDefinition[] | undefined {
  const own = alarms
    .map(({ definition }) => ({ ...definition, webhook: "" }))
    .filter(({ devices: filter }) => devices.some((device) => isFor(filter ?? {}, device)));
  return own.length > 0 ? own : undefined;
}

/** What makes two alarms the same, whatever their order of keys. */
const sameness = ({ name, condition, devices }: AlarmDefinition): string =>
  JSON.stringify([name, ...[condition, devices ?? {}].map((one) => Object.entries(one).sort())]);

/** Alarms of the last workspace that the server does not have: offered, not added. */
export const offeredIn = madeFor((_session: WorkspaceSession) => signal<readonly AlarmDefinition[]>([]));

/** The alarms of a workspace that are not among the present ones. */
export function missingAlarms(json: unknown, present: readonly AlarmInfo[]): readonly AlarmDefinition[] {
  const given: readonly unknown[] = Array.isArray(json) ? json.slice(0, MAX_DEFINITIONS) : [];
  const named = given.filter(
    (one): boolean => isObject(one) && typeof one["name"] === "string" && isObject(one["condition"]),
  ) as unknown as readonly AlarmDefinition[];
  const known = new Set(present.map(({ definition }) => sameness(definition)));
  return named.filter((one) => !known.has(sameness(one)));
}

export interface Added {
  readonly names: readonly string[];
  /** Those that the server refuses, with why. */
  readonly refused: readonly { readonly definition: AlarmDefinition; readonly problem: HttpProblem }[];
}

/** Add alarms to the server, one after the other. */
export async function addAlarms(definitions: readonly AlarmDefinition[]): Promise<Added> {
  const names: string[] = [];
  const refused: { definition: AlarmDefinition; problem: HttpProblem }[] = [];
  for (const body of definitions) {
    const outcome = await request("POST /api/alarms", { body });
    if (outcome.ok) names.push(body.name);
    else refused.push({ definition: body, problem: outcome.problem });
  }
  return { names, refused };
}

export async function presentAlarms(): Promise<readonly AlarmInfo[]> {
  const outcome = await request("GET /api/alarms");
  return outcome.ok ? outcome.value : [];
}

export const alarmCompanion: Companion = {
  key: "alarms",
  read: async (devices) => travelling(await presentAlarms(), devices) as unknown as Json | undefined,
  saved: (json) => TEXT.exportedAlarms(Array.isArray(json) ? json.length : 0),
  async take(session, json) {
    const given = missingAlarms(json, []);
    offeredIn(session).value = given.length > 0 ? missingAlarms(json, await presentAlarms()) : [];
  },
};
