/** Position updates for a viewer that follows a player. Pure. */

/** Reading position (unix s), its speed (recorded seconds per second), and the time of this state (s, any clock). */
export interface SentHead {
  readonly t: number;
  readonly rate: number;
  readonly at: number;
}

/** Repeated after this long without changes, s: two clocks drift. */
const AGAIN_S = 1;
/** Least interval while the user drags, s. */
const PACE_S = 1 / 30;
/** Deviation from the expected position that is sent at once, in real time, s. */
const OFF_S = 0.05;

/** The update to send now; undefined if the viewer is up to date. */
export function headNews(sent: SentHead | undefined, now: SentHead): SentHead | undefined {
  if (!sent) return now;
  const since = now.at - sent.at;
  if (now.rate !== sent.rate) return now;
  if (since < PACE_S) return undefined;
  const expected = sent.t + since * sent.rate;
  const off = Math.abs(now.t - expected);
  if (off > (now.rate === 0 ? 0 : OFF_S * now.rate)) return now;
  return now.rate !== 0 && since >= AGAIN_S ? now : undefined;
}
