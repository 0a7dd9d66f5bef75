/**
 * Figures of a column between two moments, from a ring that holds all of its samples there. The definitions are those of
 * server/extensions/analysis/methods/statistics.py, so that both give the same numbers: samples with t0 ≤ t ≤ t1; an angle that wraps has a
 * circular mean and σ, is unwrapped for slope and peak to peak, and has no integral.
 */
import { gapsIn } from "../../data/line-breaks";
import type { Ring } from "../../data/ring-buffer";
import { statsOf } from "../../data/statistics";
import type { TimeBase } from "../../data/view";

export interface RangeFigures {
  readonly n: number;
  readonly mean: number;
  readonly sigma: number;
  readonly rms: number;
  readonly min: number;
  readonly max: number;
  readonly peakToPeak: number;
  /** Of the least-squares line, per second. */
  readonly slope: number;
  /** By the trapezoidal rule. */
  readonly integral: number;
  /** Places where samples are missing. */
  readonly gaps: number;
}

export const NO_FIGURES: RangeFigures = {
  n: 0,
  mean: NaN,
  sigma: NaN,
  rms: NaN,
  min: NaN,
  max: NaN,
  peakToPeak: NaN,
  slope: NaN,
  integral: NaN,
  gaps: 0,
};

export function rangeFigures(
  ring: Ring,
  column: number,
  t0: number,
  t1: number,
  base: TimeBase,
  period: number,
): RangeFigures {
  const values = ring.columns[column];
  if (values === undefined) return NO_FIGURES;
  const { mask } = ring;
  const [from, to] = [ring.row(t0, base), ring.row(t1, base, true)];
  const stats = statsOf(values, mask, from, to, period);
  if (stats.n === 0) return NO_FIGURES;
  const times = base === "device" ? ring.times : ring.arrivals;
  const steps = new Float64Array(stats.n - 1);
  let n = 0;
  let square = 0;
  let integral = 0;
  let meanT = 0;
  let meanV = 0;
  let tt = 0;
  let tv = 0;
  let low = Infinity;
  let high = -Infinity;
  let lastT = NaN;
  let lastV = NaN;
  let turned = 0; // whole turns that unwrap an angle
  for (let row = from; row < to; row++) {
    const raw = values[row & mask]!;
    if (raw !== raw) continue;
    const given = times[row & mask]! - t0; // small numbers: nothing is lost in the products below
    const t = given < lastT ? lastT : given;
    if (period > 0 && n > 0) turned += period * Math.round((lastV - (raw + turned)) / period);
    const v = raw + turned;
    if (n > 0) {
      steps[n - 1] = t - lastT;
      integral += ((v + lastV) / 2) * (t - lastT);
    }
    n += 1;
    const dt = t - meanT;
    meanT += dt / n;
    meanV += (v - meanV) / n;
    tt += dt * (t - meanT);
    tv += dt * (v - meanV);
    square += raw * raw;
    if (v < low) low = v;
    if (v > high) high = v;
    lastT = t;
    lastV = v;
  }
  return {
    ...stats,
    ...(period > 0 ? arcOf(low, high, period) : { rms: Math.sqrt(square / n) }),
    peakToPeak: high - low,
    slope: tt > 0 ? tv / tt : NaN,
    integral: period > 0 ? NaN : integral,
    gaps: gapsIn(steps),
  };
}

/** An angle has no rms; its extremes are the ends of the arc that it covers, and none if it goes all the way round. */
function arcOf(low: number, high: number, period: number): Pick<RangeFigures, "rms" | "min" | "max"> {
  const wrapped = (v: number): number => (high - low < period ? v - period * Math.round(v / period) : NaN);
  return { rms: NaN, min: wrapped(low), max: wrapped(high) };
}
