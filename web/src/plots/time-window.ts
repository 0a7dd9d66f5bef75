/**
 * The time window on screen and the mapping of times to pixels. Computed once per frame and shared by plots, lanes, axis and cursor, so
 * that everything moves together.
 *
 * The window moves in whole device pixels: its right edge is a multiple of `dt`, the time covered by one pixel. Pixel `g` always holds
 * the times g·dt … (g+1)·dt, whichever frame draws it. So the extremes of a pixel are computed once and kept while it crosses the
 * screen, and a live trace does not shimmer as its samples change pixels.
 */
import type { TimeBase, View } from "../data/view";

export interface TimeWindow {
  /** Left and right edge, unix s. */
  readonly t0: number;
  readonly t1: number;
  readonly span: number;
  readonly base: TimeBase;
  readonly live: boolean;
  /** Server's clock, unix s. */
  readonly now: number;
  /** Seconds per device pixel, and the pixels g0 ≤ g < g1 on screen. */
  readonly dt: number;
  readonly g0: number;
  readonly g1: number;
  /** Left edge and width of the plot area, CSS px. */
  readonly left: number;
  readonly width: number;
  readonly ratio: number;
}

/** The window of a view, drawn `width` CSS px wide from `left`. */
export function timeWindow(view: View, now: number, left: number, width: number, ratio: number): TimeWindow {
  const pixels = Math.max(1, Math.round(width * ratio));
  const dt = view.span / pixels;
  const g1 = Math.ceil((view.live ? now : view.end) / dt);
  const g0 = g1 - pixels;
  const { span, timeBase: base, live } = view;
  return { t0: g0 * dt, t1: g1 * dt, span, base, live, now, dt, g0, g1, left, width, ratio };
}

/** Position of time t, CSS px from the left of the stack. */
export function xOf(w: TimeWindow, t: number): number {
  return w.left + ((t - w.t0) / w.span) * w.width;
}

export function timeAt(w: TimeWindow, x: number): number {
  return w.t0 + ((x - w.left) / w.width) * w.span;
}
