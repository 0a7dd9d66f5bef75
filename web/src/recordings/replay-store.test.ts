import { expect, it } from "vitest";
import type { SampleFrame } from "../wire/codec";
import type { ChannelInfo, EventInfo } from "../wire/types";
import { channelInfo, columnInfo, eventInfo } from "../testing/fixtures";
import { sampleFrame } from "../testing/samples";
import { isBounds, ReplayStore } from "./replay-store";

const info = (id: number): ChannelInfo =>
  channelInfo({
    ...{ id, name: `N${id}`, title: "Acceleration", kind: "vector", unit: "m/s²" },
    columns: (["x", "y", "z"] as const).map((name) => columnInfo({ name, dtype: "f8", unit: "m/s²", axis: name })),
  });
const frame = (channel: number, time: readonly number[], values: readonly number[]): SampleFrame =>
  sampleFrame(time, [values, values, values], { channel, sequence: 7, history: true });
const step = eventInfo({ time: 5, kind: "clock" });
const store = (events: readonly EventInfo[] = []): ReplayStore =>
  new ReplayStore({ devices: [], channels: [info(1), info(2)], events, longest_s: { 1: 0.1, 2: 0.1 } }, () => 42);

it("stores only the newest range, and does not change other channels", () => {
  const replay = store();
  const of = (name: string) => replay.channel("1", name)!.ring;
  replay.show([1, 2], [frame(1, [0, 1, 2], [1, 2, 3]), frame(2, [0], [9])], { t0: 0, t1: 3, width: 10 }, true);
  replay.show([1], [frame(1, [5, 6], [7, 8])], { t0: 5, t1: 7, width: 10 }, true);
  expect([of("N1").length, of("N1").time(0), of("N1").value(0, 1)]).toEqual([2, 5, 8]);
  expect(of("N2").length).toBe(1);
  replay.keepOnly([1]);
  expect(of("N2").length).toBe(0);
  expect(replay.serverNow()).toBe(42);
});

it("takes bounds from samples, and joins adjacent bounds only", () => {
  const times = [0, 0, 1, 1, 2, 2, 5, 5];
  expect(isBounds(frame(1, times, times), "vector")).toBe(true);
  expect(isBounds(frame(1, times, times), "table")).toBe(false);
  expect(isBounds(frame(1, [0, 1, 2, 3], times), "vector")).toBe(false);
  const replay = store();
  replay.show([1], [frame(1, times, [-3, 4, -3, 4, -3, 4, -3, 4])], { t0: 0, t1: 6, width: 6 }, false);
  const { ring } = replay.channel("1", "N1")!;
  expect(ring.breaks.map((row) => row - ring.first)).toEqual([6]);
  // The norm of bounds is a bound of norms, not the norm of the least components.
  expect(ring.value(3, 0)).toBe(0);
  expect(ring.value(3, 1)).toBeCloseTo(4 * Math.sqrt(3), 4);
});

it("draws no line over one lost sample, nor a break where a slow channel lost none", () => {
  const gap = eventInfo({ kind: "gap", t0: 1.0, t1: 1.2, samples: 1 });
  const replay = store([gap]);
  const times = [0.8, 0.9, 1.0, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8];
  replay.show(
    [1, 2],
    [frame(1, times, times), frame(2, [0.95, 1.05, 1.15, 1.25, 1.35], [1, 2, 3, 4, 5])],
    { t0: 0, t1: 2, width: 100 },
    true,
  );
  const { ring } = replay.channel("1", "N1")!;
  expect(ring.breaks.map((row) => ring.time(row - ring.first))).toEqual([1.2]);
  expect(replay.channel("1", "N2")!.ring.breaks).toEqual([]);
});

it("draws no line over a step of the device's clock, in any range", () => {
  const replay = store([step]);
  const { ring } = replay.channel("1", "N1")!;
  for (const from of [4, 4.5]) {
    const times = Array.from({ length: 12 }, (_, k) => from + 0.1 * k);
    replay.show([1], [frame(1, times, times)], { t0: from, t1: from + 2, width: 100 }, true);
    expect(ring.breaks.map((row) => ring.time(row - ring.first))[0]).toBeCloseTo(5, 6);
  }
});
