/**
 * The time axis: ticks in clock steps, labels in UTC, and the cursor's time to 1 ms.
 */
import type { View } from "../data/view";
import { clock } from "../ui/format/format";
import { type Palette, setFont, type CanvasLayer } from "./canvas-style";
import { xOf, type TimeWindow } from "./time-window";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/plots";

/** Steps of a clock, s; below a second decimal ones. */
const STEPS: readonly number[] = [
  0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200,
  10_800, 21_600, 43_200, 86_400,
];
/** Room for a label, px: "14:32:18" and a margin. */
const LABEL_PX = 66;
const MILLI_PX = 92;
const DAY_S = 86_400;

/** Step between ticks of a window, s. */
export function timeStep(span: number, width: number): number {
  const fits = (step: number): boolean => (step / span) * width >= (step < 1 ? MILLI_PX : LABEL_PX);
  return STEPS.find(fits) ?? DAY_S * Math.ceil((span * LABEL_PX) / width / DAY_S);
}

/** The moments of the ticks in a window: whole multiples of the step since midnight UTC. */
export function timeGrid(w: TimeWindow): number[] {
  const step = timeStep(w.span, w.width);
  const out: number[] = [];
  for (let k = Math.ceil(w.t0 / step); k * step <= w.t1; k++) out.push(k * step);
  return out;
}

/** "21 Nov": day and month in UTC. */
export function day(t: number): string {
  const date = new Date(t * 1000);
  return `${date.getUTCDate()} ${COMMON.months[date.getUTCMonth()]}`;
}

/** Label of a tick: the time, and at midnight the day. */
export function tickLabel(t: number, step: number): string {
  if (Math.abs(t / DAY_S - Math.round(t / DAY_S)) < 1e-9 && step >= 60) return day(t);
  return clock(t, step < 0.01 ? 3 : step < 0.1 ? 2 : step < 1 ? 1 : 0);
}

/** A length of time as measured: 3 decimals of a second, or ms below one. */
export function duration(seconds: number): string {
  const size = Math.abs(seconds);
  const sign = seconds < 0 ? "−" : "";
  if (size < 1) return `${sign}${(size * 1000).toFixed(size < 0.1 ? 2 : 1)} ms`;
  if (size < 60) return `${sign}${size.toFixed(3)} s`;
  return TEXT.minutesSeconds(sign, Math.floor(size / 60), (size % 60).toFixed(1));
}

/** Text at the left end of the axis. */
export function axisWords(w: TimeWindow, base: View["timeBase"]): string {
  const words = base === "device" ? TEXT.deviceTime : TEXT.arrivalTime;
  const away = day(w.t1) !== day(w.now);
  return away ? TEXT.utcDay(day(w.t1), words) : TEXT.utcBase(words);
}

/** A chip on the axis: the cursor's time, or the offset of the measuring cursor. */
interface Chip {
  readonly text: string;
  readonly from: number;
  readonly to: number;
  readonly yours: boolean;
}

function chips(
  x: CanvasRenderingContext2D,
  w: TimeWindow,
  least: number,
  cursorAt: number | undefined,
  measureAt: number | undefined,
): Chip[] {
  if (cursorAt === undefined) return [];
  const right = w.left + w.width;
  const wide = (text: string): number => x.measureText(text).width + 14;
  // an off-screen reading is shown at the edge: its values would be mistaken for those on screen
  const at = measureAt === undefined ? clock(cursorAt, 3) : TEXT.cursorA(clock(cursorAt, 3));
  const time = cursorAt < w.t0 ? `◂ ${at}` : cursorAt > w.t1 ? `${at} ▸` : at;
  const half = wide(time) / 2;
  const centre = Math.min(Math.max(xOf(w, cursorAt), least + half), right - half);
  const cursor = { text: time, from: centre - half, to: centre + half, yours: false };
  if (measureAt === undefined) return [cursor];
  const text = TEXT.measured(duration(measureAt - cursorAt));
  const width = wide(text) + 4;
  // on the side of the other cursor, if there is room; never off the axis
  const after = cursor.from - width < least || (measureAt > cursorAt && cursor.to + width < right);
  const from = after && cursor.to + width <= right + 4 ? cursor.to + 4 : Math.max(least, cursor.from - width);
  return [cursor, { text, from, to: from + width - 4, yours: true }];
}

export function drawAxis(
  sheet: CanvasLayer,
  w: TimeWindow,
  look: Palette,
  cursorAt: number | undefined,
  measureAt: number | undefined,
): void {
  const x = sheet.begin();
  const middle = sheet.height / 2 + 0.5;
  const least = look.narrow ? 4 : w.left;
  x.textBaseline = "middle";
  x.textAlign = "center";
  setFont(x, look, 11, 600);
  const shown = chips(x, w, least, cursorAt, measureAt);
  for (const { text, from, to, yours } of shown) {
    x.fillStyle = look.colour[yours ? "yours" : "invert-bg"];
    x.beginPath();
    x.roundRect(from, 2, to - from, sheet.height - 5, 3);
    x.fill();
    x.fillStyle = look.colour[yours ? "yours-ink" : "invert-ink"];
    x.fillText(text, (from + to) / 2, middle);
  }
  setFont(x, look, look.small);
  const step = timeStep(w.span, w.width);
  for (const t of timeGrid(w)) {
    const px = xOf(w, t);
    const label = tickLabel(t, step);
    const half = x.measureText(label).width / 2 + 3;
    const covered = (room: number): boolean => shown.some(({ from, to }) => px + room > from && px - room < to);
    x.fillStyle = look.colour["line-strong"];
    if (!covered(1)) x.fillRect(sheet.snap(px), 0, 1, 4);
    if (px - half < least || px + half > sheet.width - 4 || covered(half + 3)) continue;
    x.fillStyle = look.colour["ink-3"];
    x.fillText(label, px, middle + 1);
  }
  if (look.narrow) return;
  x.textAlign = "left";
  x.fillStyle = look.colour["ink-3"];
  x.fillText(axisWords(w, w.base), 16, middle);
}
