import { describe, expect, it } from "vitest";
import { oneOf, seeded } from "../testing/random-workspace";
import {
  AREAS,
  DEFAULT_LAYOUT,
  inArea,
  isShown,
  type Layout,
  layoutJson,
  layoutOf,
  maximise,
  moveBy,
  moveTo,
  type PanelPlacement,
  setHeight,
  setSize,
  setShares,
  show,
  tile,
  treeOf,
} from "./layout";
import { EDGES, leaves } from "./tiles";

const panel = (id: string, where: string, optional = false): PanelPlacement => ({ id, where, optional });
const ALL = [
  panel("attitude", "main"),
  panel("plots", "main"),
  panel("analysis", "main", true),
  panel("values", "side"),
  panel("health", "below"),
  panel("events", "below"),
];
const [attitude, , analysis, values, , events] = ALL as [
  PanelPlacement,
  PanelPlacement,
  PanelPlacement,
  PanelPlacement,
  PanelPlacement,
  PanelPlacement,
];
const ids = (layout: Layout) => AREAS.map((area) => inArea(layout, area, ALL).map(({ id }) => id));
const DEFAULT = [["attitude", "plots"], ["values"], ["health", "events"]];

describe("a layout", () => {
  it("shows the default panels in their order until somebody changes it", () => {
    expect(ids(DEFAULT_LAYOUT)).toEqual(DEFAULT);
    expect(layoutJson(DEFAULT_LAYOUT)).toBeUndefined();
  });

  it("hides, shows and forgets what is the default again", () => {
    const hidden = show(DEFAULT_LAYOUT, values, false);
    expect(ids(hidden)[1]).toEqual([]);
    expect(show(hidden, values, true)).toEqual(DEFAULT_LAYOUT);
    expect(ids(show(DEFAULT_LAYOUT, analysis, true))[0]).toEqual(["attitude", "plots", "analysis"]);
  });

  it("moves within an area, and stops at its ends", () => {
    const up = moveBy(DEFAULT_LAYOUT, events, -1, ALL);
    expect(ids(up)[2]).toEqual(["events", "health"]);
    expect(moveBy(up, events, -1, ALL)).toBe(up);
    expect(ids(moveBy(up, events, 1, ALL))).toEqual(DEFAULT);
  });

  it("moves to another area and back, and a height does not go along", () => {
    const there = moveTo(setHeight(DEFAULT_LAYOUT, "events", 200), events, "main", ALL, 1);
    expect(ids(there)).toEqual([["attitude", "events", "plots"], ["values"], ["health"]]);
    expect(there.panels["events"]).toEqual({ area: "main" });
    expect(ids(moveTo(there, events, "below", ALL))).toEqual(DEFAULT);
  });

  it("puts a panel that comes later behind those in order", () => {
    const without = ALL.filter(({ id }) => id !== "attitude");
    const moved = moveTo(DEFAULT_LAYOUT, events, "main", without, 0);
    expect(inArea(moved, "main", ALL).map(({ id }) => id)).toEqual(["events", "plots", "attitude"]);
  });

  it("keeps sizes within limits", () => {
    expect(setSize(DEFAULT_LAYOUT, "sideWidth", 5000).sideWidth).toBe(720);
    expect(setHeight(DEFAULT_LAYOUT, "values", 1.6).panels["values"]).toEqual({ height: 60 });
    expect(setSize(setSize(DEFAULT_LAYOUT, "belowHeight", 300), "belowHeight", undefined)).toEqual(DEFAULT_LAYOUT);
  });

  it("a maximised panel that is hidden is maximised no longer", () => {
    expect(show(maximise(DEFAULT_LAYOUT, "attitude"), attitude, false).maximised).toBeUndefined();
  });
});

it("any hundred steps lead to a layout that is read from its JSON equal, with every shown panel once", () => {
  const next = seeded(3);
  let layout = DEFAULT_LAYOUT;
  for (let k = 0; k < 100; k += 1) {
    const one = oneOf(next, ALL);
    layout = oneOf(next, [
      () => show(layout, one, next() < 0.7),
      () => moveTo(layout, one, oneOf(next, AREAS), ALL, Math.floor(next() * 4)),
      () => moveBy(layout, one, next() < 0.5 ? -1 : 1, ALL),
      () => tile(layout, one, oneOf(next, ALL).id, oneOf(next, EDGES), ALL),
      () => setShares(layout, [], next() < 0.3 ? undefined : treeOf(layout, ALL).parts.map(() => 1 + next()), ALL),
      () => setHeight(layout, one.id, next() < 0.3 ? undefined : next() * 500),
      () => setSize(layout, "sideWidth", next() < 0.3 ? undefined : next() * 900),
      () => maximise(layout, next() < 0.5 ? undefined : one.id),
    ])();
    expect(layoutOf(JSON.parse(JSON.stringify(layoutJson(layout) ?? {})))).toEqual(layout);
    const shown = ids(layout).flat();
    expect(leaves(treeOf(layout, ALL))).toEqual(ids(layout)[0]);
    expect([...shown].sort()).toEqual(
      ALL.filter((panelOf) => isShown(layout, panelOf))
        .map(({ id }) => id)
        .sort(),
    );
  }
});

it.each([
  [],
  null,
  { sideWidth: 10 },
  { belowHeight: "tall" },
  { panels: { values: { area: "roof" } } },
  { panels: { values: { height: -1 } } },
  { panels: { values: { colour: "red" } } },
  { order: { main: ["a", "a"] } },
  { order: { roof: [] } },
  { maximised: "" },
  { tiles: "plots" },
  { tiles: { along: "spiral", parts: ["plots"] } },
  { tiles: { along: "row", parts: ["plots", "plots"] } },
  { tiles: { along: "row", parts: ["plots", "xy"], shares: [1] } },
  { hologram: true },
])("%j is no layout", (json) => expect(layoutOf(json as never)).toBeUndefined());
