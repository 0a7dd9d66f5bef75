/**
 * Rows of a ring at which a line through the samples is broken. Before a row of `breaks`: samples were dropped on the way, the
 * spacing is longer than usual by the rule of recordings/columns/breaks.py, or more than 1.5 × the usual if the device's counter
 * reports a missing one (`losses`), or the device's clock was reset or jumped in between (`cuts`: neighbours on screen then need not
 * be neighbours in time). And at a row of `wraps[column]`, where a wrapping quantity jumps over its edge.
 *
 * The usual spacing is that of the last rows, so it follows a change of the device's rate; when it has changed, these rows are
 * judged again. Without a device clock only arrival times are known; they come in bursts, so the mean is used there.
 */
import type { ColumnValues } from "./minmax-pyramid";

/** One lost sample leaves twice the usual spacing, and jitter leaves no gap. */
export const GAP_STEPS = 1.5;
const GAP_SIGMAS = 6;
/** The usual step is that of this share of the steps: a device that skips every third slot has no gaps. */
const USUAL_SHARE = 0.7;
/** For channels on arrival time only: a USB adapter delivers every 16 ms, a busy host sometimes skips one. */
const BURST_STEPS = 2.5;
const BURST_S = 0.05;
/** Ratio of the mean to the median step from which samples arrive in bursts. */
const BURST_RATIO = 16;
/** Ratio of the longest usual step to the former one from which the device has become slower. */
const SLOWER = 1.2;
/** Number of spacings used for the usual one, and the fewest. */
const USUAL_STEPS = 63;
const MIN_STEPS = 3;
/** Steps counted by one usual spacing, as in recordings/columns/breaks.py. */
const COUNTED_ROWS = 1024;
/** Rows judged by one usual spacing: the rate may change within a long block of history. */
const BLOCK_SAMPLES = 256;

/** Losses kept, as many as the server keeps of a device; the oldest are dropped first. */
const LOSSES_KEPT = 8000;
/** Clock steps kept; the oldest are dropped first. */
const CUTS_KEPT = 1000;

/** Index of the first element ≥ x of an ascending list. */
export function lowerBound(list: ArrayLike<number>, x: number): number {
  let a = 0;
  let b = list.length;
  while (a < b) {
    const m = (a + b) >> 1;
    if (list[m]! < x) a = m + 1;
    else b = m;
  }
  return a;
}

/** The usual one of these steps, and the longest one that is no gap. Sorts them. `inBursts`: of arrival times. */
function judged(steps: Float64Array, inBursts = false): { readonly usual: number; readonly longest: number } {
  steps.sort();
  const n = steps.length;
  const median = steps[n >> 1]!;
  const sum = steps.reduce((whole, step) => whole + step, 0);
  const mean = sum / n;
  if (inBursts || median <= (sum - steps[n - 1]!) / n / BURST_RATIO)
    return { usual: mean, longest: BURST_STEPS * mean + BURST_S };
  const spread = 1.4826 * steps.map((step) => Math.abs(step - median)).sort()[n >> 1]!;
  const usual = steps[Math.floor(USUAL_SHARE * (n - 1))]!;
  return { usual: median, longest: GAP_STEPS * usual + GAP_SIGMAS * spread };
}

/** Number of steps that are gaps, as recordings/columns/breaks.py counts them. */
export function gapsIn(steps: Float64Array): number {
  if (steps.length < MIN_STEPS) return 0;
  const count = Math.min(USUAL_STEPS, steps.length);
  const ends = Array.from({ length: Math.ceil(steps.length / COUNTED_ROWS) }, (_, k) =>
    Math.min((k + 1) * COUNTED_ROWS, steps.length),
  );
  const longest = ends.map((end) => judged(steps.slice(end - count, end)).longest);
  const allowed = longest.map((own, k) => Math.max(own, longest[k - 1] ?? 0, longest[k + 1] ?? 0));
  return steps.reduce((gaps, step, k) => gaps + Number(step > allowed[Math.floor(k / COUNTED_ROWS)]!), 0);
}

/** Access to the rows of a ring. */
export interface Rows {
  readonly first: number;
  readonly end: number;
  readonly mask: number;
  readonly times: Float64Array;
  readonly columns: readonly ColumnValues[];
  readonly clocked: boolean;
}

export class Gaps {
  readonly breaks: number[] = [];
  readonly wraps: readonly (number[] | undefined)[];
  /** Usual spacing, s; NaN while unknown. */
  step = NaN;
  /** Longest spacing that is not a gap, s, if known (as for summarised rows); NaN: derived from the usual spacing. */
  longest = NaN;
  readonly #periods: readonly number[];
  readonly #cuts: number[] = [];
  /** Intervals with missing samples: ascending starts, and the end of those up to each. Facts of time: they stay when rows go. */
  readonly #lostFrom: number[] = [];
  readonly #lostTo: number[] = [];
  #stepAt = 0;
  #usualLongest = NaN;

  /** @param periods where each column wraps; 0: never */
  constructor(periods: readonly number[]) {
    this.#periods = periods;
    this.wraps = periods.map((period) => (period > 0 ? [] : undefined));
  }

  /** Check rows from ≤ row < to, which were written, and the row after them. */
  judge(rows: Rows, from: number, to: number): void {
    const end = Math.min(rows.end, to + 1);
    let before = from >= this.#stepAt ? this.#usualLongest : NaN;
    for (let a = from; a < end; a += BLOCK_SAMPLES)
      before = this.#stretch(rows, a, Math.min(a + BLOCK_SAMPLES, end), before);
  }

  /** Break the line before `row`. */
  insert(row: number): void {
    const at = lowerBound(this.breaks, row);
    if (this.breaks[at] !== row) this.breaks.splice(at, 0, row);
  }

  /** Break the line at the moment `time`, whichever rows surround it. `row`: the first at or after it. */
  cut(time: number, row: number, { first, end }: Rows): void {
    const at = lowerBound(this.#cuts, time);
    if (this.#cuts[at] === time) return;
    this.#cuts.splice(at, 0, time);
    if (this.#cuts.length > CUTS_KEPT) this.#cuts.shift();
    if (row > first && row < end) this.insert(row);
  }

  /** Record missing samples between t0 and t1. Rows from ≤ row < to may surround the hole; returns whether some do. */
  lose(t0: number, t1: number, from: number, to: number, rows: Rows): boolean {
    const before = this.breaks.length;
    this.#keepLoss(t0, t1);
    for (let row = Math.max(from, rows.first + 1); row < Math.min(to, rows.end); row++) {
      if (this.#isLost(rows.times[(row - 1) & rows.mask]!, rows.times[row & rows.mask]!, this.step, rows))
        this.insert(row);
    }
    return this.breaks.length > before;
  }

  /** Renumber rows by −`by`. */
  shift(by: number): void {
    this.#stepAt -= by;
    for (const list of [this.breaks, ...this.wraps]) list?.forEach((row, k) => (list[k] = row - by));
  }

  clear(): void {
    for (const list of [this.breaks, ...this.wraps]) if (list !== undefined) list.length = 0;
    this.#cuts.length = 0;
    this.step = this.#usualLongest = NaN;
    this.#stepAt = 0;
  }

  /** Judge a block after one with steps of up to `before`, s (NaN: unknown), and return the longest usual step of this one. */
  #stretch(rows: Rows, from: number, to: number, before: number): number {
    const { times, mask } = rows;
    const { usual: step, longest: own } = this.#usual(rows, to);
    const isSlower = own > SLOWER * before; // the first rows at the new rate were judged by the former one
    const usual = before > own ? before : own;
    const longest = this.longest === this.longest ? this.longest : usual;
    mark(this.breaks, rows, isSlower ? Math.max(rows.first, from - USUAL_STEPS) : from, to, (row) => {
      const [before, time] = [times[(row - 1) & mask]!, times[row & mask]!];
      return time - before > longest || this.#isCut(before, time) || this.#isLost(before, time, step, rows);
    });
    this.wraps.forEach((wraps, c) => {
      if (wraps === undefined) return;
      const values = rows.columns[c]!;
      const half = this.#periods[c]! / 2;
      mark(wraps, rows, from, to, (row) => Math.abs(values[row & mask]! - values[(row - 1) & mask]!) > half);
    });
    return own;
  }

  /** Whether there is a cut after `before`, up to `time`. */
  #isCut(before: number, time: number): boolean {
    const { length } = this.#cuts;
    if (length === 0 || this.#cuts[length - 1]! <= before) return false; // nearly always
    return this.#cuts.some((cut) => cut > before && cut <= time);
  }

  /** Whether this spacing is that of a sample known to be missing; undecidable for rows that bound intervals. */
  #isLost(before: number, time: number, step: number, { clocked }: Rows): boolean {
    if (!clocked || this.longest === this.longest || !(time - before > GAP_STEPS * step)) return false;
    const at = lowerBound(this.#lostFrom, time) - 1;
    return at >= 0 && this.#lostTo[at]! > before;
  }

  #keepLoss(t0: number, t1: number): void {
    const at = lowerBound(this.#lostFrom, t0);
    this.#lostFrom.splice(at, 0, t0);
    this.#lostTo.splice(at, 0, Math.max(t1, this.#lostTo[at - 1] ?? -Infinity));
    for (let k = at + 1; k < this.#lostTo.length && this.#lostTo[k]! < t1; k++) this.#lostTo[k] = t1;
    if (this.#lostFrom.length <= LOSSES_KEPT) return;
    this.#lostFrom.shift();
    this.#lostTo.shift();
  }

  /** Usual spacing of the rows before `to`. */
  #usual({ first, mask, times, clocked }: Rows, to: number): { readonly usual: number; readonly longest: number } {
    const last = { usual: this.step, longest: this.#usualLongest };
    if (to >= this.#stepAt && to - this.#stepAt < USUAL_STEPS / 2 && this.step === this.step) return last;
    const a = Math.max(first, to - 1 - USUAL_STEPS);
    const n = to - 1 - a;
    if (n < MIN_STEPS) return last;
    const steps = new Float64Array(n);
    for (let k = 0; k < n; k++) steps[k] = times[(a + k + 1) & mask]! - times[(a + k) & mask]!;
    const own = judged(steps, !clocked);
    // a block of history is judged by its own spacing; the newest rows define the usual one now
    if (to >= this.#stepAt || this.step !== this.step)
      [this.step, this.#usualLongest, this.#stepAt] = [own.usual, own.longest, to];
    return own;
  }
}

/** Update a sorted list for rows from ≤ row < to by `test`, and drop rows no longer held. */
function mark(list: number[], { first }: Rows, from: number, to: number, test: (row: number) => boolean): void {
  const found: number[] = [];
  for (let row = Math.max(from, first + 1); row < to; row++) if (test(row)) found.push(row);
  const a = lowerBound(list, from);
  if (a < list.length) list.splice(a, lowerBound(list, to) - a, ...found);
  else for (const row of found) list.push(row);
  if (list.length > 0 && list[0]! <= first) list.splice(0, lowerBound(list, first + 1));
}
