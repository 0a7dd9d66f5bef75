/**
 * The moment read by the panels. Live they read the newest sample; a pinned cursor, or the pointer while paused, makes them
 * read there; paused with no cursor they read the right edge of the window. Computed in one place, so that instruments, values
 * and plots always show the same moment.
 */
import type { Cursor, TimeBase, View } from "./view";

export interface CursorReading {
  /** Server clock, unix seconds: samples at or before this are read. Infinity: the newest there is. */
  readonly time: number;
  /** Word in the head of a column. */
  readonly word: "now" | "cursor" | "paused";
  /** Cursor A, if it is pinned there. */
  readonly mark?: "A";
  /** The stretch over which mean and σ are taken, unix seconds: the window, or what is between both cursors. */
  readonly from: number;
  readonly to: number;
  /** Whether the moment is beside the window: what reads it says so. */
  readonly isOffScreen: boolean;
  /** The clock of these times. */
  readonly base: TimeBase;
}

/** @param second the cursor B, while it measures */
export function readingAt(view: View, cursor: Cursor, now: number, second?: number): CursorReading {
  const to = view.live ? now : view.end;
  const from = to - view.span;
  const window = { from, to, base: view.timeBase, isOffScreen: false };
  if (cursor?.kind === "pinned") {
    const { time } = cursor;
    const between = second === undefined ? {} : { from: Math.min(time, second), to: Math.max(time, second) };
    return { ...window, ...between, time, word: "cursor", mark: "A", isOffScreen: time < from || time > to };
  }
  if (view.live) return { ...window, time: Number.POSITIVE_INFINITY, word: "now" };
  if (cursor) return { ...window, time: from + cursor.fraction * view.span, word: "cursor" };
  return { ...window, time: to, word: "paused" };
}
