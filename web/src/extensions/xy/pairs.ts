/**
 * Pairs of two signals at the same moments, for a plot of one over the other, from rings.
 *
 *     leader      |  |  |  |  |  |  |  |  |     the signal with more samples: its times are those of the pairs
 *     follower    |        |        |     ·     linear between its samples, or the nearest one; none across a gap
 *
 * With more pairs than a screen can show, rows are taken in blocks: of each the first, the last and those with the least and the
 * greatest x and y, so that no extreme is lost. A finished block is computed once, so a window that moves costs its new samples.
 * server/extensions/analysis/signals/pairs.py does the same with what a page does not hold.
 */
import { lowerBound } from "../../data/line-breaks";
import { wrapped } from "../../data/statistics";
import type { Ring } from "../../data/ring-buffer";
import type { TimeBase } from "../../data/view";

/** How the follower is read where it has no sample of that time. */
export type Pairing = "interpolated" | "nearest";

/** One signal: a column of a ring. */
export interface PairedColumn {
  readonly ring: Ring;
  readonly column: number;
  /** An angle wraps at this value; 0: never. */
  readonly period: number;
}

export interface Pairs {
  readonly time: ArrayLike<number>;
  readonly x: ArrayLike<number>;
  readonly y: ArrayLike<number>;
  /** 1 where no line may come from the pair before. */
  readonly starts: ArrayLike<number>;
  /** Number of pairs, also of those left out. */
  readonly n: number;
  /** The signal whose times these are; undefined: both have the same. */
  readonly leader: "x" | "y" | undefined;
}

export const NO_PAIRS: Pairs = { time: [], x: [], y: [], starts: [], n: 0, leader: undefined };

/** Up to this many rows are all kept, and about this many blocks are made of more. */
const [ALL, BLOCKS] = [8000, 1500];

/** Kept pairs, in the order of time. */
interface Kept {
  readonly time: number[];
  readonly x: number[];
  readonly y: number[];
  readonly starts: number[];
  n: number;
}

const none = (): Kept => ({ time: [], x: [], y: [], starts: [], n: 0 });

function keep(to: Kept, time: number, x: number, y: number, starts: number): void {
  to.time.push(time);
  to.x.push(x);
  to.y.push(y);
  to.starts.push(starts);
}

/** Reads the follower at ascending times. */
class Follower {
  readonly #of: PairedColumn;
  readonly #base: TimeBase;
  readonly #how: Pairing;
  /** The first row after the time read last. */
  #after = -1;
  #isBroken = false;

  constructor(of: PairedColumn, base: TimeBase, how: Pairing) {
    this.#of = of;
    this.#base = base;
    this.#how = how;
  }

  /** The value at `t`; NaN across a gap and beyond the ends. */
  at(t: number): number {
    const { ring, column, period } = this.#of;
    const times = this.#base === "device" ? ring.times : ring.arrivals;
    const values = ring.columns[column];
    if (values === undefined || ring.length === 0) return NaN;
    const { mask } = ring;
    const was = this.#after;
    if (was < ring.first || times[(was - 1) & mask]! > t) this.#after = ring.row(t, this.#base, true);
    while (this.#after < ring.end && times[this.#after & mask]! <= t) this.#after++;
    const after = this.#after;
    if (after !== was) this.#isBroken = ring.breaks[lowerBound(ring.breaks, after)] === after;
    const before = after - 1;
    if (before < ring.first || after >= ring.end) {
      const end = after >= ring.end ? before : after;
      const away = Math.abs(times[end & mask]! - t);
      return away === 0 || (this.#how === "nearest" && away <= ring.step / 2) ? values[end & mask]! : NaN;
    }
    const [t0, t1] = [times[before & mask]!, times[after & mask]!];
    const [a, b] = [values[before & mask]!, values[after & mask]!];
    if (t === t0) return a;
    if (this.#isBroken) return NaN;
    const share = (t - t0) / (t1 - t0);
    if (this.#how === "nearest") return share < 0.5 ? a : b;
    if (!(period > 0)) return a + share * (b - a);
    const value = a + share * wrapped(b - a, period);
    const low = a >= 0 && b >= 0 && (a > period / 2 || b > period / 2) ? 0 : -period / 2;
    return value - period * Math.floor((value - low) / period);
  }

  /** True once the follower has been sampled after `t`: its value there will not change. */
  isSettled(t: number): boolean {
    const { ring } = this.#of;
    return ring.length > 0 && (this.#base === "device" ? ring.time : ring.arrival).call(ring, ring.length - 1) >= t;
  }
}

/** Pairs of two columns over ranges that move. */
export class PairSeries {
  readonly #x: PairedColumn;
  readonly #y: PairedColumn;
  readonly #how: Pairing;
  readonly #base: TimeBase;
  readonly #blocks = new Map<number, Kept>();
  #stamp = "";

  constructor(x: PairedColumn, y: PairedColumn, how: Pairing, base: TimeBase) {
    this.#x = x;
    this.#y = y;
    this.#how = how;
    this.#base = base;
  }

  /** Whether these are its rings. */
  isOf(x: Ring, y: Ring): boolean {
    return this.#x.ring === x && this.#y.ring === y;
  }

  between(t0: number, t1: number): Pairs {
    const rows = ({ ring }: PairedColumn): number => ring.row(t1, this.#base, true) - ring.row(t0, this.#base);
    const isOne = this.#x.ring === this.#y.ring;
    const leadsX = isOne || rows(this.#x) >= rows(this.#y);
    const { ring } = leadsX ? this.#x : this.#y;
    const [from, to] = [ring.row(t0, this.#base), ring.row(t1, this.#base, true)];
    const found = none();
    if (to - from <= ALL) this.#all(found, leadsX, from, to);
    else this.#thinned(found, leadsX, from, to);
    return { ...found, leader: isOne ? undefined : leadsX ? "x" : "y" };
  }

  /** The pair that a cursor at `t` reads; undefined without one. */
  at(t: number): { readonly x: number; readonly y: number } | undefined {
    const { step: own } = this.#x.ring;
    const { step: other } = this.#y.ring;
    const least = Math.min(own || 0, other || 0) || Math.max(own || 0, other || 0) || 0;
    const { time, x, y } = this.between(t - 2.5 * least, t + 5e-7); // half a microsecond: a cursor on a sample finds it
    const last = time.length - 1;
    return last < 0 ? undefined : { x: x[last] ?? NaN, y: y[last] ?? NaN };
  }

  #all(found: Kept, leadsX: boolean, from: number, to: number): void {
    this.#walk(leadsX, from, to, (time, x, y, starts) => {
      keep(found, time, x, y, starts);
      found.n += 1;
    });
  }

  #thinned(found: Kept, leadsX: boolean, from: number, to: number): void {
    const { ring } = leadsX ? this.#x : this.#y;
    const follower = this.#follower(leadsX);
    const shift = Math.ceil(Math.log2((to - from) / BLOCKS));
    const stamp = `${leadsX} ${shift} ${this.#x.ring.generation} ${this.#y.ring.generation}`;
    if (stamp !== this.#stamp) this.#blocks.clear();
    this.#stamp = stamp;
    const times = this.#base === "device" ? ring.times : ring.arrivals;
    for (let block = from >> shift; block << shift < to; block++) {
      const [begin, end] = [block << shift, (block + 1) << shift];
      const isWhole = begin >= from && end <= to;
      let kept = isWhole ? this.#blocks.get(block) : undefined;
      if (kept === undefined) {
        kept = this.#block(leadsX, Math.max(from, begin), Math.min(to, end));
        const isFinal = isWhole && (follower === undefined || follower.isSettled(times[(end - 1) & ring.mask]!));
        if (isFinal) this.#blocks.set(block, kept);
      }
      for (let k = 0; k < kept.time.length; k++) keep(found, kept.time[k]!, kept.x[k]!, kept.y[k]!, kept.starts[k]!);
      found.n += kept.n;
    }
    if (this.#blocks.size > 4 * BLOCKS)
      for (const block of this.#blocks.keys()) if ((block + 1) << shift < from) this.#blocks.delete(block);
  }

  /** First, last and extremes of the pairs of some rows. */
  #block(leadsX: boolean, from: number, to: number): Kept {
    const whole = none();
    this.#all(whole, leadsX, from, to);
    const { time, x, y, starts } = whole;
    const last = time.length - 1;
    if (last < 6) return whole;
    const at = [0, last, 0, 0, 0, 0];
    for (let k = 1; k <= last; k++) {
      if (x[k]! < x[at[2]!]!) at[2] = k;
      if (x[k]! > x[at[3]!]!) at[3] = k;
      if (y[k]! < y[at[4]!]!) at[4] = k;
      if (y[k]! > y[at[5]!]!) at[5] = k;
    }
    const kept = none();
    let next = 0;
    for (const k of [...new Set(at)].sort((a, b) => a - b)) {
      let begins = 0; // also where the start itself is left out
      for (; next <= k; next++) begins |= starts[next]!;
      keep(kept, time[k]!, x[k]!, y[k]!, begins);
    }
    kept.n = last + 1;
    return kept;
  }

  #follower(leadsX: boolean): Follower | undefined {
    if (this.#x.ring === this.#y.ring) return undefined;
    return new Follower(leadsX ? this.#y : this.#x, this.#base, this.#how);
  }

  #walk(
    leadsX: boolean,
    from: number,
    to: number,
    visit: (time: number, x: number, y: number, starts: number) => void,
  ): void {
    const [leader, other] = leadsX ? [this.#x, this.#y] : [this.#y, this.#x];
    const { ring } = leader;
    const follower = this.#follower(leadsX);
    const times = this.#base === "device" ? ring.times : ring.arrivals;
    const [own, beside] = [ring.columns[leader.column], ring.columns[other.column]];
    const { mask, breaks } = ring;
    const first = Math.max(ring.first, from - 1); // whether the line goes on is decided by the row before
    let nextBreak = lowerBound(breaks, first + 1);
    let [lastOwn, lastOther] = [NaN, NaN];
    for (let row = first; row < to; row++) {
      const time = times[row & mask]!;
      const value = own?.[row & mask] ?? NaN;
      const paired = follower === undefined ? (beside?.[row & mask] ?? NaN) : follower.at(time);
      let starts = lastOwn !== lastOwn || lastOther !== lastOther;
      if (breaks[nextBreak] === row) {
        starts = true;
        nextBreak++;
      }
      const isThere = value === value && paired === paired;
      if (isThere && !starts) starts = jumped(leader, value - lastOwn) || jumped(other, paired - lastOther);
      [lastOwn, lastOther] = isThere ? [value, paired] : [NaN, NaN];
      if (isThere && row >= from) visit(time, leadsX ? value : paired, leadsX ? paired : value, starts ? 1 : 0);
    }
  }
}

const jumped = ({ period }: PairedColumn, change: number): boolean => period > 0 && Math.abs(change) > period / 2;

/** Least and greatest. */
export function extent(values: ArrayLike<number>): [lo: number, hi: number] {
  let [lo, hi] = [Infinity, -Infinity];
  for (let k = 0; k < values.length; k++) {
    const value = values[k]!;
    if (value < lo) lo = value;
    if (value > hi) hi = value;
  }
  return [lo, hi];
}

/** The last index whose time is not after `t`, to half a microsecond; −1 before the first. */
export function indexAt(times: ArrayLike<number>, t: number): number {
  let [a, b] = [0, times.length];
  while (a < b) {
    const middle = (a + b) >> 1;
    if (times[middle]! <= t + 5e-7) a = middle + 1;
    else b = middle;
  }
  return a - 1;
}
