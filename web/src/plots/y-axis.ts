/**
 * What a person chose for the y axis of a plot, and the arithmetic of zooming it. A range is given in the plot's unit; on a logarithmic
 * axis it is zoomed and moved by ratios.
 */
import type { YAxis } from "../data/view";
import { figure } from "../charts/axes";

export type YRange = readonly [low: number, high: number];

/** The narrowest range, as a part of its middle: about the resolution of a 32-bit float. */
const MIN_RELATIVE_SPAN = 1e-6;
const MAX_MAGNITUDE = 1e15;

const into = (value: number, isLog: boolean): number => (isLog ? Math.log10(value) : value);
const back = (value: number, isLog: boolean): number => (isLog ? 10 ** value : value);

/** The range around the value at share `at` of it (0 is the low end), `factor` times as wide. */
export function zoomed([low, high]: YRange, factor: number, at: number, isLog: boolean): YRange {
  const [a, b] = [into(low, isLog), into(high, isLog)];
  const kept = a + at * (b - a);
  return usable(
    [back(kept - at * (b - a) * factor, isLog), back(kept + (1 - at) * (b - a) * factor, isLog)],
    [low, high],
  );
}

/** The range moved by a share of its width. */
export function shifted([low, high]: YRange, by: number, isLog: boolean): YRange {
  const [a, b] = [into(low, isLog), into(high, isLog)];
  const d = by * (b - a);
  return usable([back(a + d, isLog), back(b + d, isLog)], [low, high]);
}

function usable(next: YRange, now: YRange): YRange {
  const [low, high] = next;
  const size = Math.max(Math.abs(low), Math.abs(high));
  return high - low > MIN_RELATIVE_SPAN * size && size < MAX_MAGNITUDE ? next : now;
}

/** The axis with a range that is typed; a text says what is wrong with it. */
export function typedRange(low: string, high: string): YRange | "number" | "order" {
  const [a, b] = [low, high].map((text) => {
    const plain = text.trim().replace("−", "-").replace(",", ".");
    return plain === "" ? NaN : Number(plain);
  });
  if (a === undefined || b === undefined || !Number.isFinite(a) || !Number.isFinite(b)) return "number";
  return a < b ? [a, b] : "order";
}

/** Whether the axis is drawn logarithmic: wished for, and every value and the range are positive. */
export function isLogarithmic(axis: YAxis | undefined, lowest: number): boolean {
  return axis?.isLog === true && lowest > 0 && (axis.range === undefined || axis.range[0] > 0);
}

/** Labelled values of a logarithmic axis between two powers: decades, and with few of them 2 and 5, too. */
export function logTicks(low: number, high: number): readonly { readonly value: number; readonly text: string }[] {
  const digits = high - low < 3 ? [1, 2, 5] : [1];
  const every = Math.max(1, Math.ceil((high - low) / 6));
  const found: number[] = [];
  for (let power = Math.floor(low); power <= high; power++)
    if (power % every === 0) found.push(...digits.map((digit) => digit * 10 ** power));
  return found
    .filter((value) => Math.log10(value) >= low && Math.log10(value) <= high)
    .map((value) => ({ value, text: figure(value) }));
}
