/** Moments as a person types them: a time of day in UTC, with or without its date, or one relative to the cursor. */

const RELATIVE = /^([+\-−])\s*(\d+(?:\.\d*)?|\.\d+)\s*(ms|s|min|h)?$/;
const CLOCK = /^(?:(\d{4}-\d{2}-\d{2})[T ])?(\d{1,2}):(\d{2})(?::(\d{2}(?:\.\d*)?))?\s*(?:Z|UTC)?$/;
const UNIX = /^\d{9,10}(?:\.\d*)?$/;
const SECONDS: Readonly<Record<string, number>> = { ms: 1e-3, s: 1, min: 60, h: 3600 };
const DAY_S = 86_400;

/**
 * The moment that a text means, unix s; undefined if it means none.
 *
 * @param from what a relative time is counted from; a time without its date is on that day
 */
export function momentOf(text: string, from: number): number | undefined {
  const typed = text.trim();
  if (UNIX.test(typed)) return Number(typed);
  const relative = RELATIVE.exec(typed);
  if (relative !== null) {
    const [, sign, amount, unit = "s"] = relative;
    return from + (sign === "+" ? 1 : -1) * Number(amount) * (SECONDS[unit] ?? 1);
  }
  const clock = CLOCK.exec(typed);
  if (clock === null) return undefined;
  const [, date, hours, minutes, seconds = "0"] = clock;
  const time = [Number(hours), Number(minutes), Number(seconds)] as const;
  if (time[0] > 23 || time[1] > 59 || time[2] >= 60) return undefined;
  const day = date === undefined ? Math.floor(from / DAY_S) * DAY_S : Date.parse(`${date}T00:00:00Z`) / 1000;
  return Number.isFinite(day) ? day + time[0] * 3600 + time[1] * 60 + time[2] : undefined;
}

/** The first of some times after `t`, or the last before it; undefined if there is none. */
export function neighbour(times: readonly number[], t: number, forward: boolean): number | undefined {
  const beyond = times.filter((one) => (forward ? one > t + SAME_S : one < t - SAME_S));
  return beyond.length === 0 ? undefined : beyond.reduce((a, b) => (forward ? Math.min(a, b) : Math.max(a, b)));
}

/** Times closer than this are the same: twice the resolution of a unix time in a 64-bit float, s. */
const SAME_S = 1e-6;

/** Where a mistake is in an expression, as the server says: "… (character 6)"; from there to the end of the word. */
export function mistakeIn(text: string, message: string): readonly [number, number] | undefined {
  const at = Number(/\(character (\d+)\)/.exec(message)?.[1] ?? NaN) - 1;
  if (!(at >= 0 && at <= text.length)) return undefined;
  const word = /^[\p{L}_][\w.]*|^[\d.]+|^./u.exec(text.slice(at))?.[0] ?? "";
  return [at, at + Math.max(1, word.length)];
}
