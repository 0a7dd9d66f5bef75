/**
 * The memory strip under the axis: the motion of all stored data, marks where samples are missing, and the window as a box that can
 * be dragged.
 */
import type { Loss } from "../data/losses";
import { number, span as spanOf } from "../ui/format/format";
import { PixelColumns } from "./pixel-columns";
import { lossMarks } from "./loss-marks";
import { drawMarkers, type MarkLine } from "./markers";
import { type Palette, setFont, type CanvasLayer } from "./canvas-style";
import type { PlotSpec } from "../data/view";
import { timeWindow, xOf, type TimeWindow } from "./time-window";
import { TEXT } from "../texts/plots";

/** Memory of ten minutes holds a little more, for which the strip does not become twice as long. */
const OVER_SHARE = 0.05;
/** Possible lengths of the strip, s: it grows in steps so that it does not crawl. */
const LENGTHS: readonly number[] = [60, 120, 300, 600, 1200, 1800, 3600, 7200, 14_400, 28_800, 57_600, 86_400];
/** Lag behind live that is reported, s. */
const BEHIND_S = 0.05;
const MARK_PX = 1.5;
/** Fraction of the bars, at either end, that may exceed the strip's scale. */
const OUTLIER_SHARE = 0.03;

/** Steps between the strip's marks, s; the first with at most MAX_MARKS of them is used. */
const MARK_STEPS: readonly number[] = [15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14_400, 21_600];
const MAX_MARKS = 5;

/** Length of the strip for the stored data, s. */
export function stripLength(held: number, window: number): number {
  const need = Math.max(held, window);
  return LENGTHS.find((length) => length >= need * (1 - OVER_SHARE)) ?? need;
}

/** Age of a mark of the strip: "−2 min". */
function ago(seconds: number): string {
  const { value, unit } = spanOf(seconds);
  return `−${value} ${unit}`;
}

export class HistoryStrip {
  #columns: PixelColumns | undefined;
  #key = "";
  window: TimeWindow | undefined;

  /** The quantity whose extremes are drawn: the norm of the first plot, or its first series. */
  follow(spec: PlotSpec | undefined): void {
    const series = spec?.series.find(({ norm }) => norm) ?? spec?.series[0];
    if (series?.key === this.#key && this.#columns?.ring === series?.channel.ring) return;
    this.#key = series?.key ?? "";
    this.#columns = series && new PixelColumns(series.channel.ring, [series.column]);
  }

  draw(
    sheet: CanvasLayer,
    w: TimeWindow,
    look: Palette,
    first: number | undefined,
    losses: readonly Loss[],
    markers: readonly MarkLine[],
  ): void {
    const x = sheet.begin();
    const length = stripLength(first === undefined ? 0 : w.now - first, w.span);
    const view = { device: undefined, live: true, end: 0, span: length, timeBase: w.base } as const;
    const strip = (this.window = timeWindow(view, w.now, w.left, w.width, sheet.ratio / 2)); // bars two pixels wide
    const [y, height] = [6, sheet.height - 20];
    this.#bars(x, strip, look, y, height);
    x.fillStyle = look.colour.loss;
    const placed = losses
      .filter(({ t1 }) => t1 >= strip.t0)
      .map(({ t0, t1 }) => [xOf(strip, t0), xOf(strip, t1)] as const);
    for (const { from, to, share } of lossMarks(placed, MARK_PX)) {
      x.globalAlpha = share;
      x.fillRect(Math.max(strip.left, from), y, to - Math.max(strip.left, from), height);
    }
    x.globalAlpha = 1;
    drawMarkers(
      x,
      markers.map(({ time }) => ({ time, text: "" })),
      strip,
      look,
      2,
      y + height,
    );
    this.#box(x, sheet, strip, w, look);
    this.#labels(x, sheet, strip, w, look, length);
  }

  #bars(x: CanvasRenderingContext2D, strip: TimeWindow, look: Palette, y: number, height: number): void {
    const columns = this.#columns;
    if (columns === undefined) return;
    columns.prepare(strip.g0, strip.g1, strip.dt, strip.base);
    const [lo, hi, mask] = [columns.lo[0]!, columns.hi[0]!, columns.mask];
    const seen: number[] = [];
    for (let g = strip.g0; g < strip.g1; g++) if (lo[g & mask]! <= hi[g & mask]!) seen.push(g & mask);
    if (seen.length === 0) return;
    // one jolt must not flatten an hour: the scale fits all but the largest bars, which are clipped at its edge
    const least = quantile(
      seen.map((slot) => lo[slot]!),
      OUTLIER_SHARE,
    );
    const most = quantile(
      seen.map((slot) => hi[slot]!),
      1 - OUTLIER_SHARE,
    );
    const k = height / Math.max(most - least, 1e-12);
    const within = (v: number): number => Math.min(height, Math.max(0, (most - v) * k));
    const step = strip.width / (strip.g1 - strip.g0);
    x.fillStyle = look.colour["ink-3"];
    x.globalAlpha = 0.75;
    for (let g = strip.g0, px = strip.left; g < strip.g1; g++, px += step) {
      const [a, b] = [lo[g & mask]!, hi[g & mask]!];
      if (a <= b) x.fillRect(px, y + within(b), Math.max(step * 0.8, 0.5), Math.max(1.4, within(a) - within(b)));
    }
    x.globalAlpha = 1;
  }

  #box(x: CanvasRenderingContext2D, sheet: CanvasLayer, strip: TimeWindow, w: TimeWindow, look: Palette): void {
    const from = Math.max(strip.left, xOf(strip, w.t0));
    const to = Math.min(strip.left + strip.width, xOf(strip, w.t1));
    const width = Math.max(4, to - from);
    x.fillStyle = x.strokeStyle = look.colour.ink;
    x.lineWidth = 1.25;
    x.globalAlpha = 0.09;
    x.fillRect(to - width, 2.5, width, sheet.height - 16);
    x.globalAlpha = 1;
    x.beginPath();
    x.roundRect(to - width + 0.5, 2.5, width - 1, sheet.height - 16, 2);
    x.stroke();
  }

  #labels(
    x: CanvasRenderingContext2D,
    sheet: CanvasLayer,
    strip: TimeWindow,
    w: TimeWindow,
    look: Palette,
    length: number,
  ): void {
    const y = sheet.height - 7;
    const right = strip.left + strip.width;
    setFont(x, look, 10.5);
    x.textBaseline = "middle";
    x.textAlign = "left";
    x.fillStyle = look.colour["ink-3"];
    if (!look.narrow) x.fillText(TEXT.inMemory, 16, 6 + (sheet.height - 20) / 2);
    const behind = w.now - w.t1;
    const say = w.live || behind < BEHIND_S ? "now" : behindWords(behind);
    const room = x.measureText(say).width + 12;
    const step = MARK_STEPS.find((seconds) => length / seconds <= MAX_MARKS) ?? length / MAX_MARKS;
    for (let t = step; t <= length * 1.001; t += step) {
      const px = right - (t / length) * strip.width;
      x.textAlign = px - strip.left < 24 ? "left" : "center";
      if (px + 24 < right - room) x.fillText(ago(t), px, y);
    }
    x.textAlign = "right";
    x.fillStyle = look.colour.ink;
    x.fillText(say, right, y);
  }
}

function quantile(values: number[], part: number): number {
  return values.sort((a, b) => a - b)[Math.round(part * (values.length - 1))] ?? 0;
}

function behindWords(seconds: number): string {
  return seconds < 60
    ? TEXT.secondsBehind(number(seconds, 1))
    : TEXT.minutesBehind(number(Math.floor(seconds / 60), 0), number(Math.floor(seconds % 60), 0));
}
