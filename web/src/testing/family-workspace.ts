/** A page of a recorded device whose family has a default workspace, and which keeps its last state. */
import { beforeEach, onTestFinished } from "vitest";
import { startLastState } from "../workspace/last-state";
import { openPage } from "./live-page";
import { type Family, recorded } from "./recorded";

export const keyOf = (family: Family): string => `imuscope.workspace.${family}`;
export const stored = (plots: readonly string[]): object => ({
  format: "imuscope-workspace",
  version: 1,
  parts: { extraPlots: plots },
});
const defaultOf = (family: Family) => ({
  "GET /api/workspaces": { workspaces: [], defaults: { [family]: "race" } },
  "GET /api/workspaces/race": { name: "race", modified: 0, revision: "1", workspace: stored(["Pressure"]) },
});

beforeEach(() => localStorage.clear());

export async function begun(family: Family, isLinked = false) {
  const { app } = await openPage(recorded(family), { answers: defaultOf(family) });
  const stop = startLastState(app, isLinked);
  onTestFinished(stop);
  const plots = () => [...app.viewState.extraPlots.value];
  return { app, plots, stop };
}
