/**
 * Which moment do the panels read? Live they read the newest sample; a pinned cursor, or the pointer while paused, makes them
 * read there; paused with no cursor they read the right edge of the window. One answer, so that instruments, values and
 * plots never tell of different moments.
 */
import type { Cursor, View } from "../data/view-state";

export interface Reading {
  /** Server clock, unix seconds: samples at or before this are read. Infinity: the newest there is. */
  readonly time: number;
  /** What the head of a column says. */
  readonly word: "now" | "cursor" | "paused";
  /** The window over which mean and σ are taken, unix seconds. */
  readonly from: number;
  readonly to: number;
}

export function readingAt(view: View, cursor: Cursor, now: number): Reading {
  const to = view.live ? now : view.end;
  const from = to - view.span;
  if (cursor?.kind === "pinned") return { time: cursor.time, word: "cursor", from, to };
  if (view.live) return { time: Number.POSITIVE_INFINITY, word: "now", from, to };
  if (cursor) return { time: from + cursor.fraction * view.span, word: "cursor", from, to };
  return { time: to, word: "paused", from, to };
}
