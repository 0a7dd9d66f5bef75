// @vitest-environment happy-dom
/** A plot of one quantity with long numbers, of a clock or a latitude. */
import { beforeEach, expect, it, vi } from "vitest";
import type { Channel } from "../data/channels";
import { createViewState } from "../data/view-state";
import { channelInfo, columnInfo } from "../testing/fixtures";
import { ringOf } from "../testing/samples";
import { giveSizes } from "../testing/live-page";
import { palette } from "./canvas-style";
import { Plot } from "./plot";
import { usualPlots } from "../signals/plot-selection";
import { timeWindow } from "./time-window";

const DIGIT_PX = 6;
let written: { readonly text: string; readonly x: number }[] = [];

beforeEach(() => {
  giveSizes();
  written = [];
  const canvas = {
    measureText: (text: string) => ({ width: DIGIT_PX * text.length }),
    fillText: (text: string, x: number) => void written.push({ text, x }),
  };
  const nothing = new Proxy(canvas, {
    get: (own, name) => (name in own ? Reflect.get(own, name) : () => undefined),
    set: () => true,
  });
  vi.spyOn(HTMLCanvasElement.prototype, "getContext").mockImplementation(() => nothing as never);
});
/** The plot of a column that rises by one a second from `from`, of which the newest 2 s are drawn. */
function drawn(name: string, from: number): Plot {
  const info = channelInfo({ id: 1, name, kind: "scalar", columns: [columnInfo({ name, label: name, dtype: "f8" })] });
  const time = Float64Array.from({ length: 201 }, (_, k) => 100 + k / 100);
  const channel: Channel = { info, ring: ringOf(time, [time.map((t) => from + t - 100)]) };
  const [spec] = usualPlots([channel], undefined);
  const plot = new Plot(spec!, () => undefined, createViewState());
  plot.visible = true;
  plot.sheet.resize(600, 120);
  const look = palette(document.body);
  const w = timeWindow({ device: "1", live: false, end: 102, span: 2, timeBase: "device" }, 102, look.gutter, 400, 1);
  plot.draw(w, look, new Set(), 0, 0);
  return plot;
}

it("has labels with all their digits over the traces if the gutter has no room for them", () => {
  drawn("uptime", 1_500_000_000);
  const { gutter } = palette(document.body);
  expect(written.length).toBeGreaterThan(2);
  for (const { text, x } of written) {
    expect(text).toMatch(/^1\s(500\s000\s00|499\s999\s99)\d(\.\d)?$/);
    expect(x).toBeGreaterThan(gutter);
  }
});

it("has short ones beside them", () => {
  drawn("uptime", 0);
  const { gutter } = palette(document.body);
  expect(written.map(({ text }) => text)).toContain("1.0");
  for (const { x } of written) expect(x).toBeLessThan(gutter);
});

it("is named by its title alone, if that is the name of its only series", () => {
  const { root } = drawn("uptime", 0);
  expect(root.querySelector(".legend")?.textContent?.match(/uptime/g)).toHaveLength(2); // for screen readers, once more
  expect(root.querySelector(".series i")?.textContent).toBe("");
  expect(written.map(({ text }) => text)).not.toContain("uptime");
});
