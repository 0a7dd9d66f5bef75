/**
 * The overlay: one transparent layer over all plots and lanes, with the hatch over missing data, markers, the cursor, and the measured
 * or selected interval. It is redrawn when the pointer moves, while the traces under it stay.
 */
import type { Loss } from "../data/losses";
import type { MarkLayer } from "./plot-additions";
import { drawMarkers, type MarkLine } from "./markers";
import { lossMarks } from "./loss-marks";
import { type Palette, type CanvasLayer, hatch, setFont } from "./canvas-style";
import type { Plot } from "./plot";
import { valueAt } from "./legend";
import type { Reads } from "../data/view";
import { xOf, type TimeWindow } from "./time-window";

/** A loss is at least this wide (design, "Loss"), px. */
const LOSS_PX = 2;

/** A pane under the overlay, CSS px from the stack's top. */
export interface Pane {
  readonly top: number;
  readonly bottom: number;
}

interface Marks {
  readonly losses: readonly Loss[];
  /** The device is gone: nothing arrived since then. */
  readonly lostSince: number | undefined;
  /** Cursor position, unix s. */
  readonly cursor: number | undefined;
  readonly measure: number | undefined;
  /** Interval being selected with shift and drag. */
  readonly selection: readonly [number, number] | undefined;
  readonly reads: Reads;
  readonly markers: readonly MarkLine[];
  readonly layers: readonly MarkLayer[];
}

/** Whether there is nothing to draw: usually, while a device streams without loss and the pointer is elsewhere. */
export function isBare({ t0, t1 }: TimeWindow, marks: Marks): boolean {
  const before = t0 - (t1 - t0); // words of a marker reach into the window
  return (
    marks.cursor === undefined &&
    marks.measure === undefined &&
    marks.selection === undefined &&
    (marks.lostSince === undefined || marks.lostSince >= t1) &&
    marks.layers.every((layer) => layer.isBare()) &&
    !marks.losses.some((loss) => loss.t1 >= before && loss.t0 <= t1) &&
    !marks.markers.some(({ time }) => time >= before && time <= t1)
  );
}

export function drawGlass(
  sheet: CanvasLayer,
  panes: readonly Pane[],
  plots: readonly Plot[],
  w: TimeWindow,
  look: Palette,
  marks: Marks,
  hidden: ReadonlySet<string>,
): void {
  const x = sheet.begin();
  const right = w.left + w.width;
  const clip = (px: number): number => Math.min(right, Math.max(w.left, px));
  const band = (from: number, to: number): void =>
    panes.forEach(({ top, bottom }) => x.fillRect(from, top, to - from, bottom - top));
  const line = (px: number, width: number): void => {
    if (px >= w.left && px <= right) band(sheet.snap(px), sheet.snap(px) + width);
  };
  x.fillStyle = hatch(x, look.colour.loss, 4);
  const shown = marks.losses.filter(({ t0, t1 }) => t1 >= w.t0 && t0 <= w.t1);
  const placed = shown.map(({ t0, t1 }) => [xOf(w, t0), xOf(w, t1)] as const);
  for (const { from, to, share } of lossMarks(placed, LOSS_PX)) {
    x.globalAlpha = 0.55 * share;
    band(clip(from), clip(to));
  }
  if (marks.lostSince !== undefined && marks.lostSince < w.t1) {
    const from = clip(xOf(w, marks.lostSince));
    x.globalAlpha = 0.3;
    x.fillStyle = hatch(x, look.colour.loss, 6);
    band(from, right);
    x.globalAlpha = 1;
    x.fillStyle = look.colour.loss;
    line(xOf(w, marks.lostSince), 1.5);
  }
  x.fillStyle = look.colour.yours;
  if (marks.selection !== undefined) {
    x.globalAlpha = 0.14;
    band(clip(xOf(w, Math.min(...marks.selection))), clip(xOf(w, Math.max(...marks.selection))));
  }
  x.globalAlpha = 1;
  const [first, last] = [panes[0], panes.at(-1)];
  if (first && last && marks.markers.length > 0) drawMarkers(x, marks.markers, w, look, first.top, last.bottom);
  for (const layer of marks.layers) layer.draw(x, plots, w, look, hidden);
  if (marks.measure !== undefined) drawMeasure(x, sheet, panes, w, look, marks, clip);
  if (marks.cursor === undefined) return;
  x.fillStyle = look.colour.ink;
  line(xOf(w, marks.cursor), 1);
  if (marks.measure !== undefined && first)
    for (const [name, t, colour] of [
      ["A", marks.cursor, "ink"],
      ["B", marks.measure, "yours"],
    ] as const)
      drawLetter(x, name, xOf(w, t), first.top, w, look, colour);
  dots(x, plots, w, look, marks.cursor, hidden, marks.reads);
}

function drawMeasure(
  x: CanvasRenderingContext2D,
  sheet: CanvasLayer,
  panes: readonly Pane[],
  w: TimeWindow,
  look: Palette,
  marks: Marks,
  clip: (px: number) => number,
): void {
  const at = xOf(w, marks.measure!);
  x.fillStyle = x.strokeStyle = look.colour.yours;
  if (marks.cursor !== undefined) {
    const other = xOf(w, marks.cursor);
    const [a, b] = [clip(Math.min(at, other)), clip(Math.max(at, other))];
    x.globalAlpha = 0.14;
    for (const { top, bottom } of panes) x.fillRect(a, top, b - a, bottom - top);
    x.globalAlpha = 1;
  }
  if (at < w.left || at > w.left + w.width) return;
  x.lineWidth = 1;
  x.setLineDash([3, 3]);
  x.beginPath();
  for (const { top, bottom } of panes) {
    x.moveTo(sheet.snap(at) + 0.5, top);
    x.lineTo(sheet.snap(at) + 0.5, bottom);
  }
  x.stroke();
  x.setLineDash([]);
}

/** Side of the box of a cursor's letter, px. */
const LETTER_PX = 14;

/** The letter of a cursor at its upper end. */
function drawLetter(
  x: CanvasRenderingContext2D,
  letter: string,
  px: number,
  top: number,
  w: TimeWindow,
  look: Palette,
  colour: "ink" | "yours",
): void {
  if (px < w.left - 1 || px > w.left + w.width + 1) return;
  const left = Math.min(Math.max(w.left, px - LETTER_PX / 2), w.left + w.width - LETTER_PX);
  x.fillStyle = look.colour[colour];
  x.fillRect(left, top, LETTER_PX, LETTER_PX);
  x.fillStyle = look.colour[colour === "ink" ? "bg" : "yours-ink"];
  x.textAlign = "center";
  x.textBaseline = "middle";
  setFont(x, look, 10.5, 650);
  x.fillText(letter, left + LETTER_PX / 2, top + LETTER_PX / 2 + 0.5);
}

/** A dot on each trace at the cursor. */
function dots(
  x: CanvasRenderingContext2D,
  plots: readonly Plot[],
  w: TimeWindow,
  look: Palette,
  t: number,
  hidden: ReadonlySet<string>,
  reads: Reads,
): void {
  const px = xOf(w, t);
  if (px < w.left || px > w.left + w.width) return;
  x.lineWidth = 1.5;
  x.strokeStyle = look.colour.bg;
  for (const plot of plots) {
    if (!plot.visible) continue;
    for (const series of plot.spec.series) {
      const value = hidden.has(series.key) ? NaN : valueAt(series, t, w.base, reads);
      if (value !== value) continue;
      const y = plot.y(value, series.isRight);
      if (!plot.shows(y, look)) continue;
      x.beginPath();
      x.arc(px, plot.top + y, 3, 0, 7);
      x.fillStyle = look.colour[series.colour];
      x.fill();
      x.stroke();
    }
  }
}
