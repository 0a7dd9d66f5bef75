/** What travels with a workspace that is stored, exported or opened. */
import { fromExtensions } from "../../extension/extension";
import type { DeviceInfo } from "../../wire/types";
import type { Workspace } from "../../workspace/parts";
import { isObject } from "../../data/json";
import type { WorkspaceSession } from "../../workspace/session";

export interface Accompanied {
  readonly workspace: Workspace & { readonly [key: string]: unknown };
  /** What travels with it, in words. */
  readonly said: string;
}

export async function accompanied(workspace: Workspace, devices: readonly DeviceInfo[]): Promise<Accompanied> {
  const found = await Promise.all(
    fromExtensions("companions").map(async ({ key, read, saved }) => ({ key, saved, json: await read(devices) })),
  );
  const present = found.flatMap(({ key, saved, json }) => (json === undefined ? [] : [{ key, saved, json }]));
  return {
    workspace: { ...workspace, ...Object.fromEntries(present.map(({ key, json }) => [key, json])) },
    said: present.map(({ saved, json }) => saved(json)).join(" "),
  };
}

export async function takeCompanions(session: WorkspaceSession, workspace: unknown): Promise<void> {
  for (const { key, take } of fromExtensions("companions"))
    await take(session, isObject(workspace) ? workspace[key] : undefined);
}
