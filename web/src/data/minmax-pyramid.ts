/**
 * Min/max pyramid: draws any window of a long series in time proportional to its pixels, not its samples.
 *
 * It stores the smallest and largest value of every 16 samples, of every 64, 256 … The extremes of any range are then those of a
 * few whole blocks in its middle and of fewer than 16 samples at either end: O(log n) for any range.
 *
 *     samples   ················|················|················|················|········
 *     level 0   [     16       ] [     16       ] [     16       ] [     16       ]
 *     level 1   [                            64                                    ]
 *
 * The pyramid covers a ring: sample `i`, counted from the beginning of time, is in slot `i mod capacity`, and block `b` of a
 * level in slot `b mod (capacity / size)`. Blocks across the oldest or newest sample are invalid; a query only reads blocks
 * entirely inside an existing range, and those were computed after their last sample.
 *
 * Numbers keep minimum and maximum, without NaN (all NaN gives lo > hi). Status words keep the OR and the AND of their bits:
 * OR gives the flags ever set, ~AND those ever cleared, so that a 5 ms fault is still a mark in an overview of hours ("worst
 * status").
 */
import type { Column } from "../wire/codec";

export type ColumnValues = Exclude<Column, BigInt64Array | BigUint64Array>;

/** Samples in the lowest block, and blocks in a block of the next level; both powers of two. */
const BLOCK_SHIFT = 4;
const FAN_SHIFT = 2;
const BLOCK = 1 << BLOCK_SHIFT;
const FAN = 1 << FAN_SHIFT;

interface Level<A> {
  readonly a: A;
  readonly b: A;
  /** Block of sample i is `i >> shift`. */
  readonly shift: number;
  /** Slots minus one. */
  readonly mask: number;
}

function levels<A>(capacity: number, make: (n: number) => A): Level<A>[] {
  const out: Level<A>[] = [];
  for (let shift = BLOCK_SHIFT; capacity >> shift >= 1; shift += FAN_SHIFT) {
    const n = capacity >> shift;
    out.push({ a: make(n), b: make(n), shift, mask: n - 1 });
  }
  return out;
}

/** Extent of a range of samples: `lo > hi` if it has no value. Reused by every query; read it at once. */
export interface Extent {
  lo: number;
  hi: number;
}

/** The level with the longest block that begins at sample `i` and ends by `to`; the lowest level always fits. */
function widest<A>(all: readonly Level<A>[], i: number, to: number): Level<A> {
  let l = 0;
  while (l + 1 < all.length && (i & ((1 << all[l + 1]!.shift) - 1)) === 0 && i + (1 << all[l + 1]!.shift) <= to) l++;
  return all[l]!;
}

/** Minimum and maximum of any range of a ring of numbers. */
export class MinMax {
  readonly #values: ColumnValues;
  readonly #mask: number;
  readonly #levels: readonly Level<Float32Array | Float64Array>[];

  /** @param values the ring's slots; their number must be a power of two, at least 16 */
  constructor(values: ColumnValues) {
    this.#values = values;
    this.#mask = values.length - 1;
    const small = values instanceof Float32Array || values.BYTES_PER_ELEMENT < 4;
    this.#levels = levels(values.length, (n) => (small ? new Float32Array(n) : new Float64Array(n)));
  }

  /** Samples `from` ≤ i < `to` were written. */
  update(from: number, to: number): void {
    const values = this.#values;
    const mask = this.#mask;
    for (let l = 0; l < this.#levels.length; l++) {
      const { a, b, shift, mask: slots } = this.#levels[l]!;
      const below = this.#levels[l - 1];
      const last = (to - 1) >> shift;
      for (let block = from >> shift; block <= last; block++) {
        let lo = Infinity;
        let hi = -Infinity;
        if (below === undefined) {
          let slot = (block << shift) & mask;
          for (let k = 0; k < BLOCK; k++, slot++) {
            const v = values[slot]!;
            if (v < lo) lo = v;
            if (v > hi) hi = v;
          }
        } else {
          let slot = (block << FAN_SHIFT) & below.mask;
          for (let k = 0; k < FAN; k++, slot++) {
            if (below.a[slot]! < lo) lo = below.a[slot]!;
            if (below.b[slot]! > hi) hi = below.b[slot]!;
          }
        }
        a[block & slots] = lo;
        b[block & slots] = hi;
      }
    }
  }

  /** Extent of samples `from` ≤ i < `to`, all of which must be in the ring. */
  query(from: number, to: number, out: Extent): void {
    const values = this.#values;
    const mask = this.#mask;
    const all = this.#levels;
    let lo = Infinity;
    let hi = -Infinity;
    let i = from;
    while (i < to) {
      if ((i & (BLOCK - 1)) === 0 && i + BLOCK <= to) {
        const level = widest(all, i, to);
        const slot = (i >> level.shift) & level.mask;
        if (level.a[slot]! < lo) lo = level.a[slot]!;
        if (level.b[slot]! > hi) hi = level.b[slot]!;
        i += 1 << level.shift;
      } else {
        const v = values[i & mask]!;
        if (v < lo) lo = v;
        if (v > hi) hi = v;
        i++;
      }
    }
    out.lo = lo;
    out.hi = hi;
  }
}

/** Bits of a status word that were ever set, and those always set, in any range of a ring. */
export class OrAnd {
  /** OR and AND of everything ever written: decides which lanes are shown. */
  everSet = 0;
  alwaysSet = -1;
  readonly #values: ColumnValues;
  readonly #mask: number;
  readonly #levels: readonly Level<Int32Array>[];

  constructor(values: ColumnValues) {
    this.#values = values;
    this.#mask = values.length - 1;
    this.#levels = levels(values.length, (n) => new Int32Array(n));
  }

  /** Samples `from` ≤ i < `to` were written. */
  update(from: number, to: number): void {
    const values = this.#values;
    const mask = this.#mask;
    for (let i = from; i < to; i++) {
      const word = values[i & mask]! | 0;
      this.everSet |= word;
      this.alwaysSet &= word;
    }
    for (let l = 0; l < this.#levels.length; l++) {
      const { a, b, shift, mask: slots } = this.#levels[l]!;
      const below = this.#levels[l - 1];
      const last = (to - 1) >> shift;
      for (let block = from >> shift; block <= last; block++) {
        let or = 0;
        let and = -1;
        if (below === undefined) {
          let slot = (block << shift) & mask;
          for (let k = 0; k < BLOCK; k++, slot++) {
            or |= values[slot]!;
            and &= values[slot]!;
          }
        } else {
          let slot = (block << FAN_SHIFT) & below.mask;
          for (let k = 0; k < FAN; k++, slot++) {
            or |= below.a[slot]!;
            and &= below.b[slot]!;
          }
        }
        a[block & slots] = or;
        b[block & slots] = and;
      }
    }
  }

  /** OR (`lo`) and AND (`hi`) of samples `from` ≤ i < `to`; an empty range gives 0 and −1. */
  query(from: number, to: number, out: Extent): void {
    const all = this.#levels;
    let or = 0;
    let and = -1;
    let i = from;
    while (i < to) {
      if ((i & (BLOCK - 1)) === 0 && i + BLOCK <= to) {
        const level = widest(all, i, to);
        const slot = (i >> level.shift) & level.mask;
        or |= level.a[slot]!;
        and &= level.b[slot]!;
        i += 1 << level.shift;
      } else {
        or |= this.#values[i & this.#mask]!;
        and &= this.#values[i & this.#mask]!;
        i++;
      }
    }
    out.lo = or;
    out.hi = and;
  }
}
