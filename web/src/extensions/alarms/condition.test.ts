/** The condition of an alarm that is made from a signal. */
import { expect, test } from "vitest";
import type { Channel } from "../../data/channels";
import type { CursorReading } from "../../data/cursor-time";
import type { DeviceInfo } from "../../wire/types";
import { alarmCondition, canAlarm, limitOf } from "./condition";
import type { TreeRow } from "../../signals/tree-rows";

const NOW: CursorReading = {
  time: Number.POSITIVE_INFINITY,
  word: "now",
  from: 0,
  to: 100,
  base: "device",
  isOffScreen: false,
};

/** A row of a channel whose sample i, of time i, has these values. */
function row(names: readonly string[], samples: readonly (readonly number[])[], columns: readonly number[], id = 1) {
  const ring = {
    length: samples.length,
    time: (i: number) => i,
    value: (c: number, i: number) => samples[i]?.[c] ?? NaN,
    indexAt: (time: number) => Math.min(samples.length - 1, Math.floor(time)),
  };
  const all = names.map((name) => ({ name, unit: "m/s²", bits: [] }));
  const info = { id, device: "1", name: "Free acceleration", unit: "m/s²", columns: all };
  const channel = { info, ring } as unknown as Channel;
  return { key: "", level: 2, name: "", device: {} as DeviceInfo, channel, columns } as TreeRow;
}

const VECTOR = [
  [3, 4, 0],
  [0, 6, 8],
  [0, 0, 2],
];

test("without a cursor the limit is a little above all values of the window", () => {
  expect(limitOf([2, 5, 10], NaN)).toEqual({ sign: ">", limit: 12 });
  expect(limitOf([-0.011, -0.01], NaN)).toEqual({ sign: ">", limit: -0.0097 });
  expect(limitOf([], NaN)).toEqual({ sign: ">", limit: 0 });
  expect(alarmCondition(row(["x", "y", "z"], VECTOR, [0, 1, 2]), NOW)).toBe('norm("Free acceleration") > 12 m/s²');
});

test("with a cursor it is the value there, on the side that is less usual", () => {
  expect(limitOf([1, 2, 3, 4, 5], 4.56789)).toEqual({ sign: ">", limit: 4.57 });
  expect(limitOf([1, 2, 3, 4, 5], 1.5)).toEqual({ sign: "<", limit: 1.5 });
  const at: CursorReading = { ...NOW, word: "cursor", time: 1 };
  expect(alarmCondition(row(["x", "y", "z"], VECTOR, [1]), at)).toBe('"Free acceleration.y" > 6 m/s²');
  expect(alarmCondition(row(["value"], [[5], [1], [7]], [0]), at)).toBe('"Free acceleration" < 1 m/s²');
});

test("the magnitude that the page adds is that of the vector; what the page derives has no alarm", () => {
  const columns = [...VECTOR.map((values) => [...values, Math.hypot(...values)])];
  expect(alarmCondition(row(["x", "y", "z", "norm"], columns, [3]), NOW)).toBe('norm("Free acceleration") > 12 m/s²');
  expect([1, -2].map((id) => canAlarm(row(["x"], [[1]], [0], id)))).toEqual([true, false]);
});
