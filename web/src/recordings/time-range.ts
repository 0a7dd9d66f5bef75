/**
 * The range of a recording to request, and whether the loaded one suffices. Pure. The range on screen is requested with a margin on
 * both sides, so that panning and playing find samples there; zooming in is answered from coarser rows at once, and by finer ones
 * as soon as they come.
 */
import type { ChannelInfo } from "../wire/types";

/** A time range, summarised to at most `width` intervals. */
export interface Stretch {
  readonly t0: number;
  readonly t1: number;
  readonly width: number;
}

export interface Bounds {
  readonly first: number;
  readonly last: number;
}

/** Margin on either side of the window, in windows. */
const MARGIN_SHARE = 0.5;
/** Rows this much coarser than the screen look the same. */
const COARSER_RATIO = 1.3;
/** Seconds of playback fetched ahead. */
const AHEAD_S = 0.8;
/** The server's most. */
const MAX_WIDTH = 8000;

/** The request for the window t0…t1, `pixels` wide, played `speed` times as fast (0: it stands still). */
export function stretchFor(t0: number, t1: number, pixels: number, speed: number, { first, last }: Bounds): Stretch {
  const span = t1 - t0;
  const ahead = Math.max(MARGIN_SHARE * span, 2 * AHEAD_S * speed);
  const from = Math.max(t0 - MARGIN_SHARE * span, Math.min(first, t0));
  const to = Math.min(t1 + ahead, Math.max(last, t1));
  return { t0: from, t1: to, width: Math.min(MAX_WIDTH, Math.max(1, Math.ceil((pixels * (to - from)) / span))) };
}

/** Whether `held` shows t0…t1 at screen resolution, for a while. */
export function isEnough(
  held: Stretch | undefined,
  exact: boolean,
  t0: number,
  t1: number,
  pixels: number,
  speed: number,
  { first, last }: Bounds,
): boolean {
  if (held === undefined) return false;
  const [from, to] = [Math.max(t0, first), Math.min(t1 + AHEAD_S * speed, last)];
  if (held.t0 > from || held.t1 < to) return from >= last || to <= first; // beyond the ends there is nothing to show
  return exact || ((held.t1 - held.t0) / held.width) * pixels <= COARSER_RATIO * (t1 - t0);
}

/** Samples around a moment, of one group of channels with similar rates. */
export interface Near {
  readonly channels: readonly number[];
  readonly before: number;
  readonly after: number;
}

/** Spacings up to these, s, form a group; slower channels are searched further back. */
const PACES: readonly number[] = [0.02, 0.25, 2, Infinity];
/** Range requested for each group: a moment for fast ones, until one is found for slow ones. */
const REACH_S: readonly number[] = [1.5, 10, 120, 7200];

/** The requests needed to read every channel at a moment: one for each group. */
export function nearOf(channels: readonly ChannelInfo[], usual: Readonly<Record<string, number>>): readonly Near[] {
  const groups = PACES.map((): number[] => []);
  for (const { id } of channels) {
    const spacing = usual[String(id)] ?? 0;
    groups[spacing > 0 ? PACES.findIndex((pace) => spacing <= pace) : PACES.length - 1]?.push(id);
  }
  return groups.flatMap((ids, k) =>
    ids.length > 0 ? [{ channels: ids, before: REACH_S[k]!, after: REACH_S[k]! }] : [],
  );
}
