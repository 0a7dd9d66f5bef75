/** Marks of losses. */
import { expect, it } from "vitest";
import { lossMarks } from "./loss-marks";

it("3 % loss does not look like the loss of everything", () => {
  const some = Array.from({ length: 100 }, (_, k) => [k, k + 0.03] as const);
  const [mark, ...more] = lossMarks(some, 1.5);
  expect(more).toEqual([]);
  expect(mark?.share).toBe(0.4);
  const all = Array.from({ length: 100 }, (_, k) => [k, k + 1] as const);
  expect(lossMarks(all, 1.5)[0]?.share).toBeGreaterThan(0.9);
  expect(lossMarks([[0, 90], ...some.slice(91)], 1.5)).toHaveLength(2);
});

it("a loss by itself is as wide as can be seen", () => {
  expect(lossMarks([[10, 10]], 2)).toEqual([{ from: 9, to: 11, share: 0.4 }]);
  expect(lossMarks([[10, 30]], 2)).toEqual([{ from: 10, to: 30, share: 1 }]);
});
