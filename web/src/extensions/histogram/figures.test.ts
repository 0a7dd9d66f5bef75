/** A histogram as displayed: in another frame, its normal curve, and signals that are clipped. */
import { expect, it } from "vitest";
import { binsOf, clippedIn, normal } from "./figures";

const FIGURES = {
  ...{ edges: [1, 2, 3], counts: [10, 30], density: [0.25, 0.75], n: 43, below: 1, above: 2 },
  ...{ mean: 2.2, sigma: 0.4, min: 0.5, max: 3.5, at_min: 1, at_max: 2, width: 1, notes: ["A note."] },
};
const PLAIN = { word: "Acceleration.x", parts: 1, part: 0, factor: 1, offset: 0, period: 0 };

it("is the server's in the frame that the device sends", () => {
  const bins = binsOf(FIGURES, PLAIN);
  expect(bins).toMatchObject({ edges: [1, 2, 3], counts: [10, 30], below: 1, above: 2, mean: 2.2, notes: ["A note."] });
});

it("is mirrored where a column is shown with the other sign", () => {
  const bins = binsOf(FIGURES, { ...PLAIN, factor: -1 });
  expect(bins.edges).toEqual([-3, -2, -1]);
  expect(bins.counts).toEqual([30, 10]);
  expect(bins).toMatchObject({ below: 2, above: 1, mean: -2.2, sigma: 0.4, min: -3.5, max: -0.5, atMin: 2, atMax: 1 });
});

it("keeps its area at another scale", () => {
  const { density, width } = binsOf(FIGURES, { ...PLAIN, factor: 10 });
  expect(density.reduce((sum, one) => sum + one * width, 0)).toBeCloseTo(1);
});

it("names samples at an extreme value only if they are many", () => {
  const bins = { ...binsOf(FIGURES, PLAIN), n: 10_000 };
  expect(clippedIn({ ...bins, atMin: 1, atMax: 3 })).toBe(0);
  expect(clippedIn({ ...bins, atMin: 1, atMax: 500 })).toBe(500);
  expect(clippedIn({ ...bins, atMin: 9000, atMax: 9000, max: bins.min })).toBe(0); // it stands still
});

it("has a curve of area one", () => {
  let area = 0;
  for (let x = -10; x <= 10; x += 0.01) area += 0.01 * normal(x, 1, 0.7);
  expect(area).toBeCloseTo(1, 6);
});
