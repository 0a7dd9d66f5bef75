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
  /** The window over which mean and σ are taken, unix seconds. */
  readonly from: number;
  readonly to: number;
  /** The clock of these times. */
  readonly base: TimeBase;
}

export function readingAt(view: View, cursor: Cursor, now: number): CursorReading {
  const to = view.live ? now : view.end;
  const from = to - view.span;
  const base = view.timeBase;
  if (cursor?.kind === "pinned") return { time: cursor.time, word: "cursor", from, to, base };
  if (view.live) return { time: Number.POSITIVE_INFINITY, word: "now", from, to, base };
  if (cursor) return { time: from + cursor.fraction * view.span, word: "cursor", from, to, base };
  return { time: to, word: "paused", from, to, base };
}
