/** Pairs of two signals: as read from rings, across gaps and angles, and thinned without losing an extreme. */
import { describe, expect, it } from "vitest";
import { seeded } from "../../testing/random-workspace";
import { sampleFrame } from "../../testing/samples";
import { extent, indexAt, type PairedColumn, PairSeries, type Pairs } from "./pairs";
import { Ring } from "../../data/ring-buffer";

const START = 1_760_000_000;

function ringOf(times: readonly number[], columns: readonly (readonly number[])[], period = 0): Ring {
  const ring = new Ring(columns.map(() => ({ dtype: "f8" as const, period, status: false })));
  add(ring, times, columns);
  return ring;
}

function add(ring: Ring, times: readonly number[], columns: readonly (readonly number[])[], sequence = 0): void {
  ring.take(
    sampleFrame(
      Float64Array.from(times, (t) => START + t),
      columns,
      { sequence },
    ),
  );
}

const even = (n: number, step: number): number[] => Array.from({ length: n }, (_, k) => k * step);
const column = (ring: Ring, at = 0, period = 0): PairedColumn => ({ ring, column: at, period });
const pairs = (x: PairedColumn, y: PairedColumn, how: "interpolated" | "nearest" = "interpolated"): Pairs =>
  new PairSeries(x, y, how, "device").between(START - 1, START + 1e6);
const startsOf = ({ starts }: Pairs): number[] => Array.from(starts).flatMap((one, k) => (one ? [k] : []));

describe("pairing", () => {
  it("takes columns of one channel row by row, and breaks the line in a gap", () => {
    const times = [...even(50, 0.01), ...even(50, 0.01).map((t) => t + 3)];
    const ring = ringOf(times, [times, times.map((t) => -t)]);
    const found = pairs(column(ring), column(ring, 1));
    expect(found.n).toBe(100);
    expect(found.leader).toBeUndefined();
    expect(Array.from(found.y)).toEqual(times.map((t) => -t));
    expect(startsOf(found)).toEqual([0, 50]);
  });

  it("interpolates the slower one at the times of the faster, on either axis", () => {
    const [fast, slow] = [even(1000, 0.01), even(50, 0.2)];
    const a = column(ringOf(fast, [fast.map((t) => 2 * t)]));
    const b = column(ringOf(slow, [slow.map((t) => t * t)]));
    const [over, under] = [pairs(a, b), pairs(b, a)];
    expect([over.leader, under.leader]).toEqual(["x", "y"]);
    expect(over.n).toBe(981); // none after the last slow sample, at 9.8 s
    for (let k = 0; k < over.n; k++) {
      const t = (over.time[k] ?? NaN) - START;
      const at = Math.floor(t / 0.2 + 1e-6) * 0.2;
      expect(over.x[k]).toBeCloseTo(2 * t, 5);
      expect(over.y[k]).toBeCloseTo(at * at + (t - at) * (2 * at + 0.2), 4);
    }
    expect(Array.from(under.x)).toEqual(Array.from(over.y));
  });

  it("takes the nearest sample if asked, half a step beyond the ends", () => {
    const [fast, slow] = [even(21, 0.1), [0, 1, 2]];
    const found = pairs(column(ringOf(fast, [fast])), column(ringOf(slow, [[5, 6, 7]])), "nearest");
    expect(Array.from(found.y).filter((value) => value === 5)).toHaveLength(5);
    expect(found.n).toBe(21);
  });

  it("pairs nothing across a gap of the slower one", () => {
    const fast = even(1000, 0.01);
    const slow = [...even(8, 0.5), ...even(7, 0.5).map((t) => t + 7)];
    const found = pairs(column(ringOf(fast, [fast])), column(ringOf(slow, [slow])));
    const inGap = Array.from(found.time).filter((t) => t > START + 3.505 && t < START + 6.995);
    expect(inGap).toEqual([]);
    expect(startsOf(found)).toEqual([0, 351]);
  });

  it("reads an angle the short way round, and lifts the pen where it goes over its edge", () => {
    const fast = even(5, 0.25);
    const angle = column(ringOf([0, 1], [[170, -170]], 360), 0, 360);
    const found = pairs(column(ringOf(fast, [fast])), angle);
    expect(Array.from(found.y).map((v) => Math.round(v))).toEqual([170, 175, -180, -175, -170]);
    expect(startsOf(found)).toEqual([0, 2]);
  });

  it("leaves out what is missing", () => {
    const times = even(20, 0.1);
    const ring = ringOf(times, [times, times.map((t, k) => (k === 7 ? NaN : t))]);
    const found = pairs(column(ring), column(ring, 1));
    expect(found.n).toBe(19);
    expect(startsOf(found)).toEqual([0, 7]);
  });
});

describe("thinning", () => {
  const next = seeded(3);
  const n = 60_000;
  const times = even(n, 0.001);
  const [x, y] = [times.map(() => next()), times.map(() => next())];
  x[31_234] = 50;
  y[47_001] = -50;

  it("keeps the extremes of both axes, and counts every pair", () => {
    const ring = ringOf(times, [x, y]);
    const found = new PairSeries(column(ring), column(ring, 1), "interpolated", "device").between(START, START + 60);
    expect(found.n).toBe(n);
    expect(found.time.length).toBeLessThan(12_000);
    expect(extent(found.x)).toEqual([Math.min(...x), 50]);
    expect(extent(found.y)).toEqual([-50, Math.max(...y)]);
    const known = new Set(times.map((_, k) => `${x[k]} ${y[k]}`));
    for (let k = 0; k < found.time.length; k++) expect(known.has(`${found.x[k]} ${found.y[k]}`)).toBe(true);
  });

  it("is the same for a window that moves with new samples as for one read at once", () => {
    const slow = even(6000, 0.0101);
    const ring = ringOf(times.slice(0, 1000), [x.slice(0, 1000)]);
    const other = ringOf(slow.slice(0, 90), [slow.slice(0, 90)]);
    const moving = new PairSeries(column(ring), column(other), "interpolated", "device");
    for (let k = 1000; k < n; k += 1000) {
      add(ring, times.slice(k, k + 1000), [x.slice(k, k + 1000)], k);
      const at = Math.floor(k / 10.1);
      const end = Math.floor((k + 1000) / 10.1);
      add(other, slow.slice(at, end), [slow.slice(at, end)], at);
      const to = START + (k + 1000) / 1000;
      const fresh = new PairSeries(column(ring), column(other), "interpolated", "device");
      expect(moving.between(to - 25, to)).toEqual(fresh.between(to - 25, to));
    }
  });
});

it("a cursor reads the pair at or before it", () => {
  const times = even(100, 0.01);
  const ring = ringOf(times, [times, times]);
  const series = new PairSeries(column(ring), column(ring, 1), "interpolated", "device");
  expect(series.at(START + 0.503)?.x).toBeCloseTo(0.5);
  expect(series.at(START + 0.5)?.x).toBeCloseTo(0.5);
  expect(series.at(START + 40)).toBeUndefined();
});

it("the index of a time is that of the last one not after it", () => {
  expect([0.5, 1, 2.5, 9].map((t) => indexAt([1, 2, 3], t))).toEqual([-1, 0, 1, 2]);
});
