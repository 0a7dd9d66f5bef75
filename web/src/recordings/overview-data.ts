/**
 * Overview of a whole recording: the variation of a quantity in every part of it, and the worst state of its status words there. Pure:
 * frames of the wire in, one value a part out. Rows may be samples or bounds of intervals: the extremes are the same.
 */
import type { SampleFrame } from "../wire/codec";
import type { ChannelInfo } from "../wire/types";

type Span = readonly [t0: number, t1: number];

/** Nothing, a warning, an error. */
export type Worst = 0 | 1 | 2;

/** Fraction of the bars that may exceed the strip's scale: one jolt must not flatten an hour. */
const OUTLIER_SHARE = 0.02;

function slotOf(t: number, t0: number, t1: number, n: number): number {
  return Math.min(n - 1, Math.max(0, Math.floor(((t - t0) / (t1 - t0)) * n)));
}

/** Variation of some columns, of one unit, in each of `n` parts of t0…t1, 0..1; NaN without samples. */
export function motionOf(frame: SampleFrame, columns: readonly number[], [t0, t1]: Span, n: number): Float64Array {
  const out = new Float64Array(n).fill(NaN);
  for (const column of columns.map((at) => frame.columns[at]!)) {
    if (column instanceof BigInt64Array || column instanceof BigUint64Array) continue;
    const lo = new Float64Array(n).fill(Infinity);
    const hi = new Float64Array(n).fill(-Infinity);
    for (let i = 0; i < frame.n; i++) {
      const t = frame.time[i]!;
      const k = slotOf(t === t ? t : frame.arrival[i]!, t0, t1, n);
      const v = column[i]!;
      if (v < lo[k]!) lo[k] = v;
      if (v > hi[k]!) hi[k] = v;
    }
    for (let k = 0; k < n; k++) {
      const range = hi[k]! - lo[k]!;
      if (range >= 0 && !(range <= out[k]!)) out[k] = range;
    }
  }
  const seen = [...out].filter((v) => v === v).sort((a, b) => a - b);
  const most = seen[Math.round((seen.length - 1) * (1 - OUTLIER_SHARE))] || 1;
  return out.map((v) => Math.min(1, v / most));
}

/** The worst state of any flag of a status channel in each part of a span. */
export function worstOf({ columns }: ChannelInfo, frame: SampleFrame, [t0, t1]: Span, into: Uint8Array): void {
  const n = into.length;
  columns.forEach(({ bits }, c) => {
    const column = frame.columns[c];
    if (column === undefined || column instanceof BigInt64Array || column instanceof BigUint64Array) return;
    for (const { low, width, severity, normal_set: normal } of bits) {
      if (severity === "" || low > 31) continue;
      const mask = (width >= 32 ? -1 : (1 << width) - 1) << low;
      const level = severity === "error" ? 2 : 1;
      for (let i = 0; i < frame.n; i++) {
        const set = (column[i]! & mask) !== 0;
        if (set === normal) continue;
        const t = frame.time[i]!;
        const k = slotOf(t === t ? t : frame.arrival[i]!, t0, t1, n);
        into[k] = Math.max(into[k]!, level);
      }
    }
  });
}
