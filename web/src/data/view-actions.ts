/**
 * What can a person do to the view? Every key, button and gesture calls one of these; each is a step from one view to the next.
 * They change the signals of view-state.ts and nothing else. What they must know of the data (the server's clock, what is in memory,
 * the samples around a time, the series on screen) they ask of the `Horizon` that the plots attach.
 */
import { cursor, hidden, measure, view, type View } from "./view-state";

/** What the view moves over. */
export interface Horizon {
  /** The server's clock, unix s. */
  now(): number;
  /** First and last moment in memory for the selected device; undefined when there is none. */
  bounds(): { readonly first: number; readonly last: number } | undefined;
  /** Time of the sample `steps` samples after (before, if negative) time t; undefined at the ends. */
  step(t: number, steps: number): number | undefined;
  /** Keys of the series on screen, in the order in which digits name them. */
  series(): readonly string[];
  /** Keys of the series in the same plot as this one. */
  beside(key: string): readonly string[];
}

/** Shortest and longest window, s: 5 ms shows single samples at 2 kHz, a day is more than any ring holds. */
export const SHORTEST = 0.005;
export const LONGEST = 86_400;

let horizon: Horizon = { now: () => Date.now() / 1000, bounds: () => undefined, step: () => undefined, series: () => [], beside: () => [] };

/** The plots say over what the view moves. */
export function attach(to: Horizon): void {
  horizon = to;
}

/** Right edge of the window, unix s. */
export function rightEdge(of: View = view.peek()): number {
  return of.live ? horizon.now() : of.end;
}

/** Is all of memory on screen, and to stay so while it grows? Until the view is changed otherwise. */
let fitted = false;

function change(part: Partial<View>): void {
  fitted = false;
  view.value = { ...view.peek(), ...part };
}

/** Keep the window where there is something to see: not after now, not wholly before the first sample. */
function clamped(end: number, span: number): number {
  const first = horizon.bounds()?.first ?? -Infinity;
  return Math.min(Math.max(end, first + span / 10), horizon.now());
}

const spanOf = (seconds: number): number => Math.min(LONGEST, Math.max(SHORTEST, seconds));

/** Freeze the view where it is. */
export function pause(): void {
  if (view.peek().live) change({ live: false, end: horizon.now() });
}

/** Follow the newest sample again. */
export function live(): void {
  change({ live: true });
}

/** Move by `windows` window lengths; back is negative. Moving back from live pauses; nothing moves past now. */
export function pan(windows: number): void {
  const now = view.peek();
  if (now.live && windows >= 0) return;
  change({ live: false, end: clamped(rightEdge(now) + windows * now.span, now.span) });
}

/** Put the right edge at `end`, as dragging does; at now the view stays paused: only `live` goes live. */
export function panTo(end: number): void {
  const { span } = view.peek();
  change({ live: false, end: clamped(end, span) });
}

/** Multiply the window's length by `factor`, keeping the moment at fraction `at` of its width. Live stays live: now is the right edge. */
export function zoom(factor: number, at = 0.5): void {
  const now = view.peek();
  const span = spanOf(now.span * factor);
  if (now.live) return change({ span });
  const fixed = now.end - (1 - at) * now.span;
  change({ span, end: clamped(fixed + (1 - at) * span, span) });
}

/** Show t0…t1 and stay there. */
export function select(t0: number, t1: number): void {
  const [a, b] = t0 < t1 ? [t0, t1] : [t1, t0];
  if (b - a > 0) change({ live: false, end: b, span: spanOf(b - a) });
}

/** Show everything in memory. */
export function fit(): void {
  const bounds = horizon.bounds();
  if (bounds === undefined) return;
  if (view.peek().live) {
    change({ span: spanOf((horizon.now() - bounds.first) * 1.01) });
    fitted = true;
    return;
  }
  change({ end: bounds.last, span: spanOf((bounds.last - bounds.first) * 1.01) });
}

/** While everything in memory is shown live, show more as more comes: by steps, so that nothing crawls. */
export function keepFitted(): void {
  const bounds = horizon.bounds();
  if (!fitted || bounds === undefined || !view.peek().live) return;
  const held = horizon.now() - bounds.first;
  if (held > view.peek().span) {
    change({ span: spanOf(held * 1.1) });
    fitted = true;
  }
}

export function setSpan(seconds: number): void {
  if (Number.isFinite(seconds)) change({ span: spanOf(seconds) });
}

/** Put the window's middle at `t`. */
export function centreAt(t: number): void {
  const { span } = view.peek();
  change({ live: false, end: clamped(t + span / 2, span) });
}

/** To the oldest moment in memory. */
export function toStart(): void {
  const bounds = horizon.bounds();
  const { span } = view.peek();
  if (bounds !== undefined) change({ live: false, end: Math.min(bounds.first + span, horizon.now()) });
}

export function toggleTimeBase(): void {
  change({ timeBase: view.peek().timeBase === "device" ? "arrival" : "device" });
}

/** Hide or show the series with that key; `alone`: of its plot show only it, or all again when it is alone already. */
export function toggleKey(key: string, alone = false): void {
  const all = horizon.beside(key);
  const was = hidden.peek();
  const next = new Set(was);
  if (!alone) {
    if (!next.delete(key)) next.add(key);
  } else if (!was.has(key) && all.every((other) => other === key || was.has(other))) {
    for (const other of all) next.delete(other);
  } else {
    for (const other of all) next.add(other);
    next.delete(key);
  }
  hidden.value = next;
}

/** As `toggleKey`, for the series that stands at place `index` on screen, from 0. */
export function toggleSeries(index: number, alone = false): void {
  const key = horizon.series()[index];
  if (key !== undefined) toggleKey(key, alone);
}

/** Where the cursor reads, unix s; undefined when there is none. */
export function cursorTime(): number | undefined {
  const at = cursor.peek();
  if (at === undefined) return undefined;
  if (at.kind === "pinned") return at.time;
  const now = view.peek();
  return rightEdge(now) - (1 - at.fraction) * now.span;
}

/** Pin the cursor one sample on (or back); the view follows when it would leave the window. */
export function stepSample(samples: number): void {
  const now = view.peek();
  const t = horizon.step(cursorTime() ?? rightEdge(now), samples);
  if (t === undefined) return;
  pause();
  cursor.value = { kind: "pinned", time: t };
  const end = rightEdge();
  if (t > end) change({ end: clamped(t, now.span) });
  else if (t < end - now.span) change({ end: t + now.span });
}

export function pin(time: number): void {
  cursor.value = { kind: "pinned", time };
}

/** Pin the second cursor, for measuring. */
export function pinMeasure(time: number): void {
  measure.value = time;
}

/** Live, a pin moves left with the data; one that has left the window is taken away: nothing reads what is not to be seen. */
export function dropPassed(): void {
  const now = view.peek();
  if (!now.live) return;
  const first = rightEdge(now) - now.span;
  const at = cursor.peek();
  if (at?.kind === "pinned" && at.time < first) cursor.value = undefined;
  if ((measure.peek() ?? Infinity) < first) measure.value = undefined;
}

/** On which side of the window the cursor is that reads; undefined when it is in it, or there is none. */
export function cursorBeside(): "before" | "after" | undefined {
  const at = cursor.peek();
  if (at?.kind !== "pinned") return undefined;
  const now = view.peek();
  const end = rightEdge(now);
  return at.time > end ? "after" : at.time < end - now.span ? "before" : undefined;
}

/** Take both pins away. */
export function unpin(): void {
  cursor.value = undefined;
  measure.value = undefined;
}
