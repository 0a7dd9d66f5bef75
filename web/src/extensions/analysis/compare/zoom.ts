/** Zooming and moving along the time of a comparison: arithmetic of ranges, s after the beginning of A. */

export type Ends = readonly [from: number, to: number];

/** The shortest range, as a share of everything: the outlines have no more points. */
const SHORTEST = 1 / 400;
/** Change of the length per px of wheel, as on the plots. */
const ZOOM_PER_PX = 0.0015;
/** Change of the length per key. */
const ZOOM_PER_KEY = 1.5;

const within = ([from, to]: Ends, [first, last]: Ends): Ends => {
  const length = Math.min(to - from, last - first);
  const begin = Math.min(Math.max(from, first), last - length);
  return [begin, begin + length];
};

/** The range around the moment at share `at` of it, `factor` times as long, within everything. */
export function zoomedRange(shown: Ends, all: Ends, factor: number, at: number): Ends {
  const length = Math.min(Math.max((shown[1] - shown[0]) * factor, (all[1] - all[0]) * SHORTEST), all[1] - all[0]);
  const kept = shown[0] + at * (shown[1] - shown[0]);
  return within([kept - at * length, kept + (1 - at) * length], all);
}

/** The range moved by a share of its length. */
export function panned(shown: Ends, all: Ends, share: number): Ends {
  const by = share * (shown[1] - shown[0]);
  return within([shown[0] + by, shown[1] + by], all);
}

/** What the wheel does: zooms about the pointer, or moves if it is turned sideways or with Shift. */
export function wheeled(
  shown: Ends,
  all: Ends,
  { deltaX, deltaY, shiftKey }: Pick<WheelEvent, "deltaX" | "deltaY" | "shiftKey">,
  at: number,
): Ends {
  if (shiftKey || Math.abs(deltaX) > Math.abs(deltaY)) return panned(shown, all, (deltaX || deltaY) / 800);
  return zoomedRange(shown, all, Math.exp(ZOOM_PER_PX * deltaY), at);
}

/** What a key does; undefined: it is no key of zooming. */
export function keyed(shown: Ends, all: Ends, key: string): Ends | undefined {
  if (key === "+" || key === "=") return zoomedRange(shown, all, 1 / ZOOM_PER_KEY, 0.5);
  if (key === "-" || key === "−") return zoomedRange(shown, all, ZOOM_PER_KEY, 0.5);
  if (key === "f" || key === "0") return all;
  return undefined;
}
