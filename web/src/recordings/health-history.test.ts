import { expect, it } from "vitest";
import type { EventInfo } from "../wire/types";
import type { HealthHistory } from "../wire/routes";
import { figuresAt, minuteAt } from "./health-history";

const history: HealthHistory = {
  first: 1000,
  before: 0,
  bytes: [0, 400, 1000, 1000, 0, 1000],
  jitter_ms: [null, 1, 2, 3, null, 4],
  drift_ppm: [null, null, 7, 7, 7, 7],
  uncertainty_ms: [null, null, 0.2, 0.2, 0.2, 0.2],
  messages: { Fast: [0, 40, 100, 100, 0, 100], Slow: [0, 0, 1, 0, 0, 1] },
  counted: { Fast: 0, Slow: 0 },
};
const gap = { device: "1", kind: "gap", time: 1004.5, samples: 100, data: {} } as unknown as EventInfo;

it("gives the rates of the seconds before, and counts up to the moment", () => {
  const told = figuresAt(history, 1004.2);
  expect(told.bytes).toBe(2400);
  expect(told.bytes_per_s).toBe(1000); // the incomplete first second does not count
  expect(told.messages).toEqual([
    { name: "Fast", rate: 100, count: 240 },
    { name: "Slow", rate: 0.5, count: 1 },
  ]);
  expect(told.rate).toBe(100);
  expect(told.last_arrival).toBe(1004);
  expect([told.jitter_ms, told.drift_ppm]).toEqual([3, 7]);
});

it("gives nothing without data", () => {
  expect(figuresAt(history, 999)).toEqual({});
  expect(figuresAt(history, 1006)).toEqual({});
  expect(figuresAt(history, 1001.5)).toMatchObject({ bytes: 400 });
  expect(figuresAt(history, 1001.5).rate).toBeUndefined();
});

it("gives the minute of the sparklines with its losses", () => {
  const minute = minuteAt(history, [gap], "1", 1005.5);
  expect(minute.map(({ time }) => time)).toEqual([
    1001.49, 1001.99, 1002.49, 1002.99, 1003.49, 1003.99, 1004.49, 1004.99, 1005.49,
  ]);
  expect(minute.map(({ rate }) => rate)).toEqual([40, 40, 100, 100, 100, 100, 0, 0, 0]);
  expect(minute.map(({ lost }) => lost)).toEqual([0, 0, 0, 0, 0, 0, 100, 100, 100]);
});
