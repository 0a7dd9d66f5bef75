/** When does a viewer that follows a player have to be told where it reads? Pure. */

/** Where it is read (unix s), how fast that moves on (recorded seconds in a second), and when that was so (s, any clock). */
export interface Told {
  readonly t: number;
  readonly rate: number;
  readonly at: number;
}

/** Said again after so long although nothing is new, s: two clocks do not run alike. */
const AGAIN_S = 1;
/** Not more often than that while a person drags, s. */
const PACE_S = 1 / 30;
/** Further from where it would have moved by itself than this, in a person's time, is news, s. */
const OFF_S = 0.05;

/** What to say now, undefined when the viewer knows as much. */
export function headNews(told: Told | undefined, now: Told): Told | undefined {
  if (!told) return now;
  const since = now.at - told.at;
  if (now.rate !== told.rate) return now;
  if (since < PACE_S) return undefined;
  const expected = told.t + since * told.rate;
  const off = Math.abs(now.t - expected);
  if (off > (now.rate === 0 ? 0 : OFF_S * now.rate)) return now;
  return now.rate !== 0 && since >= AGAIN_S ? now : undefined;
}
