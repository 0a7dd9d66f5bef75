/** The same cases as tests/recordings/columns/test_breaks.py. */
import { describe, expect, it } from "vitest";
import { gapsIn } from "./line-breaks";

const steps = (...parts: readonly (readonly [number, number])[]): Float64Array =>
  Float64Array.from(parts.flatMap(([n, step]) => Array.from({ length: n }, () => step)));

describe("gaps of a series", () => {
  it("are none in an even series, a change of rate, a pattern or bursts", () => {
    const bursts = Float64Array.from({ length: 4799 }, (_, k) => (k % 16 === 15 ? 0.016 : 0));
    const pattern = Float64Array.from({ length: 2700 }, (_, k) => (k % 3 === 2 ? 0.02 : 0.01));
    const changed = steps([900, 0.005], [900, 0.02], [900, 0.005]);
    expect([steps([2, 1]), steps([3000, 0.01]), changed, pattern, bursts].map(gapsIn)).toEqual([0, 0, 0, 0, 0]);
  });

  it("are each lost sample, beside an outage too, and a pause between bursts", () => {
    expect(gapsIn(steps([100, 0.01], [1, 0.02], [500, 0.01]))).toBe(1);
    expect(gapsIn(steps([149, 0.01], [1, 20.01], [19, 0.01], [1, 0.02], [29, 0.01]))).toBe(2);
    const paused = Float64Array.from({ length: 4799 }, (_, k) => (k === 2399 ? 0.216 : k % 16 === 15 ? 0.016 : 0));
    expect(gapsIn(paused)).toBe(1);
  });
});
