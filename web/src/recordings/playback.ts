/** Playback state of a recording: position, speed, loop, following. Pure steps from one state to the next. */
import type { Bounds } from "./time-range";

export const SPEEDS: readonly number[] = [0.1, 0.25, 0.5, 1, 2, 5, 10, 50];

export interface Playing {
  /** Reading position, unix s. */
  readonly head: number;
  readonly playing: boolean;
  readonly speed: number;
  /** Range played repeatedly, unix s; undefined: to the end, once. */
  readonly loop: readonly [number, number] | undefined;
  readonly looping: boolean;
}

/** After `seconds` of real time. */
export function advance(now: Playing, seconds: number, { first, last }: Bounds): Playing {
  if (!now.playing || !(seconds > 0)) return now;
  const head = now.head + seconds * now.speed;
  const range = now.looping ? now.loop : undefined;
  if (range) {
    const [a, b] = range;
    // a loop is entered by playing into it; at its end it starts over, keeping the excess
    if (now.head <= b && head > b) return { ...now, head: a + ((head - b) % Math.max(b - a, 1e-6)) };
  }
  return head < last ? { ...now, head: Math.max(head, first) } : { ...now, head: last, playing: false };
}

/** Start playing; from the end it starts at the beginning. */
export function begin(now: Playing, { first, last }: Bounds): Playing {
  const [a, b] = (now.looping ? now.loop : undefined) ?? [first, last];
  const over = now.head >= b - 1e-6;
  return { ...now, playing: true, head: over || now.head < first ? a : now.head };
}

/**
 * The window's right edge when the head moves from `was` to `head`: the head keeps its place on screen; one that was off screen gets a
 * place with more past than future.
 */
export function followed(end: number, span: number, was: number, head: number): number {
  const fraction = (was - (end - span)) / span;
  const place = fraction >= 0 && fraction <= 1 ? fraction : 0.7;
  return head + (1 - place) * span;
}
