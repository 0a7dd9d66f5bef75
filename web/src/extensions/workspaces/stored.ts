/** Stored workspaces: on the server by name, as a file, and the last state of this browser. */
import { type Outcome, type HttpProblem, request } from "../../requests/http";
import type { WorkspaceInfo, WorkspaceList } from "../../wire/routes";
import type { DeviceInfo } from "../../wire/types";
import { signal } from "@preact/signals";
import { madeFor } from "../../page/app-state";
import { withoutMoment, workspaceOf, type Workspace } from "../../workspace/parts";
import type { WorkspaceSession } from "../../workspace/session";
import { parseForeign } from "../../wire/foreign-text";
import { fromExtensions } from "../../extension/extension";
import { isObject } from "../../data/json";
import { download } from "../../ui/dom/download";

/** Largest file that is read, bytes: that of the server. */
const MAX_FILE = 256 * 1024;

/** The stored workspace that was opened or saved last. */
export const currentOf = madeFor((_session: WorkspaceSession) =>
  signal<Pick<WorkspaceInfo, "name" | "revision"> | undefined>(undefined),
);

export const listWorkspaces = (): Promise<Outcome<WorkspaceList>> => request("GET /api/workspaces");

/** Counts what was chosen: an answer that a later choice has overtaken is not shown. */
const turnOf = madeFor((_session: WorkspaceSession) => ({ last: 0 }));

/** Show the workspace of that name, if it is still wanted once it is here. */
export async function openStored(
  session: WorkspaceSession,
  name: string,
  isWanted: () => boolean = () => true,
): Promise<HttpProblem | undefined> {
  const turn = turnOf(session);
  const mine = ++turn.last;
  const outcome = await request("GET /api/workspaces/{name}", { path: { name } });
  if (mine !== turn.last || !isWanted()) return undefined;
  if (!outcome.ok) return outcome.problem;
  session.open(outcome.value.workspace);
  currentOf(session).value = outcome.value;
  await takeCompanions(session, outcome.value.workspace);
  return undefined;
}

/** Store what is shown. @param ifMatch revision that it replaces; "*": whatever there is; undefined: none of that name */
export async function saveAs(
  session: WorkspaceSession,
  devices: readonly DeviceInfo[],
  name: string,
  ifMatch: string | undefined,
): Promise<HttpProblem | undefined> {
  const { workspace } = await accompanied(workspaceOf(session.view, withoutMoment), devices);
  const outcome = await request("PUT /api/workspaces/{name}", {
    path: { name },
    body: { workspace },
    ...(ifMatch === undefined ? {} : { ifMatch }),
  });
  if (!outcome.ok) return outcome.problem;
  currentOf(session).value = outcome.value;
  return undefined;
}

export async function removeStored(session: WorkspaceSession): Promise<HttpProblem | undefined> {
  const current = currentOf(session).peek();
  if (!current) return undefined;
  const { name, revision } = current;
  const outcome = await request("DELETE /api/workspaces/{name}", { path: { name }, ifMatch: revision });
  if (!outcome.ok) return outcome.problem;
  currentOf(session).value = undefined;
  return undefined;
}

/** Set or remove the workspace that devices of a family open with, for everyone. */
export async function setDefault(family: string, name: string | null): Promise<HttpProblem | undefined> {
  const outcome = await request("PUT /api/workspace-defaults/{family}", { path: { family }, body: { name } });
  return outcome.ok ? undefined : outcome.problem;
}

/** Save what is shown as a file. @returns what the file has besides the view, in words */
export async function exportFile(session: WorkspaceSession, devices: readonly DeviceInfo[]): Promise<string> {
  const { workspace, said } = await accompanied(workspaceOf(session.view, withoutMoment), devices);
  const text = JSON.stringify(workspace, null, 1);
  const address = URL.createObjectURL(new Blob([text], { type: "application/json" }));
  const name = currentOf(session).peek()?.name ?? "workspace";
  download(address, `${name.replace(/[^\p{L}\p{N} _.-]+/gu, "-")}.json`);
  setTimeout(() => URL.revokeObjectURL(address), 1000);
  return said;
}

/** Show the workspace of a file; what is wrong with it is among the problems of the session. */
export async function importFile(session: WorkspaceSession, file: File): Promise<void> {
  let json: unknown;
  try {
    json = file.size > MAX_FILE ? undefined : parseForeign(await file.text());
  } catch {
    json = undefined; // told as any file that is no workspace
  }
  session.open(json);
  currentOf(session).value = undefined;
  await takeCompanions(session, json);
}

/** Open the workspace that was set for a family, unless a person was quicker. */
export async function openDefault(
  session: WorkspaceSession,
  family: string,
  isUntouched: () => boolean,
): Promise<void> {
  const outcome = await listWorkspaces();
  const name = outcome.ok ? outcome.value.defaults[family] : undefined;
  if (name !== undefined && isUntouched()) await openStored(session, name, isUntouched);
}

interface Accompanied {
  readonly workspace: Workspace & { readonly [key: string]: unknown };
  /** What travels with it, in words. */
  readonly said: string;
}

async function accompanied(workspace: Workspace, devices: readonly DeviceInfo[]): Promise<Accompanied> {
  const found = await Promise.all(
    fromExtensions("companions").map(async ({ key, read, saved }) => ({ key, saved, json: await read(devices) })),
  );
  const present = found.flatMap(({ key, saved, json }) => (json === undefined ? [] : [{ key, saved, json }]));
  return {
    workspace: { ...workspace, ...Object.fromEntries(present.map(({ key, json }) => [key, json])) },
    said: present.map(({ saved, json }) => saved(json)).join(" "),
  };
}

async function takeCompanions(session: WorkspaceSession, workspace: unknown): Promise<void> {
  for (const { key, take } of fromExtensions("companions"))
    await take(session, isObject(workspace) ? workspace[key] : undefined);
}
