// @vitest-environment happy-dom
import { waitFor } from "@testing-library/preact";
import { expect, it, onTestFinished } from "vitest";
import { newApp } from "../testing/live-page";
import { begun, keyOf, stored } from "../testing/family-workspace";
import { startLastState } from "./last-state";
import { sessionOf } from "./session";

const KEY = keyOf("xbus");

it("what this browser showed last goes before it, and a change is stored", async () => {
  localStorage.setItem(KEY, JSON.stringify(stored(["Temperature"])));
  const { app, plots } = await begun("xbus");
  await waitFor(() => expect(plots()).toEqual(["Temperature"]));
  app.viewState.extraPlots.value = new Set();
  await waitFor(() => expect(JSON.parse(localStorage.getItem(KEY) ?? "{}").parts).toEqual({}));
});

it("a page that is left stores what was changed a moment ago", async () => {
  localStorage.setItem(KEY, JSON.stringify(stored(["Temperature"])));
  const { app, plots } = await begun("xbus");
  await waitFor(() => expect(plots()).toEqual(["Temperature"]));
  app.viewState.extraPlots.value = new Set(["Pressure"]);
  dispatchEvent(new Event("pagehide"));
  expect(JSON.parse(localStorage.getItem(KEY) ?? "{}").parts).toEqual({ extraPlots: ["Pressure"] });
});

it("a link goes before both, and a damaged state is told and changes nothing", async () => {
  localStorage.setItem(KEY, JSON.stringify(stored(["Temperature"])));
  const linked = await begun("xbus", true);
  linked.app.viewState.frame.value = "NED";
  await waitFor(() => expect(localStorage.getItem(KEY)).toContain("NED"));
  expect(linked.plots()).toEqual([]);
  linked.stop();
  localStorage.setItem(KEY, '{"format": 3}');
  const { app, plots } = await begun("xbus");
  await waitFor(() => expect(sessionOf(app, app.viewState).problems.value).toHaveLength(1));
  expect(plots()).toEqual([]);
});

it("without a device nothing is asked for", () => {
  const app = newApp();
  onTestFinished(startLastState(app, false));
  expect(sessionOf(app, app.viewState).problems.value).toEqual([]);
});
