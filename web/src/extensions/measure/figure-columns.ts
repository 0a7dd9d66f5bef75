/** The columns of the measuring table: keys, units and number formats, for the page, for text and for CSV. */
import { figure } from "../../charts/axes";
import { number } from "../../ui/format/format";
import type { RangeFigures } from "./range-figures";
import { TEXT } from "./texts";

export type FigureKey = "a" | "b" | "delta" | keyof RangeFigures;
export type Figures = Readonly<Record<FigureKey, number>>;

export const FIGURE_KEYS: readonly FigureKey[] = [
  "a",
  "b",
  "delta",
  "mean",
  "sigma",
  "rms",
  "min",
  "max",
  "peakToPeak",
  "slope",
  "integral",
  "n",
  "gaps",
];

/** Figures with significant digits: their size says nothing about the sensor's last digit. */
const SIGNIFICANT: ReadonlySet<FigureKey> = new Set(["sigma", "rms", "slope", "integral"]);

export function figureUnit(key: FigureKey, unit: string): string {
  if (key === "n" || key === "gaps") return "";
  if (key === "slope") return timesSeconds(unit, -1);
  return key === "integral" ? timesSeconds(unit, 1) : unit;
}

export function figureText(key: FigureKey, value: number, decimals: number): string {
  if (key === "n" || key === "gaps") return number(value, 0);
  return SIGNIFICANT.has(key) ? figure(value, 4) : number(value, decimals);
}

/** One measured series, for copying. */
export interface MeasuredRow {
  /** "Acceleration.x". */
  readonly signal: string;
  readonly unit: string;
  readonly decimals: number;
  readonly figures: Figures;
}

const CSV_NAMES: Readonly<Record<FigureKey, string>> = {
  a: "value_a",
  b: "value_b",
  delta: "delta",
  mean: "mean",
  sigma: "sigma",
  rms: "rms",
  min: "min",
  max: "max",
  peakToPeak: "peak_to_peak",
  slope: "slope",
  integral: "integral",
  n: "n",
  gaps: "gaps",
};

/** Digits of a copied number: all that a 64-bit float has to say, without its rounding. */
const DIGITS = 12;
/** Decimals of a unix time, s, that give the same 64-bit float again. */
const TIME_DIGITS = 7;

const quoted = (text: string): string => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
const plain = (value: number): string => (Number.isFinite(value) ? String(Number(value.toPrecision(DIGITS))) : "");

/** The table as CSV: a line for each series, with the times of both cursors, unix s, and the units of the figures. */
export function measuredCsv(a: number, b: number, rows: readonly MeasuredRow[]): string {
  const head = [
    "signal",
    "unit",
    "t_a_s",
    "t_b_s",
    ...FIGURE_KEYS.map((key) => CSV_NAMES[key]),
    "slope_unit",
    "integral_unit",
  ];
  const lines = rows.map(({ signal, unit, figures }) =>
    [
      quoted(signal),
      quoted(unit),
      a.toFixed(TIME_DIGITS),
      b.toFixed(TIME_DIGITS),
      ...FIGURE_KEYS.map((key) => plain(figures[key])),
      figureUnit("slope", unit),
      figureUnit("integral", unit),
    ].join(","),
  );
  return `${[head.join(","), ...lines].join("\n")}\n`;
}

/** The table as aligned text under the lines in `heading`. */
export function measuredText(heading: readonly string[], rows: readonly MeasuredRow[]): string {
  const cells = rows.map(({ signal, unit, decimals, figures }) => [
    signal,
    ...FIGURE_KEYS.map((key) => {
      const own = figureUnit(key, unit);
      return figureText(key, figures[key], decimals) + (own === "" ? "" : ` ${own}`);
    }),
  ]);
  const names = [TEXT.signal, ...FIGURE_KEYS.map((key) => TEXT.heads[key])];
  const table = [names, ...cells];
  const widths = names.map((_, c) => Math.max(...table.map((row) => row[c]?.length ?? 0)));
  const lines = table.map((row) =>
    row
      .map((cell, c) => (c === 0 ? cell.padEnd(widths[c] ?? 0) : cell.padStart(widths[c] ?? 0)))
      .join("  ")
      .trimEnd(),
  );
  return `${[...heading, "", ...lines].join("\n")}\n`;
}

type Powers = ReadonlyMap<string, number>;

const ABOVE = "⁰¹²³⁴⁵⁶⁷⁸⁹";
const PART = /^([^\d\s,·*/^()⁻⁰¹²³⁴-⁹][^\s,·*/^()⁻⁰¹²³⁴-⁹]*)(?:\^(-?\d+)|([⁻⁰¹²³⁴-⁹]+))?/u;

function powerOf(typed: string | undefined, raised: string | undefined): number {
  if (typed !== undefined) return Number(typed);
  if (raised === undefined) return 1;
  const digits = [...raised].map((sign) => (sign === "⁻" ? "-" : String(ABOVE.indexOf(sign)))).join("");
  return Number(digits);
}

/** Powers of the symbols of a unit; one that cannot be divided into symbols is one symbol. */
function parse(text: string): Powers {
  const powers = new Map<string, number>();
  const whole = text.trim();
  let [rest, sign] = [whole, 1];
  while (rest !== "") {
    const first = rest.charAt(0);
    if (first === "/") sign = -1;
    if ("·* /".includes(first) || rest === "1" || rest.startsWith("1/")) {
      rest = rest.slice(1);
      continue;
    }
    const found = PART.exec(rest);
    if (found === null) return new Map([[whole, 1]]);
    const [all, symbol = "", typed, raised] = found;
    powers.set(symbol, (powers.get(symbol) ?? 0) + sign * powerOf(typed, raised));
    rest = rest.slice(all.length);
  }
  return powers;
}

function shown(symbol: string, power: number): string {
  return power === 1 ? symbol : symbol + [...String(power)].map((digit) => ABOVE[Number(digit)]).join("");
}

/** A unit times a power of seconds: m/s² and −1 is m/s³, and 1 is m/s. */
export function timesSeconds(unit: string, power: number): string {
  const powers = new Map(parse(unit));
  powers.set("s", (powers.get("s") ?? 0) + power);
  const all = [...powers].filter(([, one]) => one !== 0);
  const above = all.filter(([, one]) => one > 0).map(([symbol, one]) => shown(symbol, one));
  const below = all.filter(([, one]) => one < 0).map(([symbol, one]) => shown(symbol, -one));
  return below.length === 0 ? above.join("·") : [above.join("·") || "1", ...below].join("/");
}
