/**
 * Smallest and largest value of every pixel column on screen, for some columns of one ring, computed once per pixel.
 *
 * A frame requests pixels g0 ≤ g < g1. Those of the last frame are kept; only new ones are read from the ring's pyramid, and the
 * one at the newest sample again, because it was incomplete. Zooming, another time base or rows moved in the ring invalidate all:
 * then it is one pyramid query a pixel, for any number of samples.
 */
import type { Extent } from "../data/minmax-pyramid";
import type { Ring } from "../data/ring-buffer";
import type { TimeBase } from "../data/view";

export class PixelColumns {
  /** Slot of pixel g is g & mask, in `rows` and in each of `lo` and `hi`. */
  mask = 0;
  /** First row of the pixel; that of pixel g + 1 is its end. */
  rows = new Int32Array(0);
  /** Extremes per requested column; lo > hi without a value. OR and AND for status words. */
  lo: Float64Array[] = [];
  hi: Float64Array[] = [];
  #from = 0;
  #to = 0;
  #dt = NaN;
  #base: TimeBase = "device";
  #generation = -1;
  #end = -1;
  readonly #extent: Extent = { lo: 0, hi: 0 };

  /** @param columns which of the ring's columns, in the order of `lo` and `hi` */
  constructor(
    readonly ring: Ring,
    readonly columns: readonly number[],
  ) {}

  /** Prepare pixels g0 ≤ g < g1 of `dt` seconds. */
  prepare(g0: number, g1: number, dt: number, base: TimeBase): void {
    const { ring } = this;
    if (g1 - g0 + 2 > this.mask) this.#allocate(g1 - g0 + 2);
    const same =
      dt === this.#dt &&
      base === this.#base &&
      ring.generation === this.#generation &&
      g0 <= this.#to &&
      g1 >= this.#from;
    if (!same) [this.#from, this.#to] = [g0, g0];
    else if (ring.end !== this.#end) this.#to = Math.min(this.#to, this.#stale(dt, base));
    [this.#dt, this.#base, this.#generation] = [dt, base, ring.generation];
    if (g0 < this.#from) this.#fill(g0, Math.min(g1, this.#from), dt, base);
    if (g1 > this.#to) this.#fill(Math.max(g0, this.#to), g1, dt, base);
    [this.#from, this.#to, this.#end] = [g0, g1, ring.end];
  }

  /** First pixel that may have changed since `#end`. */
  #stale(dt: number, base: TimeBase): number {
    const { ring } = this;
    const row = this.#end - 1;
    if (row < ring.first) return -Infinity;
    const t = (base === "device" ? ring.times : ring.arrivals)[row & ring.mask]!;
    return Math.floor(t / dt);
  }

  #fill(from: number, to: number, dt: number, base: TimeBase): void {
    const { ring, rows, mask } = this;
    let row = ring.row(from * dt, base);
    rows[from & mask] = row;
    for (let g = from; g < to; g++) {
      const next = this.#next(row, (g + 1) * dt, base);
      rows[(g + 1) & mask] = next;
      for (let k = 0; k < this.columns.length; k++) {
        ring.pyramids[this.columns[k]!]!.query(row, next, this.#extent);
        this.lo[k]![g & mask] = this.#extent.lo;
        this.hi[k]![g & mask] = this.#extent.hi;
      }
      row = next;
    }
  }

  /** First row ≥ `row` with time ≥ t, by galloping search, because it is near. */
  #next(row: number, t: number, base: TimeBase): number {
    const { ring } = this;
    const { mask, end } = ring;
    const times = base === "device" ? ring.times : ring.arrivals;
    let step = 1;
    let low = row;
    while (low + step < end && times[(low + step - 1) & mask]! < t) {
      low += step;
      step *= 2;
    }
    let high = Math.min(end, low + step);
    while (low < high) {
      const m = low + ((high - low) >> 1);
      if (times[m & mask]! < t) low = m + 1;
      else high = m;
    }
    return low;
  }

  #allocate(least: number): void {
    const size = 2 ** Math.ceil(Math.log2(least));
    this.mask = size - 1;
    this.rows = new Int32Array(size);
    this.lo = this.columns.map(() => new Float64Array(size));
    this.hi = this.columns.map(() => new Float64Array(size));
    this.#dt = NaN;
  }
}
