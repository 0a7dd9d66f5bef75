// @vitest-environment happy-dom
/** The measuring table over recorded samples: what it shows, what it copies, and what it asks the server. */
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { Store } from "../../data/store";
import { createViewState, type ViewState } from "../../data/view-state";
import { mountStack } from "../../plots/plot-stack";
import { giveSizes } from "../../testing/live-page";
import { answering, feed, recorded } from "../../testing/recorded";
import type { Panel } from "../../ui/dom/dom";
import { type MeasureDeps, mountMeasure } from "./panel";

const known = recorded("xbus");
let store = new Store();
let state: ViewState;
let host: HTMLElement;
let panels: readonly Panel[] = [];

function open(more: Partial<MeasureDeps> = {}): void {
  host = document.createElement("div");
  const plots = document.createElement("div");
  document.body.append(plots, host);
  panels = [mountStack(plots, { store, viewState: state }), mountMeasure(host, { viewState: state, ...more })];
}

beforeEach(() => {
  giveSizes();
  store = new Store();
  feed(store, known, known.texts);
  state = createViewState();
  state.view.value = { ...state.view.peek(), device: "1" };
});
afterEach(() => {
  for (const panel of panels) panel.dispose();
});

let clock = 0;
const draw = (): void => {
  clock += 1000;
  for (const panel of panels) panel.update(clock);
};
/** Draws until all figures are those of the range: in a frame there is time for a few only. */
const drawAll = (): void => {
  do draw();
  while (host.querySelector("tr.pending") !== null);
};
const acceleration = () => store.channels.peek().find(({ info }) => info.name === "Acceleration")!;
/** Texts of the cells of a line: "Acceleration.x" is the first below its group. */
const cells = (row: number): string[] => {
  const lines = [...host.querySelectorAll("tbody tr:not(.group-row)")];
  return [...lines[row]!.querySelectorAll("td")].map((cell) => cell.firstChild?.textContent ?? "");
};

it("shows values at both cursors and figures between them, with their units", () => {
  open();
  const { ring } = acceleration();
  const [first, last] = [ring.length - 11, ring.length - 1];
  state.actions.pin(ring.time(first));
  state.actions.pinMeasure(ring.time(last));
  draw();
  drawAll();
  const values = Array.from({ length: 11 }, (_, k) => ring.value(0, first + k));
  const mean = values.reduce((sum, v) => sum + v, 0) / 11;
  const minus = (text: string): string => text.replace("-", "−");
  const found = cells(0);
  expect(found[0]).toBe(minus(values[0]!.toFixed(3)));
  expect(found[1]).toBe(minus(values[10]!.toFixed(3)));
  expect(found[2]).toBe(minus((values[10]! - values[0]!).toFixed(3)));
  expect(found[3]).toBe(minus(mean.toFixed(3)));
  expect(found[11]).toBe("11");
  const group = [...host.querySelector(".group-row")!.querySelectorAll("td")].map((cell) => cell.textContent);
  expect(group.slice(8)).toEqual(["m/s²", "m/s³", "m/s", "", ""]);
  state.hiddenSeries.value = new Set([...state.hiddenSeries.peek(), "Acceleration.x"]);
  draw();
  drawAll();
  expect(host.querySelector("tbody th[scope=row]")?.textContent).toBe("y");
});

it("copies text, and CSV with all digits and the units of every figure", async () => {
  const copied: string[] = [];
  vi.stubGlobal("navigator", { clipboard: { writeText: async (text: string) => void copied.push(text) } });
  open();
  const { ring } = acceleration();
  state.actions.pin(ring.time(ring.length - 11));
  state.actions.pinMeasure(ring.time(ring.length - 1));
  draw();
  drawAll();
  for (const button of host.querySelectorAll<HTMLButtonElement>("button.edge")) button.click();
  await Promise.resolve();
  const [text = "", csv = ""] = copied;
  expect(text).toMatch(/^A \d\d:\d\d:\d\d\.\d{6} UTC\nB .*\nΔt .* 1\/Δt .* Hz\n\nSignal +A +B +Δ/);
  expect(text).toMatch(/Acceleration\.x .* m\/s³ .* m\/s .* 11 /);
  const [head = "", line = ""] = csv.split("\n");
  const row = Object.fromEntries(head.split(",").map((name, k) => [name, line.split(",")[k]]));
  expect(row).toMatchObject({
    signal: "Acceleration.x",
    unit: "m/s²",
    n: "11",
    slope_unit: "m/s³",
    integral_unit: "m/s",
  });
  expect(Number(row["value_a"])).toBeCloseTo(ring.value(0, ring.length - 11), 9);
  vi.unstubAllGlobals();
});

it("asks the server where the page holds only some samples, and dims what is of another range", async () => {
  const asked = answering({
    "POST /api/analysis/statistics": Array.from({ length: 40 }, (_, k) => ({
      signal: String(k),
      device: "1",
      units: {},
      figures: {
        n: 1000 + k,
        mean: 1.5,
        sigma: 0.25,
        rms: 2,
        min: 1,
        max: 3,
        peak_to_peak: 2,
        slope: 0.5,
        integral: 9,
      },
    })),
  });
  open({
    ringOf: () => undefined,
    source: {
      id: "yard",
      prefix: () => "1/",
      sent: (id) => ({ ...store.channels.peek().find(({ info }) => info.id === id)!.info }),
      changeOf: () => undefined,
    },
  });
  const { ring } = acceleration();
  state.actions.pin(ring.time(ring.length - 11));
  state.actions.pinMeasure(ring.time(ring.length - 1));
  draw();
  expect(host.querySelector("tr.pending")).not.toBeNull();
  await vi.waitFor(() => {
    draw();
    expect(cells(0)[11]).toBe("1\u2009000");
  });
  const body = asked.find(({ path }) => path.endsWith("/statistics"))?.body as { signals: string[]; source: string };
  expect(body).toMatchObject({ source: "yard", t0: ring.time(ring.length - 11), base: "device" });
  expect(body.signals.slice(0, 2)).toEqual(["1/Acceleration.x", "1/Acceleration.y"]);
  await vi.waitFor(() => {
    draw();
    expect(host.querySelector("tr.pending")).toBeNull();
  });
  const copied: string[] = [];
  vi.stubGlobal("navigator", { clipboard: { writeText: async (text: string) => void copied.push(text) } });
  const copiedCount = (): string | undefined => {
    host.querySelectorAll<HTMLButtonElement>("button.edge")[2]!.click();
    const [head = [], line = []] = (copied.pop() ?? "").split("\n").map((text) => text.split(","));
    return line[head.indexOf("n")];
  };
  expect(copiedCount()).toBe("1000");
  state.actions.pinMeasure(ring.time(ring.length - 2));
  expect(copiedCount()).toBe(""); // the server counted another range
  draw();
  expect(host.querySelector("tr.pending")).not.toBeNull();
});

it("moves a cursor by the arrow keys, and ends by its button", () => {
  open();
  const { ring } = acceleration();
  state.view.value = { ...state.view.peek(), live: false, end: ring.time(ring.length - 1) };
  state.actions.toggleMeasure();
  draw();
  const [a, b] = [...host.querySelectorAll<HTMLElement>("[role=slider]")];
  const before = [state.actions.cursorTime()!, state.measure.peek()!];
  a!.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft", bubbles: true }));
  b!.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", bubbles: true }));
  expect(state.actions.cursorTime()).toBeCloseTo(before[0]! - 0.1, 6);
  expect(state.measure.peek()).toBeCloseTo(before[1]! + 0.1, 6);
  expect(b!.getAttribute("aria-valuetext")).toMatch(/UTC$/);
  host.querySelector<HTMLButtonElement>("button.icon")!.click();
  expect(state.measure.peek()).toBeUndefined();
});
