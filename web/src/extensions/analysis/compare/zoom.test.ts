/** Zooming along the time of a comparison. */
import { expect, test } from "vitest";
import { type Ends, keyed, panned, wheeled, zoomedRange } from "./zoom";

const ALL: Ends = [0, 100];

test("a zoom keeps the moment under the pointer, and stays within everything", () => {
  expect(zoomedRange(ALL, ALL, 0.5, 0.2)).toEqual([10, 60]);
  expect(zoomedRange([10, 60], ALL, 4, 0.2)).toEqual(ALL);
  expect(zoomedRange([90, 100], ALL, 2, 1)).toEqual([80, 100]);
  const [from, to] = zoomedRange([50, 51], ALL, 1e-6, 0.5);
  expect(to - from).toBeCloseTo(0.25);
  expect((from + to) / 2).toBeCloseTo(50.5);
});

test("it is moved as far as there is something", () => {
  expect(panned([10, 20], ALL, 0.5)).toEqual([15, 25]);
  expect(panned([10, 20], ALL, -3)).toEqual([0, 10]);
  expect(panned([85, 95], ALL, 3)).toEqual([90, 100]);
});

test("the wheel zooms, and moves with Shift or sideways", () => {
  const wheel = { deltaX: 0, deltaY: -100, shiftKey: false };
  const [from, to] = wheeled(ALL, ALL, wheel, 0.5);
  expect(to - from).toBeCloseTo(100 * Math.exp(-0.15));
  expect(wheeled([10, 20], ALL, { ...wheel, deltaY: 80, shiftKey: true }, 0.5)).toEqual([11, 21]);
  expect(wheeled([10, 20], ALL, { deltaX: 80, deltaY: 1, shiftKey: false }, 0.5)).toEqual([11, 21]);
});

test("keys zoom about the middle and show everything again", () => {
  expect(keyed([40, 70], ALL, "+")).toEqual([45, 65]);
  expect(keyed([45, 65], ALL, "-")).toEqual([40, 70]);
  expect(keyed([45, 65], ALL, "f")).toEqual(ALL);
  expect(keyed(ALL, ALL, "ArrowLeft")).toBeUndefined();
});
