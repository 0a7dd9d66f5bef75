import { describe, expect, it } from "vitest";
import { rangeFigures, NO_FIGURES } from "./range-figures";
import type { Ring } from "../../data/ring-buffer";
import { ringOf as columnsOf } from "../../testing/samples";

const ringOf = (times: readonly number[], values: readonly number[], period = 0): Ring =>
  columnsOf(times, [values], period);

const START = 1.7e9;
const even = (n: number, step = 0.25): number[] => Array.from({ length: n }, (_, k) => START + k * step);

describe("figures of a range", () => {
  it("are those of a straight line", () => {
    const times = even(9);
    const ring = ringOf(
      times,
      times.map((t) => 3 * (t - START) - 1),
    );
    const found = rangeFigures(ring, 0, START, START + 2, "device", 0);
    expect(found).toMatchObject({ n: 9, gaps: 0, min: -1, max: 5, peakToPeak: 6 });
    expect(found.mean).toBeCloseTo(2, 12);
    expect(found.slope).toBeCloseTo(3, 9);
    expect(found.integral).toBeCloseTo(4, 9);
    expect(found.rms).toBeCloseTo(Math.sqrt(4 + 3.75), 12); // mean² and the variance of the nine: 9 · (8 · 10 / 12) / 16
  });

  it("count both ends, leave missing values out, and see the gap between them", () => {
    const values = [9, 1, 2, NaN, NaN, 5, 6, 9];
    const found = rangeFigures(ringOf(even(8), values), 0, START + 0.25, START + 1.5, "device", 0);
    expect(found).toMatchObject({ n: 4, mean: 3.5, min: 1, max: 6, gaps: 1 });
    expect(found.rms).toBeCloseTo(Math.sqrt((1 + 4 + 25 + 36) / 4), 12);
    expect(found.integral).toBeCloseTo(0.25 * 1.5 + 0.75 * 3.5 + 0.25 * 5.5, 9);
  });

  it("go around the circle", () => {
    const turning = [170, 175, -180, -175, -170];
    const found = rangeFigures(ringOf(even(5), turning, 360), 0, START, START + 1, "device", 360);
    expect(found).toMatchObject({ n: 5, peakToPeak: 20, rms: NaN, min: 170, max: -170 });
    const round = rangeFigures(ringOf(even(5), [0, 90, 180, -90, 0], 360), 0, START, START + 1, "device", 360);
    expect(round).toMatchObject({ peakToPeak: 360, min: NaN, max: NaN });
    expect(Math.abs(found.mean)).toBeCloseTo(180, 9);
    expect(found.sigma).toBeCloseTo(Math.sqrt(250 / 4), 9);
    expect(found.slope).toBeCloseTo(20, 9);
    expect(found.integral).toBeNaN();
  });

  it("are none without samples, and have no slope from one", () => {
    const ring = ringOf(even(3), [1, 2, 3]);
    expect(rangeFigures(ring, 0, START + 0.3, START + 0.4, "device", 0)).toEqual(NO_FIGURES);
    const one = rangeFigures(ring, 0, START + 0.2, START + 0.3, "device", 0);
    expect(one).toMatchObject({ n: 1, mean: 2, integral: 0, gaps: 0 });
    expect(one.slope).toBeNaN();
  });
});
