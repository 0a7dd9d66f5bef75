/**
 * What time is it along the axis? Ticks in steps that a clock has, labels in UTC, and the cursor's time to 1 ms.
 */
import type { View } from "../data/view";
import { clock } from "../ui/format";
import { type Palette, setFont, type Sheet } from "./paint";
import { xOf, type TimeWindow } from "./window";

/** Steps of a clock, s; below a second decimal ones. */
const STEPS: readonly number[] = [
  0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10_800, 21_600, 43_200, 86_400,
];
/** Room a label needs, px: "14:32:18" and air. */
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
  return `${date.getUTCDate()} ${["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"][date.getUTCMonth()]}`;
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
  return `${sign}${Math.floor(size / 60)} min ${(size % 60).toFixed(1)} s`;
}

/** What the left end of the axis says. */
export function axisWords(w: TimeWindow, base: View["timeBase"]): string {
  const words = base === "device" ? "device time" : "arrival time";
  const away = day(w.t1) !== day(w.now);
  return away ? `UTC ${day(w.t1)}, ${words}` : `UTC, ${words}`;
}

export function drawAxis(sheet: Sheet, w: TimeWindow, look: Palette, cursorAt: number | undefined, measureAt: number | undefined): void {
  const x = sheet.begin();
  const middle = sheet.height / 2 + 0.5;
  const right = w.left + w.width;
  setFont(x, look, look.small);
  x.textBaseline = "middle";
  x.fillStyle = look.colour["ink-3"];
  if (!look.narrow) x.fillText(axisWords(w, w.base), 16, middle);
  const on = (t: number): boolean => t >= w.t0 && t <= w.t1;
  const cursorX = cursorAt !== undefined && on(cursorAt) ? xOf(w, cursorAt) : undefined;
  x.textAlign = "center";
  const step = timeStep(w.span, w.width);
  for (const t of timeGrid(w)) {
    const px = xOf(w, t);
    x.fillStyle = look.colour["line-strong"];
    x.fillRect(sheet.snap(px), 0, 1, 4);
    const label = tickLabel(t, step);
    const half = x.measureText(label).width / 2 + 3;
    if (px - half < (look.narrow ? 4 : w.left) || px + half > sheet.width - 4) continue;
    if (cursorX !== undefined && Math.abs(px - cursorX) < half + 46) continue;
    x.fillStyle = look.colour["ink-3"];
    x.fillText(label, px, middle + 1);
  }
  if (cursorAt === undefined || cursorX === undefined) return;
  setFont(x, look, 11, 600);
  const chip = (text: string, px: number, fill: string, ink: string): [number, number] => {
    const width = x.measureText(text).width + 14;
    const centre = Math.min(Math.max(px, (look.narrow ? 4 : w.left) + width / 2), right - width / 2);
    x.fillStyle = fill;
    x.beginPath();
    x.roundRect(centre - width / 2, 2, width, sheet.height - 5, 3);
    x.fill();
    x.fillStyle = ink;
    x.fillText(text, centre, middle);
    return [centre - width / 2, centre + width / 2];
  };
  const [from, to] = chip(clock(cursorAt, 3), cursorX, look.colour["invert-bg"], look.colour["invert-ink"]);
  if (measureAt === undefined) return;
  const text = `Δ ${duration(cursorAt - measureAt)}`;
  const half = x.measureText(text).width / 2 + 7;
  const beside = measureAt > cursorAt && to + 2 * half + 4 < right ? to + half + 4 : from - half - 4;
  chip(text, beside, look.colour.yours, look.colour["yours-ink"]);
}
