/**
 * Number formats of the whole page: fixed decimals per field, a true minus, a thin space between groups of three, and a dash for a
 * missing number. Strings only, no DOM.
 */
import type { ColumnInfo } from "../../wire/types";

/** Placeholder for a missing number. */
export const NONE = "—";
const MINUS = "\u2212";
const THIN = "\u2009";

/** Decimals where the device's table leaves the choice to the page, by unit. */
const DECIMALS: Readonly<Record<string, number>> = {
  "m/s²": 3,
  "°/s": 2,
  "rad/s": 4,
  "a.u.": 4,
  "°": 2,
  rad: 4,
  "°C": 1,
  K: 1,
  Pa: 0,
  hPa: 2,
  m: 3,
  "m/s": 3,
  mm: 0,
  "mm/s": 0,
  s: 3,
  ms: 1,
  µs: 0,
  ns: 0,
  V: 3,
  "%": 1,
};

/** Decimals of a column: from the table; none for whole numbers; else by unit, else three. */
export function decimalsOf(column: Pick<ColumnInfo, "decimals" | "dtype" | "unit">, unit = column.unit): number {
  if (column.decimals >= 0) return column.decimals;
  return column.dtype.startsWith("f") ? (DECIMALS[unit] ?? 3) : 0;
}

function grouped(digits: string): string {
  return digits.length < 4 ? digits : digits.replace(/\B(?=(\d{3})+$)/g, THIN);
}

/** `value` with `decimals` decimals: "−1 234.50"; NONE if it is not finite or missing. */
export function number(value: number | undefined, decimals: number): string {
  if (value === undefined || !Number.isFinite(value)) return NONE;
  const size = Math.abs(value);
  if (size >= 1e15) return (value < 0 ? MINUS : "") + size.toExponential(3).replace("e+", "e");
  const fixed = size.toFixed(decimals);
  const [whole = "0", fraction] = fixed.split(".");
  const sign = value < 0 && Number(fixed) !== 0 ? MINUS : "";
  return sign + grouped(whole) + (fraction === undefined ? "" : `.${fraction}`);
}

/** As `number`, with a sign always: "+12.4". */
export function signed(value: number | undefined, decimals: number): string {
  const text = number(value, decimals);
  return /[1-9]/.test(text) && !text.startsWith(MINUS) ? `+${text}` : text;
}

/** A geographic angle in °, the fraction grouped as well: "52.220 318 4". */
export function geographic(value: number | undefined): string {
  const text = number(value, 7);
  const [whole, fraction] = text.split(".");
  return fraction === undefined ? text : `${whole}.${fraction.replace(/(\d{3})(?=\d)/g, `$1${THIN}`)}`;
}

/** A number and its unit, separate, because the unit is set smaller. */
export interface Quantity {
  readonly value: string;
  readonly unit: string;
}

/** An age, with the most readable unit: 4 ms, 2.5 s, 3 min, 5 h. */
export function age(seconds: number | undefined): Quantity {
  if (seconds === undefined || !Number.isFinite(seconds)) return { value: NONE, unit: "" };
  const s = Math.max(0, seconds);
  if (s < 0.9995) return { value: number(s * 1000, 0), unit: "ms" };
  if (s < 10) return { value: number(s, 1), unit: "s" };
  if (s < 120) return { value: number(Math.floor(s), 0), unit: "s" };
  if (s < 7200) return { value: number(Math.floor(s / 60), 0), unit: "min" };
  return { value: number(Math.floor(s / 3600), 0), unit: "h" };
}

/** A length of time chosen by the user: 500 ms, 20 s, 5 min. */
export function span(seconds: number): Quantity {
  const trimmed = (value: number): string => number(value, Number.isInteger(Math.round(value * 100) / 100) ? 0 : 1);
  if (seconds < 1) return { value: trimmed(seconds * 1000), unit: "ms" };
  if (seconds < 60) return { value: trimmed(seconds), unit: "s" };
  if (seconds < 3600) return { value: trimmed(seconds / 60), unit: "min" };
  return { value: trimmed(seconds / 3600), unit: "h" };
}

/** Bytes a second: 812 B/s, 33.9 kB/s, 1.25 MB/s. */
export function byteRate(perSecond: number | undefined): Quantity {
  if (perSecond === undefined || !Number.isFinite(perSecond)) return { value: NONE, unit: "B/s" };
  if (perSecond < 1000) return { value: number(perSecond, 0), unit: "B/s" };
  if (perSecond < 1e6) return { value: number(perSecond / 1e3, 1), unit: "kB/s" };
  return { value: number(perSecond / 1e6, 2), unit: "MB/s" };
}

/** A rate in samples a second for a narrow place: 400, 99.8, 1.0. */
export function rate(perSecond: number): string {
  const near = Math.round(perSecond);
  if (perSecond >= 20 && Math.abs(perSecond - near) < 0.6) return number(near, 0);
  return number(perSecond, 1);
}

/** Time of day in UTC of a unix time in seconds: "14:32:18", with `decimals` digits of a second. */
export function clock(unixSeconds: number, decimals = 0): string {
  if (!Number.isFinite(unixSeconds)) return NONE;
  const scale = 10 ** decimals;
  const ticks = Math.floor(unixSeconds * scale + 1e-6);
  const iso = new Date((ticks / scale) * 1000).toISOString();
  if (decimals === 0) return iso.slice(11, 19);
  const fraction = String(((ticks % scale) + scale) % scale).padStart(decimals, "0");
  return `${iso.slice(11, 19)}.${fraction}`;
}
