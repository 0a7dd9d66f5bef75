import { describe, expect, it } from "vitest";
import { embeddedBytes, type Content, type EmbeddedCurve, embeddedPlots, tickOf } from "./content";
import { endsOf, extentOf } from "./drawing";
import { difference, measured, nearestRow, valuesAt, readingText, stepped } from "./reading";

function curve(times: readonly number[], low: readonly number[], more: Partial<EmbeddedCurve> = {}): EmbeddedCurve {
  const values = new Float64Array(low);
  return {
    label: "x",
    colour: "axis-x",
    dash: [],
    decimals: 1,
    period: 0,
    times: new Float64Array(times),
    low: values,
    high: values,
    isExact: true,
    breaks: new Set(),
    ...more,
  };
}

const base64 = (array: ArrayBufferView): string => Buffer.from(array.buffer).toString("base64");

describe("an evidence file", () => {
  it("has ticks of 1, 2 or 5 times a power of ten, as the server writes them", () => {
    expect(tickOf(20)).toBeCloseTo(1e-7, 12);
    expect(tickOf(3600)).toBeCloseTo(1e-6, 12);
    expect(tickOf(86_400)).toBeCloseTo(5e-5, 10);
  });

  it("gives times and values of its blocks, shared times once", () => {
    const blocks = [new Uint32Array([0, 10_000_000]), new Float32Array([1.5, -2]), new Float64Array([3, 4])];
    const series = { label: "x", colour: "axis-x", dash: [], decimals: -1, period: 0, n: 2, step: 1, breaks: [1] };
    const content: Content = {
      t0: 100,
      t1: 120,
      cursors: { a: null, b: null },
      events: [],
      notes: { times: [] },
      plots: [
        {
          title: "Acceleration",
          unit: "m/s²",
          low: null,
          high: null,
          series: [
            { ...series, t: { block: 0, type: "u4" }, v: { block: 1, type: "f4" } },
            { ...series, t: { block: 0, type: "u4" }, low: { block: 1, type: "f4" }, high: { block: 2, type: "f8" } },
          ],
        },
      ],
    };
    const [plot] = embeddedPlots(content, (number) => base64(blocks[number] ?? new Uint8Array()));
    const [exact, thinned] = plot?.curves ?? [];
    expect([...(exact?.times ?? [])].map((t) => Math.round(t * 1e6) / 1e6)).toEqual([0, 1]);
    expect(exact?.times).toBe(thinned?.times);
    expect([...(exact?.low ?? [])]).toEqual([1.5, -2]);
    expect([exact?.isExact, thinned?.isExact]).toEqual([true, false]);
    expect(exact?.decimals).toBe(3);
    expect([...(thinned?.high ?? [])]).toEqual([3, 4]);
    expect(new Uint8Array(embeddedBytes("AAEC"))).toEqual(new Uint8Array([0, 1, 2]));
  });

  it("snaps to the nearest sample, and reads the last one up to a cursor", () => {
    const one = curve([0, 1, 2], [10, 20, 30]);
    expect(nearestRow(one, 1.4)).toBe(1);
    expect(nearestRow(one, -5)).toBe(0);
    expect(nearestRow(curve([], []), 1)).toBeUndefined();
    expect(stepped(one, 1, 1)).toBe(2);
    expect(stepped(one, 2, 1)).toBe(2);
    expect(valuesAt(one, 1.9)).toEqual({ low: 20, high: 20 });
    expect(valuesAt(one, 1 - 1e-9)).toEqual({ low: 20, high: 20 });
  });

  it("measures the samples between two cursors, both included, in either order", () => {
    const one = curve([0, 1, 2, 3], [1, 2, 6, 50]);
    expect(measured(one, 2, 0)).toEqual({ min: 1, max: 6, mean: 3, n: 3 });
    expect(difference(one, 0, 2)).toBe(5);
    expect(measured(one, 0.2, 0.8).n).toBe(0);
  });

  it("measures an angle around its circle", () => {
    const yaw = curve([0, 1], [179, -179], { period: 360 });
    expect(difference(yaw, 0, 1)).toBe(2);
    expect(Math.abs(measured(yaw, 0, 1).mean)).toBeCloseTo(180, 6);
  });

  it("says extremes, and no mean, where only those are kept", () => {
    const one = curve([0, 1], [1, 2], { high: new Float64Array([3, 5]), isExact: false });
    expect(readingText(one, valuesAt(one, 0.5))).toBe("1.0 … 3.0");
    expect(measured(one, 0, 1)).toMatchObject({ min: 1, max: 5, mean: NaN });
    expect(difference(one, 0, 1)).toBeUndefined();
  });

  it("scales a plot to what is in the window", () => {
    const plot = {
      title: "",
      unit: "",
      fixed: undefined,
      isLog: false,
      curves: [curve([0, 1, 2, 3, 4], [9, 1, 2, 3, 99])],
    };
    expect(extentOf(plot, { from: 1.5, to: 2.5, a: undefined, b: undefined })).toEqual([1, 3]);
  });

  it("has a logarithmic axis where the plot had one, as long as all values in the window are positive", () => {
    const shown = { from: 0, to: 4, a: undefined, b: undefined };
    const plot = { title: "", unit: "", fixed: undefined, isLog: true, curves: [curve([0, 1, 2], [0.001, 1, 1000])] };
    const { lo, hi, isLog } = endsOf(plot, shown);
    expect(isLog).toBe(true);
    expect(lo).toBeLessThanOrEqual(-3);
    expect(lo).toBeGreaterThan(-4.5);
    expect(hi).toBeGreaterThanOrEqual(3);
    expect(endsOf({ ...plot, fixed: [0.01, 100] }, shown)).toEqual({ lo: -2, hi: 2, isLog: true });
    expect(endsOf({ ...plot, fixed: [-1, 100] }, shown)).toEqual({ lo: -1, hi: 100, isLog: false });
    expect(endsOf({ ...plot, curves: [curve([0, 1], [0, 1])] }, shown).isLog).toBe(false);
    expect(endsOf({ ...plot, isLog: false }, shown).isLog).toBe(false);
  });
});
