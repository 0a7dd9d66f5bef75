/** A histogram as displayed, from the figures of the server. */
import type { Wanted } from "../../measure/figure-source";
import { inFrame } from "../../data/frames";
import type { SignalFigures } from "../../wire/routes";

export interface Bins {
  /** One more than bins, ascending. */
  readonly edges: readonly number[];
  readonly counts: readonly number[];
  readonly density: readonly number[];
  readonly n: number;
  readonly below: number;
  readonly above: number;
  readonly mean: number;
  readonly sigma: number;
  readonly min: number;
  readonly max: number;
  readonly atMin: number;
  readonly atMax: number;
  readonly width: number;
  readonly notes: readonly string[];
}

const list = (value: unknown): readonly number[] => (Array.isArray(value) ? (value as readonly number[]) : []);
const finite = (value: unknown): number => (typeof value === "number" ? value : NaN);

/** @param wanted how the displayed signal was asked for: perhaps with another sign, or a multiple */
export function binsOf(figures: SignalFigures["figures"], { factor, offset, period }: Wanted): Bins {
  const turned = factor < 0;
  const put = (values: readonly number[]): readonly number[] => (turned ? values.toReversed() : values);
  const shown = (value: unknown): number => factor * finite(value) + offset;
  const size = Math.abs(factor);
  const [low, high] = [shown(figures["min"]), shown(figures["max"])];
  const ends = (a: string, b: string): readonly [number, number] =>
    turned ? [finite(figures[b]), finite(figures[a])] : [finite(figures[a]), finite(figures[b])];
  const [below, above] = ends("below", "above");
  const [atMin, atMax] = ends("at_min", "at_max");
  return {
    edges: put(list(figures["edges"]).map(shown)),
    counts: put(list(figures["counts"])),
    density: put(list(figures["density"])).map((value) => value / size),
    n: finite(figures["n"]),
    ...{ below, above, atMin, atMax },
    mean: inFrame({ terms: [[0, factor]], offset }, () => finite(figures["mean"]), period),
    sigma: size * finite(figures["sigma"]),
    min: Math.min(low, high),
    max: Math.max(low, high),
    width: size * finite(figures["width"]),
    notes: (figures["notes"] as readonly string[] | undefined) ?? [],
  };
}

/** Least share of samples at one extreme value that looks like a limit of the sensor. */
const MIN_CLIPPED_SHARE = 0.002;

/** Samples at an extreme value that occurs so often that the signal may be clipped there; 0 if it does not. */
export function clippedIn({ n, atMin, atMax, min, max }: Bins): number {
  if (!(max > min) || n < 1000) return 0;
  return [atMin, atMax].filter((times) => times >= MIN_CLIPPED_SHARE * n).reduce((sum, times) => sum + times, 0);
}

export function normal(x: number, mean: number, sigma: number): number {
  return Math.exp(-0.5 * ((x - mean) / sigma) ** 2) / (sigma * Math.sqrt(2 * Math.PI));
}
