import { expect, it } from "vitest";
import { createViewState, type ViewState } from "./view-state";

const series = ["Acceleration.x", "Acceleration.y"];
const over = (first: number, last: number): ViewState => {
  const state = createViewState();
  state.actions.attachPlots({
    now: () => last,
    bounds: () => ({ first, last }),
    nearest: () => undefined,
    plots: () => [],
    step: (t, steps) => t + steps,
    series: () => series,
    beside: () => series,
  });
  return state;
};

it("two views beside each other have their own windows, cursors and series", () => {
  const [left, right] = [over(0, 100), over(1000, 5000)];
  left.actions.fit();
  left.actions.pause();
  left.actions.pin(40);
  left.actions.pinMeasure(60);
  left.actions.toggleSeries(1);
  left.actions.toggleTimeBase();
  expect(left.view.value).toMatchObject({ live: false, end: 100, span: 101, timeBase: "arrival" });
  expect(right.view.value).toMatchObject({ live: true, span: 20, timeBase: "device" });
  expect(right.actions.cursorTime()).toBeUndefined();
  expect(right.measure.value).toBeUndefined();
  expect(right.hiddenSeries.value.size).toBe(0);
  right.actions.toStart();
  right.actions.pin(1500);
  expect(right.view.value.end).toBe(1020);
  expect([left.actions.rightEdge(), left.actions.cursorTime()]).toEqual([100, 40]);
});

it("a view made like another one begins with its series, shares its frame, and changes nothing else of it", () => {
  const one = createViewState();
  one.hiddenSeries.value = new Set(["Acceleration.norm"]);
  one.knownNorms.add("Acceleration.norm");
  one.extraPlots.value = new Set(["Temperature"]);
  const other = createViewState(one);
  expect([...other.hiddenSeries.value, ...other.knownNorms]).toEqual(["Acceleration.norm", "Acceleration.norm"]);
  other.hiddenSeries.value = new Set();
  other.knownNorms.add("RateOfTurn.norm");
  other.extraPlots.value = new Set();
  other.frame.value = "NED";
  expect([...one.hiddenSeries.value, ...one.knownNorms, ...one.extraPlots.value]).toEqual([
    "Acceleration.norm",
    "Acceleration.norm",
    "Temperature",
  ]);
  expect(one.frame.value).toBe("NED");
});

it("no code reads a part of the view through all of it, or it would run with every frame of a drag", () => {
  const sources = import.meta.glob<string>(
    ["../**/*.{ts,tsx}", "!../**/*.test.*", "!./view-state.ts", "!../testing/bench.ts"],
    {
      eager: true,
      query: "?raw",
      import: "default",
    },
  );
  const reads = Object.entries(sources).flatMap(([file, text]) =>
    [...text.matchAll(/\bview\.value\.\w+|\{[^{}=]*\} = [\w.#]*\bview\.value;/g)].map(([found]) => `${file}: ${found}`),
  );
  expect(Object.keys(sources).length).toBeGreaterThan(200);
  expect(reads).toEqual([]);
});
