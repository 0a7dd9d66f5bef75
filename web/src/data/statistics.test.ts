import { describe, expect, it } from "vitest";
import { statsOf, wrapped } from "./statistics";

const of = (values: readonly number[], period = 360) => {
  const size = 2 ** Math.ceil(Math.log2(values.length + 1));
  const slots = new Float64Array(size);
  slots.set(values);
  return statsOf(slots, size - 1, 0, values.length, period);
};
const turn = (from: number, to: number, n = 500): number[] =>
  Array.from({ length: n }, (_, i) => wrapped(from + ((to - from) * i) / (n - 1), 360));

describe("mean and σ of an angle that turns through ±180°", () => {
  it("are circular, not linear", () => {
    // 11.46°/s over a window of 5 s: 57.3° around 175°.
    const { mean, sigma } = of(turn(175 - 28.65, 175 + 28.65));
    expect(mean).toBeCloseTo(175, 6);
    expect(sigma).toBeCloseTo(57.3 / Math.sqrt(12), 1);
  });

  it("do not depend on the position of the range, also beyond half a turn", () => {
    for (const centre of [0, 90, 170, 180, -179, -90]) {
      const { mean, sigma } = of(turn(centre - 130, centre + 130));
      expect(wrapped(mean - centre, 360)).toBeCloseTo(0, 4);
      expect(sigma).toBeCloseTo(260 / Math.sqrt(12), 0);
    }
  });

  it("agree with linear statistics where nothing wraps", () => {
    expect(of([10, 12, 17])).toEqual(of([10, 12, 17], 0));
  });

  it("follow a skewed distribution", () => {
    const values = [...Array<number>(90).fill(179), ...Array<number>(10).fill(-121)]; // 60° further on
    const { mean, sigma } = of(values);
    expect(mean).toBeCloseTo(-175, 6);
    expect(sigma).toBeCloseTo(60 * Math.sqrt(0.09 * (100 / 99)), 6);
  });

  it("are given in the range of the angle: from −180, or from 0", () => {
    expect(of([359, 1, 355]).mean).toBeCloseTo(358.333, 2);
    expect(of([-170, 175, -175]).mean).toBeCloseTo(-176.667, 2);
  });

  it("omit values that are not numbers", () => {
    expect(of([179, NaN, -179])).toMatchObject({ n: 2, mean: 180 });
    expect(of([NaN]).n).toBe(0);
  });
});

it("a spinning axis has no mean", () => {
  const { mean, sigma } = of(turn(0, 359 * 4, 4000));
  expect(mean).toBeNaN();
  expect(sigma).toBeGreaterThan(90);
});

it("works in other periods", () => {
  const { mean } = of([3.1, -3.1], 2 * Math.PI);
  expect(Math.abs(mean)).toBeCloseTo(Math.PI, 6);
});
