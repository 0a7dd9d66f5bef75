import { describe, expect, it } from "vitest";
import type { SampleFrame } from "../wire/codec";
import type { OrAnd, Extent } from "./minmax-pyramid";
import { seeded } from "../testing/random-workspace";
import { sampleFrame } from "../testing/samples";
import { Budget, Ring, type RingColumn } from "./ring-buffer";

const FLOAT: RingColumn = { dtype: "f8", period: 0, status: false };
const ANGLE: RingColumn = { dtype: "f8", period: 360, status: false };
const WORD: RingColumn = { dtype: "u4", period: 0, status: true };

interface Row {
  readonly time: number;
  readonly arrival: number;
  readonly values: readonly number[];
}

function frame(rows: readonly Row[], sequence: number, more: Partial<SampleFrame> = {}): SampleFrame {
  const columns = (rows[0]?.values ?? []).map((_, c) => Float64Array.from(rows, (row) => row.values[c]!));
  const [arrival, time] = [Float64Array.from(rows, (row) => row.arrival), Float64Array.from(rows, (row) => row.time)];
  return { channel: 1, n: rows.length, dropped: 0, sequence, history: false, now: 0, arrival, time, columns, ...more };
}

const steady = (from: number, n: number, value: (i: number) => number, dt = 0.01): Row[] =>
  Array.from({ length: n }, (_, k) => ({
    time: 1000 + (from + k) * dt,
    arrival: 1000.002 + (from + k) * dt,
    values: [value(from + k)],
  }));
/** Those samples alone, numbered from `from`. */
const run = (from: number, n: number, value: (i: number) => number, more: Partial<SampleFrame> = {}): SampleFrame =>
  frame(steady(from, n, value), from, more);
const held = (ring: Ring, column = 0): number[] => Array.from({ length: ring.length }, (_, i) => ring.value(column, i));
const timesOf = (ring: Ring): number[] => Array.from({ length: ring.length }, (_, i) => ring.time(i));
const breaksAt = (ring: Ring): number[] => ring.breaks.map((row) => row - ring.first);

describe("extremes of any range", () => {
  for (const seed of [1, 2, 3]) {
    it(`are those found by looking at every sample (seed ${seed})`, () => {
      const random = seeded(seed);
      const ring = new Ring([FLOAT, WORD], new Budget(2 ** 30, 3000 * 24));
      const all: Row[] = [];
      const extent: Extent = { lo: 0, hi: 0 };
      while (all.length < 6000) {
        const n = 1 + Math.floor(random() * (random() < 0.1 ? 700 : 12));
        const rows = Array.from({ length: n }, (_, k) => {
          const i = all.length + k;
          const value = random() < 0.05 ? NaN : Math.fround((random() - 0.5) * 100);
          return { time: i * 0.01, arrival: i * 0.01, values: [value, Math.floor(random() * 2 ** 32)] };
        });
        ring.take(frame(rows, all.length));
        all.push(...rows);
        for (let q = 0; q < 4; q++) {
          const a = Math.floor(random() * ring.length);
          const b = a + Math.floor(random() * (ring.length - a + 1));
          const part = all.slice(all.length - ring.length).slice(a, b);
          const numbers = part.map(({ values }) => values[0]!).filter((v) => v === v);
          ring.pyramids[0]!.query(ring.first + a, ring.first + b, extent);
          expect([extent.lo, extent.hi]).toEqual([Math.min(...numbers), Math.max(...numbers)]);
          ring.pyramids[1]!.query(ring.first + a, ring.first + b, extent);
          const words = part.map(({ values }) => values[1]!);
          expect([extent.lo, extent.hi]).toEqual([
            words.reduce((or, v) => or | v, 0),
            words.reduce((and, v) => and & v, -1),
          ]);
        }
      }
      expect(ring.length).toBe(2048); // the most that 3000 rows' worth of budget allows as a power of two
      const pyramid = ring.pyramids[1] as OrAnd;
      expect(pyramid.everSet).toBe(all.reduce((or, { values }) => or | values[1]!, 0));
    });
  }
});

describe("history", () => {
  it("prepended newest block first, with live samples in between, is complete and in order", () => {
    for (const seed of [4, 5, 6, 7]) {
      const random = seeded(seed);
      const rows = steady(0, 3000, (i) => Math.sin(i / 50));
      const ring = new Ring([FLOAT]);
      let [first, end] = [2000, 2000];
      while (first > 0 || end < 3000) {
        const n = 1 + Math.floor(random() * 300);
        if (random() < 0.5 && end < 3000) {
          ring.take(frame(rows.slice(end, end + n), end));
          end = Math.min(3000, end + n);
        } else if (end > 2000 && first > 0) {
          const from = Math.max(0, first - n);
          ring.take(frame(rows.slice(from, first), from, { history: true }));
          first = from;
        }
      }
      expect(held(ring)).toEqual(rows.map(({ values }) => values[0]));
      expect(ring.breaks).toEqual([]);
      const extent: Extent = { lo: 0, hi: 0 };
      ring.pyramids[0]!.query(ring.first + 500, ring.first + 700, extent);
      expect(extent.hi).toBe(Math.max(...rows.slice(500, 700).map(({ values }) => values[0]!)));
    }
  });

  it("is stored without any live sample", () => {
    const rows = steady(0, 40, (i) => i);
    const ring = new Ring([FLOAT]);
    ring.take(frame(rows.slice(20), 20, { history: true }));
    ring.take(frame(rows.slice(0, 20), 0, { history: true }));
    ring.take(run(40, 5, (i) => i));
    expect(held(ring)).toEqual(Array.from({ length: 45 }, (_, i) => i));
  });

  it("sent twice is stored once", () => {
    const rows = steady(0, 60, (i) => i);
    const ring = new Ring([FLOAT]);
    ring.take(frame(rows.slice(20, 40), 20));
    ring.take(frame(rows.slice(30, 60), 30));
    ring.take(frame(rows.slice(0, 30), 0, { history: true }));
    expect(held(ring)).toEqual(rows.map(({ values }) => values[0]));
  });
});

describe("time", () => {
  it("inserts a late sample in order, and reports it", () => {
    const rows = steady(0, 50, (i) => i);
    const late = { time: 1000.205, arrival: 1000.5, values: [-1] };
    const ring = new Ring([FLOAT]);
    ring.take(frame([...rows, late], 0));
    expect(timesOf(ring)).toEqual([...timesOf(ring)].sort((a, b) => a - b));
    expect(ring.value(0, 21)).toBe(-1);
    expect(ring.late).toBe(1);
    const extent: Extent = { lo: 0, hi: 0 };
    ring.pyramids[0]!.query(ring.first + 20, ring.first + 23, extent);
    expect(extent).toEqual({ lo: -1, hi: 21 });
  });

  it("inserts a late sample in order between two blocks of history", () => {
    const rows = steady(0, 40, (i) => i);
    const late = { time: 1000.095, arrival: 1000.2, values: [-1] };
    const whole = [...rows.slice(0, 20), late, ...rows.slice(20)];
    const ring = new Ring([FLOAT]);
    ring.take(frame(whole.slice(20), 20));
    ring.take(frame(whole.slice(0, 20), 0, { history: true }));
    expect(timesOf(ring)).toEqual([...timesOf(ring)].sort((a, b) => a - b));
    expect(ring.value(0, 10)).toBe(-1);
  });

  it("falls back to arrival where there is no device clock", () => {
    const ring = new Ring([FLOAT]);
    const rows = steady(0, 5, (i) => i).map((row) => ({ ...row, time: NaN }));
    ring.take(frame(rows, 0));
    expect(ring.clocked).toBe(false);
    expect(ring.time(2)).toBe(ring.arrival(2));
  });

  it("finds the last sample not after a moment", () => {
    const ring = new Ring([FLOAT]);
    ring.take(run(0, 10, (i) => i));
    expect(ring.indexAt(999, "device")).toBe(-1);
    expect(ring.indexAt(ring.time(3), "device")).toBe(3);
    expect(ring.indexAt(ring.time(3) + 0.009, "device")).toBe(3);
    expect(ring.indexAt(ring.time(3), "arrival")).toBe(2);
    expect(ring.indexAt(2000, "device")).toBe(9);
  });
});

describe("gaps", () => {
  it("are where one sample or more is missing between even ones", () => {
    const ring = new Ring([FLOAT]);
    ring.take(frame([...steady(0, 30, () => 0), ...steady(33, 30, () => 0), ...steady(64, 30, () => 0)], 0));
    expect(breaksAt(ring)).toEqual([30, 60]);
  });

  it("are where samples were dropped, however close they are", () => {
    const ring = new Ring([FLOAT]);
    ring.take(run(0, 30, () => 0));
    ring.take(run(31, 30, () => 0, { dropped: 1 }));
    expect(breaksAt(ring)).toEqual([30]);
    expect(ring.dropped).toBe(1);
  });

  it("are made by one missing sample that the device's counter reports, before or after the samples", () => {
    for (const early of [true, false]) {
      const ring = new Ring([FLOAT]);
      const even = [...steady(0, 100, () => 0), ...steady(101, 60, () => 0), ...steady(162, 60, () => 0)];
      const samples = even.map((row, k) => ({ ...row, time: row.time + Number(k % 3 === 2) * 0.003 }));
      const [t0, t1] = [samples[99]!.time, samples[100]!.time];
      const lose = (): void => {
        ring.lose(t0, t1);
        ring.lose(samples[40]!.time, samples[41]!.time); // of another message of the device: no gap here
      };
      if (early) lose();
      ring.take(frame(samples, 0));
      if (!early) lose();
      expect(breaksAt(ring)).toEqual([100]); // the second hole may be jitter: no gap was reported
    }
  });

  it("do not occur where the device changed its rate", () => {
    const ring = new Ring([FLOAT]);
    const slow = Array.from({ length: 600 }, (_, k) => ({ time: 2000 + k, arrival: 2000 + k, values: [0] }));
    ring.take(run(0, 600, () => 0));
    for (let k = 0; k < 600; k += 20) ring.take(frame(slow.slice(k, k + 20), 600 + k));
    expect(breaksAt(ring)).toEqual([600]); // and not at the first seconds of the new rate, once that is known
    expect(breaksAt(ring)[0]).toBe(600);
  });

  it("do not occur in the bursts of a USB adapter, for samples with arrival times only", () => {
    const ring = new Ring([FLOAT]);
    const bursts = Array.from({ length: 400 }, (_, k) => ({
      time: NaN,
      arrival: 1000 + Math.floor(k / 16) * 0.016,
      values: [0],
    }));
    for (let k = 0; k < 400; k += 16) ring.take(frame(bursts.slice(k, k + 16), k));
    expect(ring.breaks).toEqual([]);
  });

  it("are made where the device's clock restarted, whether reported before or after the samples", () => {
    for (const early of [true, false]) {
      const ring = new Ring([FLOAT]);
      const turn = steady(0, 200, (i) => i % 100)[100]!.time;
      if (early) ring.cut(turn);
      ring.take(run(0, 120, (i) => i % 100));
      ring.take(run(120, 80, (i) => i % 100));
      if (!early) ring.cut(turn);
      ring.cut(turn); // reported again after a reconnect
      expect(breaksAt(ring)).toEqual([100]);
      const earlier = steady(-50, 50, () => 0);
      ring.take(frame(earlier, 0, { history: true }));
      expect(breaksAt(ring).length).toBe(1);
    }
  });

  it("are not made where a heading wraps; the wrap is marked", () => {
    const ring = new Ring([ANGLE]);
    ring.take(run(0, 100, (i) => ((i * 7 + 180) % 360) - 180));
    expect(ring.breaks).toEqual([]);
    const wraps = ring.wraps[0]!.map((row) => row - ring.first);
    expect(wraps.length).toBe(2);
    for (const i of wraps) expect(Math.abs(ring.value(0, i) - ring.value(0, i - 1))).toBeGreaterThan(180);
  });
});

describe("memory", () => {
  it("grows to its budget and then drops the oldest samples", () => {
    const budget = new Budget(2 ** 30, 1100 * 26);
    const ring = new Ring([FLOAT], budget);
    for (let k = 0; k < 50; k++) ring.take(run(k * 100, 100, (i) => i));
    expect(ring.length).toBe(1024);
    expect(ring.value(0, 0)).toBe(5000 - 1024);
    expect(ring.value(0, 1023)).toBe(4999);
    expect(budget.used).toBeLessThanOrEqual(1100 * 26);
  });

  it("takes a frame longer than itself", () => {
    const ring = new Ring([FLOAT], new Budget(2 ** 30, 300 * 26));
    ring.take(run(0, 1000, (i) => i));
    expect([ring.length, ring.value(0, 0)]).toEqual([256, 744]);
  });

  it("stops growing when all rings together have reached the budget", () => {
    const budget = new Budget(600 * 26, 2 ** 30);
    const rings = [new Ring([FLOAT], budget), new Ring([FLOAT], budget)];
    for (const ring of rings) ring.take(run(0, 1000, (i) => i));
    expect(rings.map(({ length }) => length)).toEqual([256, 256]);
  });
});

it("computes mean and spread without cancellation", () => {
  const ring = new Ring([FLOAT]);
  ring.take(run(0, 100, (i) => 1e9 + (i % 2)));
  const { n, mean, sigma, min, max } = ring.stats(0, 1000, 1001, "device");
  expect({ n, min, max }).toEqual({ n: 100, min: 1e9, max: 1e9 + 1 });
  expect(mean).toBeCloseTo(1e9 + 0.5, 6);
  expect(sigma).toBeCloseTo(Math.sqrt(25 / 99), 6);
});

it("keeps 64-bit integers as numbers", () => {
  const ring = new Ring([{ dtype: "u8", period: 0, status: false }]);
  ring.take({
    ...run(0, 1, () => 0),
    columns: [BigUint64Array.of(2n ** 53n)],
  });
  expect(ring.value(0, 0)).toBe(2 ** 53);
});

it("breaks lines over thousands of lost samples, also if they are reported before the samples arrive", () => {
  const ring = new Ring([FLOAT]);
  const kept = Array.from({ length: 30_000 }, (_, i) => i).filter((i) => i % 10 !== 5); // every tenth is lost
  for (let i = 29_995; i > 0; i -= 10) ring.lose((i - 1) * 0.01 + 1000, (i + 1) * 0.01 + 1000);
  ring.lose(1010, 1010.5); // one that overlaps others
  const times = Float64Array.from(kept, (i) => 1000 + i * 0.01);
  ring.take(sampleFrame(times, [times]));
  expect(ring.breaks.length).toBe(3000);
});

it("takes the circular mean of an angle", () => {
  const ring = new Ring([ANGLE, FLOAT]);
  const values = [179, -179, 179, -179];
  ring.take(
    frame(
      values.map((value, k) => ({ time: 1000 + k, arrival: 1000 + k, values: [value, value] })),
      0,
    ),
  );
  expect(Math.abs(ring.stats(0, 1000, 1010, "device").mean)).toBeCloseTo(180, 6);
  expect(ring.stats(1, 1000, 1010, "device").mean).toBeCloseTo(0, 6);
});
