/**
 * How often samples are needed: a page that draws five times a second on a slow machine, or not at all in a hidden tab, does not
 * need the hundred messages a second that a fast display shows. Requesting fewer saves load on the server, the network and the
 * page itself.
 *
 *     frames drawn in the last second ──▶ a quarter of the time between two ──▶ `interval` of server/wire/
 *
 * A quarter, so that the drawn data is never older by more than that. A display with 25 frames a second or more gets samples as often
 * as the server sends them.
 */

/** Between two measurements, ms. */
export const MEASURED_MS = 1000;
/** Interval if nothing is drawn; the server sends at least that often. */
const LONGEST_S = 0.1;
const BUSY_SHARE = 0.25;
/** Shorter intervals make no difference: the server collects samples for about this long. */
const SHORTEST_S = 0.01;

/** The interval for `frames` drawn within `seconds`, s; 0: as often as possible. */
export function intervalFor(frames: number, seconds: number): number {
  if (frames === 0) return LONGEST_S;
  const wanted = Math.min(LONGEST_S, (BUSY_SHARE * seconds) / frames);
  return wanted <= SHORTEST_S ? 0 : Math.round(100 * wanted) / 100;
}

/** Measure once a second and report every change; returns a function that stops it. */
export function watchSampleInterval(drawn: () => number, report: (seconds: number) => void): () => void {
  let before = drawn();
  let at = performance.now();
  let reported = 0;
  const timer = setInterval(() => {
    const now = performance.now();
    const count = drawn();
    const interval = intervalFor(count - before, (now - at) / 1000);
    before = count;
    at = now;
    if (interval === reported) return;
    reported = interval;
    report(interval);
  }, MEASURED_MS);
  return () => clearInterval(timer);
}
