/** Values of curves: at a time, and between two. Pure. */
import { lowerBound } from "../../../data/line-breaks";
import { number } from "../../../ui/format/format";
import { TEXT } from "./texts";
import type { EmbeddedCurve } from "./content";

/** Row nearest to a time; undefined without rows. */
export function nearestRow({ times }: EmbeddedCurve, t: number): number | undefined {
  if (times.length === 0) return undefined;
  const after = lowerBound(times, t);
  if (after === 0) return 0;
  if (after === times.length) return after - 1;
  return (times[after] ?? 0) - t < t - (times[after - 1] ?? 0) ? after : after - 1;
}

/** Time of the sample `by` samples from the nearest one. */
export function stepped(curve: EmbeddedCurve, t: number, by: number): number {
  const row = nearestRow(curve, t) ?? 0;
  return curve.times[Math.min(Math.max(row + by, 0), curve.times.length - 1)] ?? t;
}

interface Reading {
  readonly low: number;
  readonly high: number;
}

/** Rounding of a time: a cursor this near before a sample is on it. */
const EPS_S = 1e-6;

/** The last sample up to a time, as on the page, or the interval that it lies in; undefined without samples. */
export function valuesAt(curve: EmbeddedCurve, t: number): Reading | undefined {
  const row = Math.max(0, lowerBound(curve.times, t + EPS_S) - 1);
  const [low, high] = [curve.low[row], curve.high[row]];
  return low === undefined || high === undefined ? undefined : { low, high };
}

export interface Measured {
  readonly min: number;
  readonly max: number;
  /** NaN where only extremes are in the file. */
  readonly mean: number;
  readonly n: number;
}

const wrapped = (v: number, period: number): number => v - period * Math.round(v / period);

/** Value at B less value at A, of an angle the short way round; undefined where only extremes are known. */
export function difference(curve: EmbeddedCurve, a: number, b: number): number | undefined {
  const [from, to] = [valuesAt(curve, a), valuesAt(curve, b)];
  if (!curve.isExact || from === undefined || to === undefined) return undefined;
  return curve.period > 0 ? wrapped(to.low - from.low, curve.period) : to.low - from.low;
}

/** Figures of the samples with a ≤ t ≤ b. */
export function measured(curve: EmbeddedCurve, a: number, b: number): Measured {
  const { times, low, high, isExact, period } = curve;
  const [from, to] = [lowerBound(times, Math.min(a, b) - EPS_S), lowerBound(times, Math.max(a, b) + EPS_S)];
  let [min, max, sum, x, y] = [Infinity, -Infinity, 0, 0, 0];
  for (let row = from; row < to; row++) {
    const [l, h] = [low[row] ?? NaN, high[row] ?? NaN];
    if (l < min) min = l;
    if (h > max) max = h;
    sum += l;
    if (period > 0) {
      x += Math.cos((l * 2 * Math.PI) / period);
      y += Math.sin((l * 2 * Math.PI) / period);
    }
  }
  const n = to - from;
  if (n <= 0) return { min: NaN, max: NaN, mean: NaN, n: 0 };
  const circular = period > 0 && max - min > period / 2;
  const mean = circular ? (Math.atan2(y, x) * period) / (2 * Math.PI) : sum / n;
  return { min, max, mean: isExact ? mean : NaN, n };
}

export function readingText(curve: EmbeddedCurve, reading: Reading | undefined): string {
  if (reading === undefined || curve.isExact || reading.low === reading.high)
    return number(reading?.low, curve.decimals);
  return TEXT.extremes(number(reading.low, curve.decimals), number(reading.high, curve.decimals));
}
