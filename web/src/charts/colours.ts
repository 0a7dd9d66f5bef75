/** Colours of a picture of figures: from dark to bright without a step, also for the colour-blind and in grey. */

/** The stops, evenly spaced, as red, green and blue. */
type Colour = readonly [red: number, green: number, blue: number];
const DARK: Colour = [13, 8, 52];
const BRIGHT: Colour = [250, 245, 170];
const STOPS: readonly Colour[] = [
  DARK,
  [62, 15, 110],
  [116, 30, 116],
  [170, 48, 103],
  [219, 77, 74],
  [246, 128, 42],
  [252, 186, 56],
  BRIGHT,
];

/** The colour at a share of the scale, 0 to 1. */
export function colourAt(share: number): Colour {
  const place = Math.min(1, Math.max(0, share)) * (STOPS.length - 1);
  const below = Math.min(STOPS.length - 2, Math.floor(place));
  const part = place - below;
  const [from, to] = [STOPS[below] ?? DARK, STOPS[below + 1] ?? BRIGHT];
  const mixed = (k: 0 | 1 | 2): number => Math.round(from[k] + (to[k] - from[k]) * part);
  return [mixed(0), mixed(1), mixed(2)];
}

export interface ColourScale {
  readonly low: number;
  readonly high: number;
}

/** The densest part is bright; the scale reaches this far below it, as a ratio of power: 60 dB. */
const MAX_RATIO = 1e6;
/** Share of figures that the dark end leaves out: an empty bin must not stretch the scale. */
const DARK_QUANTILE = 0.02;

/** The scale of positive figures, logarithmic; undefined without any. */
export function scaleOf(figures: Iterable<number | null>, isRoot: boolean): ColourScale | undefined {
  const known = [...figures].filter((one): one is number => one !== null && one > 0).sort((a, b) => a - b);
  const [high, dark] = [known.at(-1), known[Math.floor(known.length * DARK_QUANTILE)]];
  if (high === undefined || dark === undefined) return undefined;
  const low = Math.max(dark, high / (isRoot ? Math.sqrt(MAX_RATIO) : MAX_RATIO));
  return low < high ? { low, high } : { low: high / 2, high };
}

/** Where a figure lies on a scale, 0 to 1. */
export function shareOf({ low, high }: ColourScale, figure: number | null): number {
  if (figure === null || !(figure > 0)) return 0;
  return Math.min(1, Math.max(0, Math.log(figure / low) / Math.log(high / low)));
}
