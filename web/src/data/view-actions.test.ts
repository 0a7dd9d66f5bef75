import { beforeEach, describe, expect, it } from "vitest";
import { LONGEST, SHORTEST } from "./view-actions";
import { createViewState } from "./view-state";

const { view, cursor, measure, hiddenSeries, actions } = createViewState();

let now = 1000;
/** The samples up to here are loaded. */
let known = Infinity;
const samples = Array.from({ length: 901 }, (_, k) => 100 + k);
const series = ["Acceleration.x", "Acceleration.y", "RateOfTurn.x"];

beforeEach(() => {
  now = 1000;
  known = Infinity;
  actions.setSnap(false);
  actions.attachPlots({
    now: () => now,
    bounds: () => ({ first: 100, last: 1000 }),
    step: (t, steps) => samples[samples.findLastIndex((s) => s <= t) + steps],
    nearest: (t) => (t > known ? undefined : Math.round(t)),
    plots: () => [],
    series: () => series,
    beside: (key) => series.filter((one) => one.split(".")[0] === key.split(".")[0]),
  });
  view.value = { device: "1", live: true, end: 0, span: 20, timeBase: "device" };
  cursor.value = undefined;
  measure.value = undefined;
  hiddenSeries.value = new Set();
});

describe("pause and live", () => {
  it("freezes the view, and follows again", () => {
    actions.pause();
    now = 1005;
    expect(view.value).toMatchObject({ live: false, end: 1000 });
    expect(actions.rightEdge()).toBe(1000);
    actions.live();
    expect(actions.rightEdge()).toBe(1005);
  });
});

describe("panning", () => {
  it("back from live pauses; forward from live does nothing", () => {
    actions.pan(0.1);
    expect(view.value.live).toBe(true);
    actions.pan(-0.5);
    expect(view.value).toMatchObject({ live: false, end: 990 });
  });

  it("stops at now and at the first sample", () => {
    actions.pan(-1000);
    expect(view.value.end).toBe(102); // a tenth of the window still shows data
    actions.panTo(5000);
    expect(view.value).toMatchObject({ live: false, end: 1000 });
  });

  it("moves to the start of memory", () => {
    actions.toStart();
    expect(view.value).toMatchObject({ live: false, end: 120 });
  });

  it("centres a moment", () => {
    actions.centreAt(500);
    expect(view.value).toMatchObject({ live: false, end: 510 });
  });
});

describe("zooming", () => {
  it("keeps the moment under the pointer", () => {
    actions.select(500, 520);
    actions.zoom(0.5, 0.25);
    expect(view.value.span).toBe(10);
    expect(view.value.end - 0.75 * 10).toBeCloseTo(505, 9);
  });

  it("keeps now at the right edge while live", () => {
    actions.zoom(2, 0.1);
    expect(view.value).toMatchObject({ live: true, span: 40 });
  });

  it("has a shortest and a longest window", () => {
    actions.setSpan(0);
    expect(view.value.span).toBe(SHORTEST);
    actions.setSpan(1e9);
    expect(view.value.span).toBe(LONGEST);
    actions.setSpan(NaN);
    expect(view.value.span).toBe(LONGEST);
  });

  it("fits everything in memory, live or not", () => {
    actions.fit();
    expect(view.value.live).toBe(true);
    expect(view.value.span).toBeCloseTo(909, 6);
    actions.select(300, 310);
    actions.fit();
    expect(view.value).toMatchObject({ live: false, end: 1000 });
  });

  it("keeps everything in memory on screen while it grows, until another range is chosen", () => {
    actions.fit();
    now = 1100;
    actions.keepFitted();
    expect(view.value.span).toBeGreaterThan(1000);
    actions.setSpan(20);
    now = 1300;
    actions.keepFitted();
    expect(view.value.span).toBe(20);
  });

  it("selects a range drawn from either side", () => {
    actions.select(310, 300);
    expect(view.value).toMatchObject({ live: false, end: 310, span: 10 });
    actions.select(300, 300);
    expect(view.value).toMatchObject({ end: 310, span: 10 });
  });
});

describe("the cursor", () => {
  it("runs with live data under the pointer, and stays when pinned", () => {
    cursor.value = { kind: "pointer", fraction: 0.5 };
    expect(actions.cursorTime()).toBe(990);
    now = 1010;
    expect(actions.cursorTime()).toBe(1000);
    actions.pin(995);
    now = 1020;
    expect(actions.cursorTime()).toBe(995);
    actions.pinMeasure(990);
    actions.unpin();
    expect([cursor.value, measure.value]).toEqual([undefined, undefined]);
  });

  it("is removed when it leaves a live window, and reported when it is outside a paused one", () => {
    actions.pin(995);
    now = 1016;
    actions.dropPassed();
    expect(cursor.value).toBeUndefined();
    actions.pause();
    actions.pin(500);
    actions.dropPassed();
    expect([actions.cursorTime(), actions.cursorBeside()]).toEqual([500, "before"]);
    actions.centreAt(400);
    expect(actions.cursorBeside()).toBe("after");
    actions.centreAt(500);
    expect(actions.cursorBeside()).toBeUndefined();
  });

  it("stays with a second one until memory no longer has the samples between them", () => {
    actions.pin(995);
    actions.pinMeasure(990);
    now = 1500;
    actions.dropPassed();
    expect([actions.cursorTime(), measure.value]).toEqual([995, 990]);
    actions.pinMeasure(99);
    actions.dropPassed();
    expect([actions.cursorTime(), measure.value]).toEqual([995, undefined]);
    actions.dropPassed();
    expect(actions.cursorTime()).toBeUndefined();
  });

  it("begins measuring inside the window with one key, and ends it with the same", () => {
    actions.toggleMeasure();
    expect(actions.cursorTime()).toBeCloseTo(980 + 20 / 3, 9);
    expect(measure.value).toBeCloseTo(980 + 40 / 3, 9);
    actions.toggleMeasure();
    expect(measure.value).toBeUndefined();
    actions.pin(999);
    actions.toggleMeasure();
    expect([actions.cursorTime(), measure.value]).toEqual([999, 999 - 20 / 3]);
    actions.stepMeasure(2);
    expect(measure.value).toBe(994);
  });

  it("snaps to samples, and waits for those that are not loaded yet", () => {
    actions.setSnap(true);
    actions.pin(990.4);
    expect(actions.cursorTime()).toBe(990);
    known = 900;
    actions.pinMeasure(950.7);
    actions.settle();
    expect(measure.value).toBe(950.7);
    known = Infinity;
    actions.settle();
    expect(measure.value).toBe(951);
    actions.setSnap(false);
    actions.pin(990.4);
    expect(actions.cursorTime()).toBe(990.4);
  });

  it("steps from sample to sample, pauses, and takes the view along", () => {
    actions.stepSample(-1);
    expect(view.value.live).toBe(false);
    expect(cursor.value).toEqual({ kind: "pinned", time: 999 });
    actions.stepSample(-30);
    expect(cursor.value).toEqual({ kind: "pinned", time: 969 });
    expect(view.value.end - view.value.span).toBe(969);
    actions.stepSample(-5000);
    expect(cursor.value).toEqual({ kind: "pinned", time: 969 });
  });
});

describe("series", () => {
  it("are hidden and shown by index", () => {
    actions.toggleSeries(1);
    expect([...hiddenSeries.value]).toEqual(["Acceleration.y"]);
    actions.toggleSeries(1);
    expect(hiddenSeries.value.size).toBe(0);
    actions.toggleSeries(8);
    expect(hiddenSeries.value.size).toBe(0);
  });

  it("can be shown alone and all restored; other plots keep theirs", () => {
    hiddenSeries.value = new Set(["Acceleration.norm"]);
    actions.toggleSeries(0, true);
    expect([...hiddenSeries.value].sort()).toEqual(["Acceleration.norm", "Acceleration.y"]);
    actions.toggleSeries(0, true);
    expect([...hiddenSeries.value]).toEqual(["Acceleration.norm"]);
  });
});

it("switches the clock of the axis", () => {
  actions.toggleTimeBase();
  expect(view.value.timeBase).toBe("arrival");
  actions.toggleTimeBase();
  expect(view.value.timeBase).toBe("device");
});
