import { signal } from "@preact/signals";
import { expect, it } from "vitest";
import { createViewState } from "../data/view-state";
import { type LinkedPlace, placeQuery, readPlace } from "../page/permalink";
import {
  applyLinkText,
  linkTextOf,
  applyWorkspace,
  FORMAT,
  registerPart,
  VERSION,
  type Workspace,
  withoutMoment,
  workspaceOf,
  type WorkspaceView,
} from "./parts";
import "./view-parts";
import { randomParts, seeded } from "../testing/random-workspace";

const fresh = (): WorkspaceView => ({ viewState: createViewState(), folded: signal(false) });
const workspace = (parts: object): unknown => ({ format: FORMAT, version: VERSION, parts });

it("a view that nobody changed has an empty workspace, but for where in time it is", () => {
  expect(workspaceOf(fresh(), withoutMoment)).toEqual({ format: FORMAT, version: VERSION, parts: {} });
  expect(workspaceOf(fresh()).parts).toEqual({
    range: { span: 20 },
    cursors: { reading: null, measuring: null },
  });
});

it("restores a hundred random workspaces equal, on a fresh view and one after the other", () => {
  const next = seeded(15);
  const used = fresh();
  for (let k = 0; k < 100; k += 1) {
    const wanted = workspace(randomParts(next)) as Workspace;
    for (const view of [fresh(), used]) {
      expect(applyWorkspace(view, JSON.parse(JSON.stringify(wanted)))).toEqual([]);
      expect(workspaceOf(view)).toEqual(wanted);
    }
  }
});

it("what is unknown or broken is left out and said, and the rest is applied", () => {
  const view = fresh();
  view.viewState.extraPlots.value = new Set(["Pressure"]);
  const problems = applyWorkspace(
    view,
    workspace({ frame: "NED", extraPlots: ["a", 5], timeBase: "sundial", hologram: {}, sideFolded: true }),
  );
  expect(problems.map((text) => /“(\w+)”/.exec(text)?.[1])).toEqual(["hologram", "timeBase", "extraPlots"]);
  expect(view.viewState.frame.value).toBe("NED");
  expect(view.folded.value).toBe(true);
  expect([...view.viewState.extraPlots.value]).toEqual(["Pressure"]);
});

const RANGES = [{ span: 0 }, { span: 1e9 }, { t0: 5, t1: 5 }, { t0: 1 }, { t0: NaN, t1: 3 }, [], null, "20"];
const BROKEN = [
  ...RANGES.map((range) => ({ range })),
  { cursors: { reading: "now", measuring: null } },
  { cursors: {} },
  { series: { hide: ["a"], show: ["a"] } },
  { series: { hide: ["a", "a"], show: [] } },
  { extraPlots: [""] },
  { customPlots: ["1/Acceleration"] },
  { frame: 3 },
  { yAxes: { Acceleration: { range: [5, 5] } } },
  { yAxes: { Acceleration: {} } },
  { plotOrder: {} },
  { plotOrder: { order: [] } },
  { plotOrder: { heights: { Acceleration: 5 } } },
  { sideFolded: "yes" },
];

it.each(BROKEN)("nothing changes for %j", (parts) => {
  const view = fresh();
  const before = workspaceOf(view);
  expect(applyWorkspace(view, workspace(parts))).toHaveLength(1);
  expect(workspaceOf(view)).toEqual(before);
});

it.each([undefined, null, 3, "x", [], {}, { format: FORMAT }, { format: "else", version: VERSION, parts: {} }])(
  "%j is no workspace",
  (json) => expect(applyWorkspace(fresh(), json)).toHaveLength(1),
);

it("another version changes nothing, and is told", () => {
  const view = fresh();
  expect(applyWorkspace(view, { format: FORMAT, version: 2, parts: { frame: "NED" } })[0]).toContain("version 2");
  expect(view.viewState.frame.value).toBeUndefined();
});

it("a recording stays within itself: no window that follows, no time of another day", () => {
  const view = { ...fresh(), bounds: { first: 100, last: 200 } };
  view.viewState.view.value = { ...view.viewState.view.value, live: false, end: 200, span: 100 };
  view.viewState.cursor.value = { kind: "pinned", time: 150 };
  for (const range of [{ span: 5 }, { t0: 300, t1: 400 }])
    applyWorkspace(view, workspace({ range, cursors: { reading: 300, measuring: 90 } }));
  expect(view.viewState.view.value).toMatchObject({ live: false, end: 200, span: 100 });
  expect(view.viewState.cursor.value).toEqual({ kind: "pinned", time: 150 });
  expect(view.viewState.measure.value).toBeUndefined();
  applyWorkspace(view, workspace({ range: { t0: 120, t1: 140 }, cursors: { reading: 130, measuring: 135 } }));
  expect(view.viewState.view.value).toMatchObject({ live: false, end: 140, span: 20 });
  expect([view.viewState.cursor.value, view.viewState.measure.value]).toEqual([{ kind: "pinned", time: 130 }, 135]);
});

it("a link holds what it does not name by itself, and one that was cut changes nothing", () => {
  const next = seeded(8);
  for (let k = 0; k < 100; k += 1) {
    const [from, to] = [fresh(), fresh()];
    applyWorkspace(from, workspace(randomParts(next)));
    to.folded.value = true;
    const text = linkTextOf(from);
    expect(applyLinkText(to, text)).toEqual([]);
    expect(linkTextOf(to)).toBe(text);
    if (text === undefined) continue;
    expect(applyLinkText(to, text.slice(0, -3))).toHaveLength(1);
    expect(linkTextOf(to)).toBe(text);
    const place: LinkedPlace = { hide: [], show: [], panels: [], workspace: text };
    expect(readPlace(placeQuery(place)).workspace).toBe(text);
  }
});

it("two parts cannot have one key", () => {
  const part = { key: "frame", read: () => undefined, check: () => undefined, write: () => undefined };
  expect(() => registerPart(part)).toThrow("frame");
});
