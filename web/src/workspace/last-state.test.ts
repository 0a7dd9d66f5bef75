// @vitest-environment happy-dom
import { waitFor } from "@testing-library/preact";
import { afterEach, beforeEach, expect, it } from "vitest";
import { newApp, openPage } from "../testing/live-page";
import { recorded } from "../testing/recorded";
import { startLastState } from "./last-state";
import { sessionOf } from "./session";

const KEY = "imuscope.workspace.xbus";
const stored = (plots: readonly string[]): object => ({
  format: "imuscope-workspace",
  version: 1,
  parts: { extraPlots: plots },
});
const DEFAULT_OF_FAMILY = {
  "GET /api/workspaces": { workspaces: [], defaults: { xbus: "race" } },
  "GET /api/workspaces/race": { name: "race", modified: 0, revision: "1", workspace: stored(["Pressure"]) },
};
let stop = (): void => undefined;

beforeEach(() => localStorage.clear());
afterEach(() => stop());

async function begun(isLinked = false) {
  const { app } = await openPage(recorded("xbus"), { answers: DEFAULT_OF_FAMILY });
  stop = startLastState(app, isLinked);
  const plots = () => [...app.viewState.extraPlots.value];
  return { app, plots };
}

it("what this browser showed last goes before it, and a change is stored", async () => {
  localStorage.setItem(KEY, JSON.stringify(stored(["Temperature"])));
  const { app, plots } = await begun();
  await waitFor(() => expect(plots()).toEqual(["Temperature"]));
  app.viewState.extraPlots.value = new Set();
  await waitFor(() => expect(JSON.parse(localStorage.getItem(KEY) ?? "{}").parts).toEqual({}));
});

it("a page that is left stores what was changed a moment ago", async () => {
  localStorage.setItem(KEY, JSON.stringify(stored(["Temperature"])));
  const { app, plots } = await begun();
  await waitFor(() => expect(plots()).toEqual(["Temperature"]));
  app.viewState.extraPlots.value = new Set(["Pressure"]);
  dispatchEvent(new Event("pagehide"));
  expect(JSON.parse(localStorage.getItem(KEY) ?? "{}").parts).toEqual({ extraPlots: ["Pressure"] });
});

it("a link goes before both, and a damaged state is told and changes nothing", async () => {
  localStorage.setItem(KEY, JSON.stringify(stored(["Temperature"])));
  const linked = await begun(true);
  linked.app.viewState.frame.value = "NED";
  await waitFor(() => expect(localStorage.getItem(KEY)).toContain("NED"));
  expect(linked.plots()).toEqual([]);
  stop();
  localStorage.setItem(KEY, '{"format": 3}');
  const { app, plots } = await begun();
  await waitFor(() => expect(sessionOf(app, app.viewState).problems.value).toHaveLength(1));
  expect(plots()).toEqual([]);
});

it("without a device nothing is asked for", () => {
  const app = newApp();
  stop = startLastState(app, false);
  expect(sessionOf(app, app.viewState).problems.value).toEqual([]);
});
