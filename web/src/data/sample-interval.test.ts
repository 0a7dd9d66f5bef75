import { expect, test, vi } from "vitest";
import { intervalFor, MEASURED_MS, watchSampleInterval } from "./sample-interval";

test("a fast display gets samples as often as they are sent, a slow one four times a frame, a hidden page ten times a second", () => {
  expect(intervalFor(60, 1)).toBe(0);
  expect(intervalFor(25, 1)).toBe(0);
  expect(intervalFor(10, 1)).toBe(0.03);
  expect(intervalFor(5, 1)).toBe(0.05);
  expect(intervalFor(1, 1)).toBe(0.1);
  expect(intervalFor(0, 1)).toBe(0.1);
  expect(intervalFor(5, 2)).toBe(0.1); // a timer that was late: frames a second count
});

test("a change is reported once, until it is stopped", () => {
  vi.useFakeTimers();
  let drawn = 0;
  const reported: number[] = [];
  const stop = watchSampleInterval(
    () => drawn,
    (seconds) => reported.push(seconds),
  );
  for (const frames of [60, 60, 5, 5, 0, 60]) {
    drawn += frames;
    vi.advanceTimersByTime(MEASURED_MS);
  }
  expect(reported).toEqual([0.05, 0.1, 0]);
  stop();
  vi.advanceTimersByTime(10 * MEASURED_MS);
  expect(reported).toHaveLength(3);
});
