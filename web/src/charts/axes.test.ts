/** Axes of charts: every value keeps its place, and no peak is lost in a pixel. */
import { describe, expect, test } from "vitest";
import { axisOf, curve, figure, nearest, share, axisTicks, valueAtShare } from "./axes";

describe("axes", () => {
  test("an axis holds all finite values; a logarithmic one only positive ones", () => {
    expect(axisOf("linear", [3, null, -1, NaN, 2])).toEqual({ kind: "linear", low: -1, high: 3 });
    expect(axisOf("log", [3, 0, -1, 0.5, null])).toEqual({ kind: "log", low: 0.5, high: 3 });
    expect(axisOf("log", [0, null])).toBeUndefined();
    expect(axisOf("linear", [2])).toEqual({ kind: "linear", low: 1, high: 3 });
  });

  test.each(["linear", "log"] as const)("a share of a %s axis leads back to its value", (kind) => {
    const axis = { kind, low: 0.01, high: 50 };
    for (const value of [0.01, 0.3, 7, 50]) expect(valueAtShare(axis, share(axis, value))).toBeCloseTo(value, 10);
  });

  test("ticks are powers of ten over decades, and round steps within one", () => {
    const decades = axisTicks({ kind: "log", low: 0.0005, high: 20000 }, 10);
    expect(decades.map(({ text }) => text)).toEqual(["0.001", "0.01", "0.1", "1", "10", "100", "1000", "10000"]);
    expect(axisTicks({ kind: "log", low: 1e-9, high: 1e-3 }, 4).map(({ text }) => text)).toEqual([
      "10⁻⁹",
      "10⁻⁷",
      "10⁻⁵",
      "0.001",
    ]);
    expect(axisTicks({ kind: "log", low: 0.004, high: 0.3 }, 9).map(({ text }) => text)).toEqual([
      ...["0.005", "0.01", "0.02", "0.05", "0.1", "0.2"],
    ]);
    expect(axisTicks({ kind: "linear", low: 0, high: 52 }, 6).map(({ text }) => text)).toEqual([
      "0",
      "10",
      "20",
      "30",
      "40",
      "50",
    ]);
    expect(axisTicks({ kind: "log", low: 2, high: 9 }, 4).map(({ text }) => text)).toEqual(["2", "4", "6", "8"]);
  });

  test("figures have the digits that tell something", () => {
    expect([0.0123456, 1234.5678, 0, -9.80665, 1.5e-7, 2e9, null, NaN].map((value) => figure(value))).toEqual([
      "0.01235",
      "1235",
      "0",
      "−9.807",
      "1.5·10⁻⁷",
      "2·10⁹",
      "—",
      "—",
    ]);
  });
});

describe("curves", () => {
  const axes = { x: { kind: "linear", low: 0, high: 9999 }, y: { kind: "log", low: 1, high: 1000 } } as const;
  const x = Array.from({ length: 10_000 }, (_, i) => i);

  test("a curve of many values is thinned, and keeps its peaks", () => {
    const y = x.map((i) => (i === 5003 ? 1000 : i === 7009 ? 1 : 10));
    const [part, ...others] = curve(x, y, axes, 500, 300);
    expect(others).toEqual([]);
    expect(part?.length).toBeLessThanOrEqual(4 * 501);
    expect(Math.min(...(part ?? []).map((point) => point[1]))).toBeCloseTo(0);
    expect(Math.max(...(part ?? []).map((point) => point[1]))).toBeCloseTo(300);
  });

  test("a value without a place breaks the curve", () => {
    const parts = curve([0, 1, 2, 3], [10, null, 10, 0], { ...axes, x: { kind: "linear", low: 0, high: 3 } }, 300, 300);
    expect(parts.map((part) => part.length)).toEqual([1, 1]);
  });

  test("the reading is that of the nearest value", () => {
    expect(nearest([1, 2, 4, null], 3.2)).toBe(2);
    expect(nearest([], 1)).toBe(-1);
  });
});
