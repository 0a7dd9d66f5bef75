/**
 * Storage of samples: one ring per channel, with a typed array per column, written in place, no object per sample, doubling until
 * its budget is reached and then overwriting the oldest.
 *
 *     row i (counted since the channel exists) is in slot i & mask
 *
 *        first                                end
 *          ▼                                   ▼
 *     ─────┼───────────── rows held ───────────┼────▶      history is prepended at `first`, live samples appended at `end`
 *
 * Two clocks. `times` is drawn in the "device" base: device time mapped to host time, or the arrival time for a channel
 * without device clock. Rows are kept sorted by it: a sample with an older device time than its neighbours (the GNSS
 * fix inside an Xsens stream is 0.2 s old when it is sent) is moved to its place, and counted in `late`. One that would
 * have to move further than LATE_ROWS stays in arrival order, with its neighbour's time, and is counted in `retimed`.
 * `arrivals` is the other base; it has the same order, so it may step back by a late sample's delay.
 *
 * line-breaks.ts decides where a line through the samples is broken.
 */
import type { Column, SampleFrame } from "../wire/codec";
import { DTYPE_SIZE } from "../wire/frame";
import type { Dtype } from "../wire/types";
import { MinMax, OrAnd, type Extent, type ColumnValues } from "./minmax-pyramid";
import { type FrameChange, inFrame } from "./frames";
import { Gaps } from "./line-breaks";
import { NO_STATS, type Stats, statsOf } from "./statistics";
import type { TimeBase } from "./view";

/** How far back, in rows, a late sample is moved. 4096 rows are 2 s at 2 kHz: ten times the age of a GNSS fix. */
const LATE_ROWS = 4096;
/** Row number of the first row: room to prepend, and small enough for fast integers. */
const FIRST_SEQUENCE = 1 << 28;
const REBASE_AT = 1 << 30;
const FIRST_CAPACITY = 256;

/** Memory shared by all rings. A ring that may not grow any more overwrites its oldest rows. */
export class Budget {
  used = 0;
  /** @param limit bytes over all rings; @param share bytes that one ring may take */
  constructor(
    readonly limit: number = 384 * 2 ** 20,
    readonly share: number = 48 * 2 ** 20,
  ) {}
}

/** Properties of a column needed by a ring. */
export interface RingColumn {
  readonly dtype: Dtype;
  /** Wraps at this value; 0: never. */
  readonly period: number;
  /** A flag word: stored with OR and AND instead of minimum and maximum. */
  readonly status: boolean;
}

function slots(dtype: Dtype, n: number): ColumnValues {
  switch (dtype) {
    case "f4":
      return new Float32Array(n);
    case "i1":
      return new Int8Array(n);
    case "u1":
      return new Uint8Array(n);
    case "i2":
      return new Int16Array(n);
    case "u2":
      return new Uint16Array(n);
    case "i4":
      return new Int32Array(n);
    case "u4":
      return new Uint32Array(n);
    // 64-bit integers are drawn and read as numbers: exact up to 2^53.
    case "f8":
    case "i8":
    case "u8":
      return new Float64Array(n);
  }
}

export class Ring {
  /** Rows `first` ≤ row < `end` are held. */
  first = FIRST_SEQUENCE;
  end = FIRST_SEQUENCE;
  /** Slot of row i is i & mask. */
  mask = FIRST_CAPACITY - 1;
  arrivals = new Float64Array(FIRST_CAPACITY);
  times = new Float64Array(FIRST_CAPACITY);
  columns: ColumnValues[];
  pyramids: (MinMax | OrAnd)[];
  /** Incremented with every change. */
  revision = 0;
  /** Incremented when drawn rows changed (prepended, moved, dropped): caches are invalid. */
  generation = 0;
  /** Samples moved to their place in time; samples too late to be moved. */
  late = 0;
  retimed = 0;
  /** False until a sample has a device clock. */
  clocked = false;
  /** Samples that the server dropped for this browser. */
  dropped = 0;
  readonly #kinds: readonly RingColumn[];
  readonly #budget: Budget;
  readonly #rowBytes: number;
  #nextSequence = -1;
  #firstSequence = -1;
  /** Part of the content is from an earlier server run: nothing goes before it. */
  #continued = false;
  readonly #gaps: Gaps;
  #newestArrival = NaN;

  constructor(kinds: readonly RingColumn[], budget: Budget = new Budget()) {
    this.#kinds = kinds;
    this.#budget = budget;
    this.columns = kinds.map((kind) => slots(kind.dtype, FIRST_CAPACITY));
    this.pyramids = this.columns.map((values, c) => this.#pyramid(values, c));
    this.#gaps = new Gaps(kinds.map(({ period }) => period));
    // Two time columns, the values, and a pyramid of 2 × 1/16 × 4/3 of them.
    this.#rowBytes = 16 + kinds.reduce((sum, kind) => sum + DTYPE_SIZE[kind.dtype] * (1 + 1 / 6), 0);
    budget.used += FIRST_CAPACITY * this.#rowBytes;
  }

  /** Rows held. */
  get length(): number {
    return this.end - this.first;
  }

  /** Arrival of the newest sample, unix s; NaN when there is none. */
  get newest(): number {
    return this.#newestArrival;
  }

  /** Usual spacing of the samples, s; NaN while unknown. */
  get step(): number {
    return this.#gaps.step;
  }

  /** Rows before which no line may be drawn, ascending. */
  get breaks(): readonly number[] {
    return this.#gaps.breaks;
  }

  /** Per wrapping column the rows at which it jumped over its edge, ascending. */
  get wraps(): readonly (readonly number[] | undefined)[] {
    return this.#gaps.wraps;
  }

  /** Arrival time of sample `i`, counted from the oldest held; unix s. */
  arrival(i: number): number {
    return this.arrivals[(this.first + i) & this.mask]!;
  }

  /** Device time of sample `i` (arrival where there is no device clock); unix s. */
  time(i: number): number {
    return this.times[(this.first + i) & this.mask]!;
  }

  value(column: number, i: number): number {
    return this.columns[column]?.[(this.first + i) & this.mask] ?? NaN;
  }

  /** The last sample not after `t`, −1 when there is none. */
  indexAt(t: number, base: TimeBase): number {
    return this.row(t, base, true) - this.first - 1;
  }

  /** The first row at or after `t`; with `after` the first row after `t`. */
  row(t: number, base: TimeBase, after = false): number {
    const times = base === "device" ? this.times : this.arrivals;
    let a = this.first;
    let b = this.end;
    while (a < b) {
      const m = a + ((b - a) >> 1);
      const x = times[m & this.mask]!;
      if (x < t || (after && x === t)) a = m + 1;
      else b = m;
    }
    return a;
  }

  /** Rows with t0 ≤ time < t1: number, mean, standard deviation (n − 1) and extremes of a column, around the circle where it wraps. */
  stats(column: number, t0: number, t1: number, base: TimeBase): Stats {
    const values = this.columns[column];
    if (values === undefined) return NO_STATS;
    return statsOf(values, this.mask, this.row(t0, base), this.row(t1, base), this.#kinds[column]!.period);
  }

  /** Extremes of `n` equal spans of `dt` seconds from `t0`: for sparklines; NaN where there is no sample. */
  buckets(
    column: number,
    t0: number,
    dt: number,
    n: number,
    base: TimeBase,
  ): { readonly lo: Float64Array; readonly hi: Float64Array } {
    const lo = new Float64Array(n).fill(NaN);
    const hi = new Float64Array(n).fill(NaN);
    const pyramid = this.pyramids[column];
    const extent: Extent = { lo: 0, hi: 0 };
    let from = this.row(t0, base);
    for (let k = 0; k < n && pyramid !== undefined; k++) {
      const to = this.row(t0 + (k + 1) * dt, base);
      if (to > from) {
        pyramid.query(from, to, extent);
        if (extent.lo <= extent.hi) [lo[k], hi[k]] = [extent.lo, extent.hi];
      }
      from = to;
    }
    return { lo, hi };
  }

  /** Add a frame: history goes before the content, everything else after it; known samples are skipped. */
  take(frame: SampleFrame): void {
    if (frame.n === 0) return;
    if (this.#continued && this.#nextSequence < 0 && frame.arrival[0]! < this.#newestArrival) this.clear(); // the host's clock was set back
    if (this.#continued && frame.history && this.#nextSequence >= 0 && frame.sequence < this.#nextSequence) return;
    if (this.length === 0 || !frame.history || frame.sequence >= this.#nextSequence) this.#append(frame);
    else this.#prepend(frame);
    this.revision += 1;
  }

  /** Later samples are from another run of the server, with its own numbering: they go after the content, unconnected. */
  continueAnew(): void {
    if (this.length > 0) this.cut(this.time(this.length - 1) + 1e-6); // one step of a unix time is 0.24 µs
    this.#nextSequence = this.#firstSequence = -1;
    this.#continued = this.length > 0;
  }

  /** Break the line at `time`, where the device's clock did not continue. */
  cut(time: number): void {
    this.#gaps.cut(time, this.row(time, "device"), this);
    this.revision += 1;
    this.generation += 1;
  }

  /** Break the line over samples between t0 and t1 that the device's counter reports missing. */
  lose(t0: number, t1: number): void {
    if (!this.#gaps.lose(t0, t1, this.row(t0, "device"), this.row(t1, "device", true) + 1, this)) return;
    this.revision += 1;
    this.generation += 1;
  }

  /**
   * Drop all samples. `longest`: from here on rows further apart than this, s, are not connected; NaN: derived from the usual
   * spacing.
   */
  clear(longest = NaN): void {
    this.first = this.end = FIRST_SEQUENCE;
    this.#gaps.clear();
    this.#gaps.longest = longest;
    this.#nextSequence = this.#firstSequence = -1;
    this.#newestArrival = NaN;
    this.#continued = false;
    this.clocked = false;
    this.revision += 1;
    this.generation += 1;
  }

  /** Convert all rows to another frame by `change`. Order, gaps and clocks stay. */
  transform(change: FrameChange): void {
    const { mask } = this;
    const row = new Float64Array(this.columns.length);
    for (let r = this.first; r < this.end; r++) {
      const slot = r & mask;
      for (let c = 0; c < row.length; c++) row[c] = this.columns[c]![slot]!;
      change.forEach((made, c) => (this.columns[c]![slot] = inFrame(made, (k) => row[k]!, this.#kinds[c]!.period)));
    }
    if (this.length > 0) this.#touch(this.first, this.end);
    this.revision += 1;
    this.generation += 1;
  }

  /** Return the memory to the budget; the ring must not be used afterwards. */
  release(): void {
    this.#budget.used -= (this.mask + 1) * this.#rowBytes;
  }

  #append(frame: SampleFrame): void {
    const skip = this.#nextSequence < 0 ? 0 : Math.max(0, this.#nextSequence - frame.sequence);
    const n = frame.n - skip;
    if (n <= 0) return;
    const missing = this.#nextSequence < 0 ? 0 : Math.max(0, frame.sequence - this.#nextSequence);
    this.dropped += frame.dropped;
    this.#grow(n);
    const capacity = this.mask + 1;
    const extra = Math.max(0, n - capacity); // a frame longer than the ring: only its end fits
    const from = this.end;
    this.end += n - extra;
    if (this.end - this.first > capacity) this.first = this.end - capacity;
    this.#write(frame, skip + extra, from, n - extra);
    const start = this.#settle(from, this.end);
    if (this.#firstSequence < 0) this.#firstSequence = frame.sequence;
    this.#nextSequence = frame.sequence + frame.n;
    const last = frame.arrival[frame.n - 1]!;
    if (!(last <= this.#newestArrival)) this.#newestArrival = last;
    this.#touch(start, this.end);
    if (missing + frame.dropped > 0 && from > this.first) this.#gaps.insert(from);
    if (this.end > REBASE_AT) this.#rebase();
  }

  #prepend(frame: SampleFrame): void {
    const overlap = Math.max(0, frame.sequence + frame.n - this.#firstSequence);
    this.#grow(frame.n - overlap);
    const n = Math.min(frame.n - overlap, this.mask + 1 - this.length);
    if (n <= 0) return;
    const skip = frame.n - overlap - n;
    const joint = this.first;
    this.first -= n;
    this.#write(frame, skip, this.first, n);
    this.#settle(this.first, joint);
    // A late sample may stand just behind the joint and belong before it.
    let settled = joint;
    while (settled < this.end && this.#behind(settled)) this.#settle(settled, ++settled);
    const gap = frame.sequence + frame.n < this.#firstSequence;
    this.#firstSequence = frame.sequence + skip;
    this.#touch(this.first, Math.min(this.end, settled + 1));
    if (gap) this.#gaps.insert(joint);
    this.generation += 1;
  }

  /** Copy n rows of a frame, from its row `skip` on, to rows `to`…; the time of a sample without device clock is its arrival. */
  #write(frame: SampleFrame, skip: number, to: number, n: number): void {
    const { mask } = this;
    for (let k = 0; k < n; k++) {
      const slot = (to + k) & mask;
      const arrival = frame.arrival[skip + k]!;
      const time = frame.time[skip + k]!;
      this.arrivals[slot] = arrival;
      this.times[slot] = time === time ? time : arrival;
      if (time === time) this.clocked = true;
    }
    frame.columns.forEach((source: Column, c) => {
      const target = this.columns[c];
      if (target === undefined) return;
      if (source instanceof BigInt64Array || source instanceof BigUint64Array) {
        for (let k = 0; k < n; k++) target[(to + k) & mask] = Number(source[skip + k]);
      } else {
        const room = mask + 1 - (to & mask); // rows up to the end of the array; the rest begins at its start
        target.set(source.subarray(skip, skip + Math.min(n, room)), to & mask);
        if (n > room) target.set(source.subarray(skip + room, skip + n), 0);
      }
    });
  }

  #behind(row: number): boolean {
    return row > this.first && this.times[row & this.mask]! < this.times[(row - 1) & this.mask]!;
  }

  /** Sort rows from ≤ row < to, which were just written, by time. Returns the first row that changed. */
  #settle(from: number, to: number): number {
    let start = from;
    for (let row = Math.max(from, this.first + 1); row < to; row++) {
      if (!this.#behind(row)) continue;
      const time = this.times[row & this.mask]!;
      const limit = Math.max(this.first, row - LATE_ROWS);
      let place = row;
      while (place > limit && this.times[(place - 1) & this.mask]! > time) place--;
      if (place === limit && this.times[limit & this.mask]! > time) {
        this.times[row & this.mask] = this.times[(row - 1) & this.mask]!;
        this.retimed += 1;
        continue;
      }
      this.late += 1;
      if (place < start) {
        start = place;
        this.generation += 1;
      }
      for (const array of [this.times, this.arrivals, ...this.columns]) {
        const moved = array[row & this.mask]!;
        for (let k = row; k > place; k--) array[k & this.mask] = array[(k - 1) & this.mask]!;
        array[place & this.mask] = moved;
      }
    }
    return start;
  }

  /** Update pyramids, breaks and wraps for the new rows from ≤ row < to. */
  #touch(from: number, to: number): void {
    for (const pyramid of this.pyramids) pyramid.update(from, to);
    this.#gaps.judge(this, from, to);
  }

  /** Room for n more rows: double the capacity while the budget allows. */
  #grow(n: number): void {
    const old = this.mask + 1;
    let capacity = old;
    while (capacity < this.length + n) {
      const bytes = 2 * capacity * this.#rowBytes;
      if (bytes > this.#budget.share || this.#budget.used + bytes - old * this.#rowBytes > this.#budget.limit) break;
      capacity *= 2;
    }
    if (capacity === old) return;
    this.#budget.used += (capacity - old) * this.#rowBytes;
    const move = <A extends ColumnValues>(source: A, target: A): A => {
      for (let row = this.first; row < this.end; row++) target[row & (capacity - 1)] = source[row & (old - 1)]!;
      return target;
    };
    this.arrivals = move(this.arrivals, new Float64Array(capacity));
    this.times = move(this.times, new Float64Array(capacity));
    this.columns = this.columns.map((values, c) => move(values, slots(this.#kinds[c]!.dtype, capacity)));
    this.mask = capacity - 1;
    const before = this.pyramids;
    this.pyramids = this.columns.map((values, c) => this.#pyramid(values, c, before[c]));
    if (this.length > 0) for (const pyramid of this.pyramids) pyramid.update(this.first, this.end);
  }

  #pyramid(values: ColumnValues, c: number, before?: MinMax | OrAnd): MinMax | OrAnd {
    if (this.#kinds[c]?.status !== true) return new MinMax(values);
    const pyramid = new OrAnd(values);
    if (before instanceof OrAnd) [pyramid.everSet, pyramid.alwaysSet] = [before.everSet, before.alwaysSet];
    return pyramid;
  }

  /** Renumber rows from FIRST_SEQUENCE, after months: by whole turns of the ring, so that every row keeps its slot. */
  #rebase(): void {
    const turns = (this.first - FIRST_SEQUENCE) & ~this.mask;
    this.first -= turns;
    this.end -= turns;
    this.#gaps.shift(turns);
    this.generation += 1;
  }
}
