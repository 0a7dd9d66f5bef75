/** Drawing of a plot: grid, losses, curves, notes and cursors. */
import { lowerBound } from "../../../data/line-breaks";
import { tickLabel, timeStep } from "../../../plots/axis";
import { isLogarithmic, logTicks } from "../../../plots/y-axis";
import { Scale, ticks } from "../../../charts/scale";
import { number } from "../../../ui/format/format";
import type { EmbeddedCurve, EmbeddedPlot } from "./content";

/** What all plots show, in seconds from the beginning of the range. */
export interface DrawnRange {
  readonly from: number;
  readonly to: number;
  readonly a: number | undefined;
  readonly b: number | undefined;
}

/** What is marked in all plots. */
export interface Marks {
  /** Unix time of the beginning. */
  readonly t0: number;
  readonly losses: readonly (readonly [number, number])[];
  readonly notes: readonly number[];
}

export const LEFT = 58;
export const RIGHT = 12;
const TOP = 6;
const BOTTOM = 20;
const DOTS_FROM = 9;
/** Least height of a logarithmic axis, decades. */
const LEAST_DECADES = 0.05;
/** Half the letter of a cursor on the axis, and a margin. */
const FLAG_PX = 10;

type Colour = (name: string) => string;

interface Frame {
  readonly x: CanvasRenderingContext2D;
  readonly width: number;
  readonly height: number;
  readonly shown: DrawnRange;
  readonly colour: Colour;
  /** Ends of the y axis; of a logarithmic one their powers of ten. */
  readonly lo: number;
  readonly hi: number;
  readonly isLog: boolean;
}

const xOf = ({ width, shown }: Frame, t: number): number =>
  LEFT + ((t - shown.from) / (shown.to - shown.from)) * (width - LEFT - RIGHT);
const yOf = ({ height, lo, hi, isLog }: Frame, v: number): number =>
  TOP + ((hi - (isLog ? Math.log10(v) : v)) / (hi - lo)) * (height - TOP - BOTTOM);

/** Extent of the curves in a window. */
export function extentOf(plot: EmbeddedPlot, { from, to }: DrawnRange): readonly [number, number] {
  let [lo, hi] = [Infinity, -Infinity];
  for (const { times, low, high } of plot.curves) {
    const end = Math.min(times.length, lowerBound(times, to) + 1);
    for (let row = Math.max(0, lowerBound(times, from) - 1); row < end; row++) {
      const [l, h] = [low[row] ?? NaN, high[row] ?? NaN];
      if (l < lo) lo = l;
      if (h > hi) hi = h;
    }
  }
  return [lo, hi];
}

/** Ends of the y axis over a window; of a logarithmic one their powers of ten. */
export function endsOf(plot: EmbeddedPlot, shown: DrawnRange): Pick<Frame, "lo" | "hi" | "isLog"> {
  const [low, high] = extentOf(plot, shown);
  const isLog = isLogarithmic({ isLog: plot.isLog, ...(plot.fixed ? { range: plot.fixed } : {}) }, low);
  const into = (value: number): number => (isLog ? Math.log10(value) : value);
  if (plot.fixed) return { lo: into(plot.fixed[0]), hi: into(plot.fixed[1]), isLog };
  const period = Math.max(0, ...plot.curves.map((curve) => curve.period));
  const scale = isLog ? new Scale(LEAST_DECADES) : new Scale(1e-9, period);
  scale.update(into(low), into(high), 0, true);
  return { lo: scale.lo, hi: scale.hi, isLog };
}

export function draw(
  x: CanvasRenderingContext2D,
  width: number,
  height: number,
  plot: EmbeddedPlot,
  shown: DrawnRange,
  marks: Marks,
  colour: Colour,
): void {
  const frame = { x, width, height, shown, colour, ...endsOf(plot, shown) };
  x.fillStyle = colour("--bg");
  x.fillRect(0, 0, width, height);
  x.font = '11px system-ui, -apple-system, "Segoe UI", Roboto, sans-serif';
  grid(frame, marks.t0, plot.unit === "°");
  x.save();
  x.beginPath();
  x.rect(LEFT, TOP, width - LEFT - RIGHT, height - TOP - BOTTOM);
  x.clip();
  x.fillStyle = colour("--loss");
  x.globalAlpha = 0.16;
  for (const [t0, t1] of marks.losses) {
    const left = xOf(frame, t0);
    x.fillRect(left, TOP, Math.max(1, xOf(frame, t1) - left), height - TOP - BOTTOM);
  }
  x.globalAlpha = 1;
  for (const curve of plot.curves) line(frame, curve);
  x.restore();
  notes(frame, marks.notes);
  cursor(frame, shown.a, "A");
  cursor(frame, shown.b, "B");
}

function grid(frame: Frame, t0: number, degrees: boolean): void {
  const { x, width, height, shown, colour, lo, hi, isLog } = frame;
  x.textBaseline = "middle";
  x.textAlign = "right";
  const linear = ticks(lo, hi, height - TOP - BOTTOM, degrees, 28);
  const labels = isLog
    ? logTicks(lo, hi)
    : linear.map((tick) => ({ ...tick, text: number(tick.value, tick.decimals) }));
  for (const { value, text } of labels) {
    const y = Math.round(yOf(frame, value)) + 0.5;
    x.fillStyle = colour(value === 0 ? "--grid-zero" : "--grid");
    x.fillRect(LEFT, y - 0.5, width - LEFT - RIGHT, 1);
    x.fillStyle = colour("--ink-3");
    x.fillText(text, LEFT - 6, y);
  }
  const room = width - LEFT - RIGHT;
  const step = timeStep(shown.to - shown.from, room);
  const flags = [shown.a, shown.b].flatMap((t) => (t === undefined ? [] : [xOf(frame, t)]));
  x.textAlign = "center";
  for (let k = Math.ceil((t0 + shown.from) / step); k * step <= t0 + shown.to; k++) {
    const px = xOf(frame, k * step - t0);
    x.fillStyle = colour("--grid");
    x.fillRect(Math.round(px), TOP, 1, height - TOP - BOTTOM);
    const label = tickLabel(k * step, step);
    const half = x.measureText(label).width / 2;
    x.fillStyle = colour("--ink-3");
    const isCovered = flags.some((flag) => Math.abs(flag - px) < half + FLAG_PX);
    if (px - half > LEFT - 20 && px + half < width && !isCovered) x.fillText(label, px, height - BOTTOM / 2);
  }
}

function line(frame: Frame, curve: EmbeddedCurve): void {
  const { x, width, shown, colour } = frame;
  const { times, low, high, breaks, period } = curve;
  const first = Math.max(0, lowerBound(times, shown.from) - 1);
  const end = Math.min(times.length, lowerBound(times, shown.to) + 1);
  const room = width - LEFT - RIGHT;
  const isDense = !curve.isExact || end - first > 2 * room;
  x.strokeStyle = x.fillStyle = colour(`--${curve.colour}`);
  x.lineWidth = 1.3;
  x.setLineDash([...curve.dash]);
  x.beginPath();
  let isDown = false;
  let y = 0;
  if (!isDense) {
    for (let row = first; row < end; row++) {
      const v = low[row] ?? NaN;
      const wraps = period > 0 && Math.abs(v - (low[row - 1] ?? v)) > period / 2;
      if (!isDown || breaks.has(row) || wraps) x.moveTo(xOf(frame, times[row] ?? 0), yOf(frame, v));
      else x.lineTo(xOf(frame, times[row] ?? 0), yOf(frame, v));
      isDown = true;
    }
  } else {
    for (let row = first; row < end; ) {
      const px = Math.floor(xOf(frame, times[row] ?? 0)) + 0.5;
      let [l, h] = [Infinity, -Infinity];
      let isBroken = false;
      do {
        if ((low[row] ?? NaN) < l) l = low[row] ?? NaN;
        if ((high[row] ?? NaN) > h) h = high[row] ?? NaN;
        isBroken ||= breaks.has(row);
        row++;
      } while (row < end && xOf(frame, times[row] ?? 0) < px + 0.5);
      const [top, bottom] = [yOf(frame, h), yOf(frame, l)];
      const isNearTop = Math.abs(y - top) < Math.abs(y - bottom);
      if (!isDown || isBroken) x.moveTo(px, top);
      else x.lineTo(px, isNearTop ? top : bottom);
      y = isDown && !isBroken && !isNearTop ? top : Math.max(bottom, top + 0.5);
      x.lineTo(px, y);
      isDown = true;
    }
  }
  x.stroke();
  x.setLineDash([]);
  if (isDense || (end - first) * DOTS_FROM > room) return;
  for (let row = first; row < end; row++) {
    x.beginPath();
    x.arc(xOf(frame, times[row] ?? 0), yOf(frame, low[row] ?? NaN), 2, 0, 7);
    x.fill();
  }
}

function notes(frame: Frame, times: readonly number[]): void {
  const { x, shown, colour } = frame;
  x.fillStyle = colour("--yours");
  for (const t of times) {
    if (t < shown.from || t > shown.to) continue;
    const px = xOf(frame, t);
    x.beginPath();
    x.moveTo(px - 4, 0);
    x.lineTo(px + 4, 0);
    x.lineTo(px, TOP + 1);
    x.fill();
  }
}

function cursor(frame: Frame, t: number | undefined, name: "A" | "B"): void {
  const { x, shown, colour, height } = frame;
  if (t === undefined || t < shown.from || t > shown.to) return;
  const px = Math.round(xOf(frame, t));
  const isA = name === "A";
  x.fillStyle = colour(isA ? "--invert-bg" : "--yours");
  x.fillRect(px, TOP, 1, height - TOP - BOTTOM);
  x.fillRect(px - 7, height - BOTTOM + 2, 15, 16);
  x.fillStyle = colour(isA ? "--invert-ink" : "--yours-ink");
  x.textAlign = "center";
  x.fillText(name, px + 0.5, height - BOTTOM / 2 + 0.5);
}
