/** Axes of a chart of figures: linear or logarithmic scales, their ticks, and curves thinned to what pixels can show. */

import { niceStep } from "./scale";

export type Kind = "linear" | "log";

export interface Axis {
  readonly kind: Kind;
  readonly low: number;
  readonly high: number;
}

/** The axis that holds all finite values; on a logarithmic one only positive ones count. Undefined without any. */
export function axisOf(kind: Kind, values: Iterable<number | null>): Axis | undefined {
  let low = Number.POSITIVE_INFINITY;
  let high = Number.NEGATIVE_INFINITY;
  for (const value of values) {
    if (value === null || !Number.isFinite(value) || (kind === "log" && value <= 0)) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (low > high) return undefined;
  if (low === high)
    return kind === "log" ? { kind, low: low / 2, high: high * 2 } : { kind, low: low - 1, high: high + 1 };
  return { kind, low, high };
}

/** Where a value lies on an axis: 0 at its low end, 1 at its high end; NaN where a logarithmic axis has no place for it. */
export function share(axis: Axis, value: number): number {
  if (axis.kind === "linear") return (value - axis.low) / (axis.high - axis.low);
  return value > 0 ? Math.log(value / axis.low) / Math.log(axis.high / axis.low) : NaN;
}

export function valueAtShare(axis: Axis, at: number): number {
  if (axis.kind === "linear") return axis.low + at * (axis.high - axis.low);
  return axis.low * (axis.high / axis.low) ** at;
}

export interface Tick {
  readonly at: number;
  readonly text: string;
}

/** Ticks of an axis, at most `most`: powers of ten on a logarithmic axis of decades, else round steps. */
export function axisTicks(axis: Axis, most: number): Tick[] {
  const { kind, low, high } = axis;
  if (kind === "log" && high / low >= 10) {
    const first = Math.ceil(Math.log10(low) - 1e-9);
    const last = Math.floor(Math.log10(high) + 1e-9);
    const every = Math.max(1, Math.ceil((last - first + 1) / most));
    if (last - first < 2) return withinDecades(axis, first - 1, last);
    const found: Tick[] = [];
    for (let power = first; power <= last; power += every)
      found.push({ at: share(axis, 10 ** power), text: powerText(power) });
    return found;
  }
  const step = niceStep((high - low) / Math.max(1, most));
  const found: Tick[] = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high * (1 + 1e-12) + 1e-300; n += 1)
    found.push({ at: share(axis, n * step), text: figure(n * step) });
  return found.filter(({ at }) => Number.isFinite(at));
}

/** 1, 2 and 5 times the powers of ten of a short logarithmic axis. */
function withinDecades(axis: Axis, first: number, last: number): Tick[] {
  const found: Tick[] = [];
  for (let power = first; power <= last; power += 1)
    for (const digit of [1, 2, 5]) {
      const value = digit * 10 ** power;
      if (value >= axis.low && value <= axis.high) found.push({ at: share(axis, value), text: figure(value) });
    }
  return found;
}

const SUPERSCRIPT = "⁰¹²³⁴⁵⁶⁷⁸⁹";

function powerText(power: number): string {
  return power >= -3 && power <= 4 ? figure(10 ** power) : powerOfTen(power);
}

/** A figure with the digits that tell something. */
export function figure(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "—";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text =
    size >= 1e6 || size < 1e-3
      ? value.toExponential(digits - 1).replace("e+", "e")
      : String(Number(value.toPrecision(digits)));
  const [mantissa = "", power] = text.split("e");
  const plain = mantissa.includes(".") ? mantissa.replace(/\.?0+$/, "") : mantissa;
  const shown = power === undefined ? plain : `${plain}·${powerOfTen(Number(power))}`;
  return shown.replace("-", "−");
}

function powerOfTen(power: number): string {
  const digits = [...String(Math.abs(power))].map((digit) => SUPERSCRIPT[Number(digit)]).join("");
  return `10${power < 0 ? "⁻" : ""}${digits}`;
}

export type Point = readonly [x: number, y: number];

/**
 * A curve in pixels. Where many values share a pixel column, its first, least, greatest and last one stand for all, so that no
 * peak is lost; a value that has no place breaks the curve.
 */
export function curve(
  x: readonly (number | null)[],
  y: readonly (number | null)[],
  axes: { readonly x: Axis; readonly y: Axis },
  width: number,
  height: number,
): Point[][] {
  const parts: Point[][] = [];
  let part: Point[] = [];
  let column: Point[] = [];
  let at = NaN;
  const flush = (): void => {
    part.push(...extremes(column));
    column = [];
  };
  const end = (): void => {
    flush();
    if (part.length > 0) parts.push(part);
    part = [];
  };
  for (let i = 0; i < x.length; i += 1) {
    const px = share(axes.x, x[i] ?? NaN) * width;
    const py = (1 - share(axes.y, y[i] ?? NaN)) * height;
    if (!Number.isFinite(px) || px < -0.5 || px > width + 0.5) continue;
    if (!Number.isFinite(py)) {
      end();
      continue;
    }
    if (Math.floor(px) !== at) flush();
    at = Math.floor(px);
    column.push([px, py]);
  }
  end();
  return parts;
}

function extremes(column: readonly Point[]): readonly Point[] {
  const first = column[0];
  if (first === undefined || column.length <= 4) return column;
  let [least, greatest] = [first, first];
  for (const point of column) {
    if (point[1] < least[1]) least = point;
    if (point[1] > greatest[1]) greatest = point;
  }
  const kept = new Set([first, least, greatest, column.at(-1)]);
  return column.filter((point) => kept.has(point));
}

/** The index whose x is nearest to a value; −1 without any. */
export function nearest(x: readonly (number | null)[], value: number): number {
  let best = -1;
  let least = Number.POSITIVE_INFINITY;
  for (let i = 0; i < x.length; i += 1) {
    const off = Math.abs((x[i] ?? NaN) - value);
    if (off < least) {
      least = off;
      best = i;
    }
  }
  return best;
}
