/**
 * What travels with a workspace besides the view: in its file, and with one stored by name. A server has it, whatever workspace is
 * shown, so it is no part (parts.ts): what an opened workspace brings is offered, not applied.
 *
 *     {"format": "imuscope-workspace", "version": 1, "parts": {…}, "KEY": …}
 */
import type { Signal } from "@preact/signals";
import { fromExtensions } from "../extension";
import type { Deps } from "../panels/panel-context";
import type { DeviceInfo } from "../wire/types";
import { isObject, type Json, type Workspace } from "./parts";
import type { WorkspaceSession } from "./session";

export interface Companion {
  /** Unique; its name in files, so it never changes. */
  readonly key: string;
  /** What goes with a workspace of these devices; undefined: nothing. */
  readonly read: (devices: readonly DeviceInfo[]) => Promise<Json | undefined>;
  /** A sentence once it was saved in a file. */
  readonly saved: (json: Json) => string;
  /** Takes what an opened workspace brings; undefined: nothing. */
  readonly take: (session: WorkspaceSession, json: Json | undefined) => Promise<void>;
}

export interface CompanionProps {
  readonly session: WorkspaceSession;
  readonly deps: Deps;
  /** The last action, in words. */
  readonly said: Signal<string>;
}

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
