/**
 * Drawing of one series: as a line through its samples while they are further apart than pixels, else as one stroke per pixel from the
 * smallest to the largest value in it. In both cases nothing is connected across a gap, a missing value or a wrap:
 *
 *     samples      ╱╲   ╱╲ ░░ ╱╲        columns      │╷│╵││ ░░ │╷││
 *                    break ▲  ▲ break                    ▲ the pen is lifted where a break lies
 */
import { lowerBound } from "../data/line-breaks";
import type { Ring } from "../data/ring-buffer";
import type { Extent } from "../data/minmax-pyramid";
import type { PixelColumns } from "./pixel-columns";
import { xOf, type TimeWindow } from "./time-window";

type Context = CanvasRenderingContext2D;

/** Samples per pixel from which extremes are drawn instead of samples. */
const SAMPLES_PER_PX = 1.5;
/** Samples at least this far apart, px, are marked with dots. */
const DOTS_FROM = 9;
/** Wraps and breaks in one pixel drawn separately; with more the quantity spins faster than the screen can show, and fills its range. */
const JOINTS_APART = 3;

/** Vertical scale: y = top + (hi − v) · k, CSS px; on a logarithmic axis with the powers of ten of hi and v. */
export interface Vertical {
  readonly top: number;
  readonly hi: number;
  readonly k: number;
  readonly isLog?: boolean;
}

export function yOf(v: Vertical, value: number): number {
  return v.top + (v.hi - (v.isLog === true ? Math.log10(value) : value)) * v.k;
}

/** Whether the window has so many samples that extremes are drawn. */
export function isDense(columns: PixelColumns, w: TimeWindow): boolean {
  const rows = columns.rows[w.g1 & columns.mask]! - columns.rows[w.g0 & columns.mask]!;
  return rows > SAMPLES_PER_PX * (w.g1 - w.g0);
}

/** Add the series of column `k` of `columns` to the context's path. Returns samples' spacing in px, for dots. */
export function traceSeries(x: Context, columns: PixelColumns, k: number, w: TimeWindow, v: Vertical): void {
  x.beginPath();
  if (isDense(columns, w)) dense(x, columns, k, w, v);
  else
    sparse(
      x,
      columns.ring,
      columns.columns[k]!,
      columns.rows[w.g0 & columns.mask]!,
      columns.rows[w.g1 & columns.mask]!,
      w,
      v,
    );
  x.stroke();
}

function dense(x: Context, columns: PixelColumns, k: number, w: TimeWindow, v: Vertical): void {
  const { rows, mask, ring } = columns;
  const [lo, hi] = [columns.lo[k]!, columns.hi[k]!];
  const breaks = ring.breaks;
  const wraps = ring.wraps[columns.columns[k]!] ?? [];
  const first = rows[w.g0 & mask]!;
  let b = lowerBound(breaks, first);
  let wrap = lowerBound(wraps, first);
  let pen = false;
  let y = 0;
  const step = 1 / w.ratio;
  let px = w.left + step / 2;
  for (let g = w.g0; g < w.g1; g++, px += step) {
    const slot = g & mask;
    const to = rows[(g + 1) & mask]!;
    const low = lo[slot]!;
    const high = hi[slot]!;
    if (!(low <= high)) {
      if (to > rows[slot]!) pen = false; // samples, but none with a value
      continue;
    }
    while (breaks[b]! <= rows[slot]!) {
      pen = false;
      b++;
    }
    if (breaks[b]! < to || wraps[wrap]! < to) {
      const joints: number[] = [];
      while (breaks[b]! < to) joints.push(breaks[b++]!);
      while (wraps[wrap]! < to) joints.push(wraps[wrap++]!);
      y = apart(
        x,
        columns,
        k,
        rows[slot]!,
        to,
        joints.sort((p, q) => p - q),
        px,
        v,
        pen ? y : NaN,
      );
      pen = true;
      continue;
    }
    const top = yOf(v, high);
    const bottom = yOf(v, low);
    if (!pen) {
      x.moveTo(px, top);
      x.lineTo(px, bottom);
      y = bottom;
    } else if (Math.abs(y - top) < Math.abs(y - bottom)) {
      // enter the column at its nearer end, so that the joint is as short as possible
      x.lineTo(px, top);
      if (bottom - top > 0.2) x.lineTo(px, bottom);
      y = bottom;
    } else {
      x.lineTo(px, bottom);
      if (bottom - top > 0.2) x.lineTo(px, top);
      y = top;
    }
    pen = true;
  }
}

const part: Extent = { lo: 0, hi: 0 };

/** Draw a pixel in which the quantity wrapped or the line breaks: each part separately. Returns where it ended. */
function apart(
  x: Context,
  columns: PixelColumns,
  k: number,
  from: number,
  to: number,
  joints: readonly number[],
  px: number,
  v: Vertical,
  y: number,
): number {
  const pyramid = columns.ring.pyramids[columns.columns[k]!]!;
  const cuts = joints.length > JOINTS_APART ? [from, to] : [from, ...joints, to];
  let end = y;
  for (let c = 0; c + 1 < cuts.length; c++) {
    if (cuts[c] === cuts[c + 1]) continue;
    pyramid.query(cuts[c]!, cuts[c + 1]!, part);
    if (!(part.lo <= part.hi)) continue;
    const [top, bottom] = [yOf(v, part.hi), yOf(v, part.lo)];
    if (c === 0 && y === y && joints.length <= JOINTS_APART)
      x.lineTo(px, Math.abs(y - top) < Math.abs(y - bottom) ? top : bottom);
    x.moveTo(px, top);
    x.lineTo(px, bottom);
    end = (top + bottom) / 2;
  }
  return end;
}

function sparse(x: Context, ring: Ring, c: number, from: number, to: number, w: TimeWindow, v: Vertical): void {
  // one sample beyond either edge, so that the line reaches the edge
  const a = Math.max(ring.first, from - 1);
  const b = Math.min(ring.end, to + 1);
  const times = w.base === "device" ? ring.times : ring.arrivals;
  const values = ring.columns[c]!;
  const wraps = ring.wraps[c];
  let breakAt = lowerBound(ring.breaks, a);
  let wrapAt = wraps === undefined ? 0 : lowerBound(wraps, a);
  let pen = false;
  for (let row = a; row < b; row++) {
    const value = values[row & ring.mask]!;
    if (ring.breaks[breakAt] === row) {
      pen = false;
      breakAt++;
    }
    if (wraps !== undefined && wraps[wrapAt] === row) {
      pen = false;
      wrapAt++;
    }
    if (value !== value) {
      pen = false;
      continue;
    }
    const px = xOf(w, times[row & ring.mask]!);
    const py = yOf(v, value);
    if (!pen) x.moveTo(px, py);
    x.lineTo(px, py); // after a moveTo a line of zero length: with round caps a lone sample is a dot
    pen = true;
  }
}

/** Dots on the samples, if they are far enough apart. */
export function traceDots(x: Context, columns: PixelColumns, k: number, w: TimeWindow, v: Vertical): void {
  const { ring, rows, mask } = columns;
  const [from, to] = [rows[w.g0 & mask]!, rows[w.g1 & mask]!];
  if (to - from < 1 || w.width / (to - from) < DOTS_FROM) return;
  const times = w.base === "device" ? ring.times : ring.arrivals;
  const values = ring.columns[columns.columns[k]!]!;
  x.beginPath();
  for (let row = from; row < to; row++) {
    const value = values[row & ring.mask]!;
    if (value === value) x.rect(xOf(w, times[row & ring.mask]!) - 1.5, yOf(v, value) - 1.5, 3, 3);
  }
  x.fill();
}
