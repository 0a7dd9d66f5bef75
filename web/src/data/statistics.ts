/**
 * Mean, standard deviation and extremes of samples, linear or circular.
 *
 * An angle that turns through ±180° has no linear mean: half of the samples are at +175, half at −175, and their average points the
 * opposite way. The circular mean is the angle from which the deviations, each taken the short way round, add up to zero; σ is the
 * standard deviation of those deviations. Within half a turn both equal the linear ones.
 *
 *     anchor   the direction of the resultant of some samples: near the mean, and cheap
 *     pass     deviations from the anchor, the short way round; their mean moves the anchor, until that stays
 *
 * If samples point in all directions equally (an axis that spins) the resultant has no direction: the mean is NaN, and the deviations
 * are counted from the first samples.
 */
import type { ColumnValues } from "./minmax-pyramid";

export interface Stats {
  readonly n: number;
  readonly mean: number;
  readonly sigma: number;
  readonly min: number;
  readonly max: number;
}

export const NO_STATS: Stats = { n: 0, mean: NaN, sigma: NaN, min: NaN, max: NaN };

/** Samples used for the anchor: sine and cosine cost ten times the rest. */
const ANCHOR_SAMPLES = 2000;
/** A shorter resultant, of unit vectors, has no meaningful direction. */
const MIN_RESULTANT = 0.05;
/** Passes over the samples; the second corrects the anchor's error for a skewed distribution. */
const MEAN_PASSES = 3;
/** An anchor that moves by less than this part of the period has converged. */
const SETTLED_SHARE = 1e-6;

/** `angle` in (−period/2, period/2]. */
export function wrapped(angle: number, period: number): number {
  const d = angle - period * Math.round(angle / period);
  return d === -period / 2 ? period / 2 : d;
}

/** Welford's recurrence: no cancellation for a pressure of 101 325 Pa that varies by 3. */
class Moments {
  n = 0;
  mean = 0;
  #m2 = 0;

  add(v: number): void {
    this.n += 1;
    const d = v - this.mean;
    this.mean += d / this.n;
    this.#m2 += d * (v - this.mean);
  }

  /** Standard deviation (n − 1). */
  get sigma(): number {
    return this.n > 1 ? Math.sqrt(this.#m2 / (this.n - 1)) : 0;
  }
}

/**
 * Statistics of rows from ≤ row < to; row i stands in slot i & mask. NaN is left out.
 *
 * @param period the values wrap at this; 0: never
 */
export function statsOf(values: ColumnValues, mask: number, from: number, to: number, period = 0): Stats {
  const line = new Moments();
  let min = Infinity;
  let max = -Infinity;
  for (let row = from; row < to; row++) {
    const v = values[row & mask]!;
    if (v !== v) continue;
    line.add(v);
    if (v < min) min = v;
    if (v > max) max = v;
  }
  if (line.n === 0) return NO_STATS;
  const { n, mean, sigma } = line;
  // What stays within half a turn is the same along the line.
  if (!(period > 0) || max - min <= period / 2) return { n, mean, sigma, min, max };
  const circle = around(values, mask, from, to, period, mean);
  // A heading that is counted from 0 to 360 has its mean there, too.
  return { n, mean: min >= 0 && circle.mean < 0 ? circle.mean + period : circle.mean, sigma: circle.sigma, min, max };
}

function around(
  values: ColumnValues,
  mask: number,
  from: number,
  to: number,
  period: number,
  other: number,
): { readonly mean: number; readonly sigma: number } {
  const [direction, resultant] = directionOf(values, mask, from, to, period);
  const isTold = resultant >= MIN_RESULTANT;
  let anchor = isTold ? direction : other;
  let moments = new Moments();
  for (let pass = 0; pass < MEAN_PASSES; pass++) {
    moments = new Moments();
    for (let row = from; row < to; row++) {
      const v = values[row & mask]!;
      if (v === v) moments.add(wrapped(v - anchor, period));
    }
    if (!isTold || Math.abs(moments.mean) < SETTLED_SHARE * period) break;
    anchor += moments.mean;
  }
  return { mean: isTold ? wrapped(anchor, period) : NaN, sigma: moments.sigma };
}

/** Direction and length of the resultant of evenly spread samples. */
function directionOf(
  values: ColumnValues,
  mask: number,
  from: number,
  to: number,
  period: number,
): readonly [number, number] {
  const step = Math.max(1, Math.floor((to - from) / ANCHOR_SAMPLES));
  const k = (2 * Math.PI) / period;
  let [n, s, c] = [0, 0, 0];
  for (let row = from; row < to; row += step) {
    const v = values[row & mask]!;
    if (v !== v) continue;
    n += 1;
    s += Math.sin(k * v);
    c += Math.cos(k * v);
  }
  return [Math.atan2(s, c) / k, n === 0 ? 0 : Math.hypot(s, c) / n];
}
