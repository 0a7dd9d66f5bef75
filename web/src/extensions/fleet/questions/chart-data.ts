/** What a picture of an answer shows: good columns to begin with, groups, positions and bins. */
import { type Axis, axisOf, figure, type Tick, axisTicks } from "../../../charts/axes";
import type { QueryAnswer } from "../../../wire/routes";
import { type AnswerCell, type AnswerRow, secondsOf, cellText } from "./answer";

type Column = QueryAnswer["columns"][number];
type Columns = readonly Column[];

export interface ChartChoice {
  readonly x: number;
  readonly y: number;
  /** −1: no groups. */
  readonly group: number;
}

export const MOST_GROUPS = 6;
const COLOURS = ["group-0", "group-1", "group-2", "group-3", "group-4", "group-5"];
const isNumber = ({ kind }: Column): boolean => kind === "number" || kind === "integer";
const isTime = ({ kind }: Column): boolean => kind === "time" || kind === "date";

export function numbersOf(columns: Columns): readonly number[] {
  return columns.flatMap((one, at) => (isNumber(one) ? [at] : []));
}

/** Columns that can be the x axis: numbers, times and texts. */
export function positionsOf(columns: Columns): readonly number[] {
  return columns.flatMap((one, at) => (isNumber(one) || isTime(one) || one.kind === "text" ? [at] : []));
}

/** Columns of texts with few different values. */
export function chartGroups(columns: Columns, rows: readonly AnswerRow[]): readonly number[] {
  return columns.flatMap((one, at) => {
    if (one.kind !== "text" && one.kind !== "boolean") return [];
    const n = new Set(rows.map((row) => cellText(row[at]))).size;
    return n > 1 && n <= MOST_GROUPS ? [at] : [];
  });
}

/** Good columns to begin with: a number over time, else over a measured number, else over a text. Undefined without a number. */
export function firstChoice(columns: Columns, rows: readonly AnswerRow[]): ChartChoice | undefined {
  const numbers = [...numbersOf(columns)].sort(
    (a, b) => Number(columns[b]?.kind === "number") - Number(columns[a]?.kind === "number"),
  );
  const time = columns.findIndex(isTime);
  const temperature = columns.findIndex((one) => isNumber(one) && /temperature/.test(one.name));
  const text = columns.findIndex(({ kind }) => kind === "text");
  const [first, second] = numbers;
  if (first === undefined) return undefined;
  const x =
    [temperature, time, numbers.length > 1 && text < 0 ? first : -1, text, first].find((at) => at >= 0) ?? first;
  const y = numbers.find((at) => at !== x) ?? second ?? first;
  const nameOf = (at: number): string => columns[at]?.name ?? "";
  const groups = chartGroups(columns, rows).filter((at) => at !== x && !/^(recording|object)$/.test(nameOf(at)));
  const group = groups.find((at) => /^(axis|signal)$/.test(nameOf(at))) ?? groups[0] ?? -1;
  return { x, y, group };
}

interface Group {
  readonly name: string;
  /** Class of its colour: x, y and z have the one that they have everywhere. */
  readonly colour: string;
  readonly points: readonly (readonly [x: number, y: number, row: number])[];
}

export interface Picture {
  readonly groups: readonly Group[];
  readonly x: Axis;
  readonly y: Axis;
  readonly xTicks: (most: number) => readonly Tick[];
  /** Rows without a place. */
  readonly left: number;
}

/** Positions of the rows; undefined if none has a place. */
export function pictureOf(columns: Columns, rows: readonly AnswerRow[], choice: ChartChoice): Picture | undefined {
  const column = columns[choice.x];
  if (!column) return undefined;
  const words = column.kind === "text" ? [...new Set(rows.map((row) => cellText(row[choice.x])))] : [];
  const places = new Map(words.map((word, at) => [word, at]));
  const place = (value: AnswerCell): number =>
    column.kind === "text"
      ? (places.get(cellText(value)) ?? NaN)
      : isTime(column)
        ? (secondsOf(value) ?? NaN)
        : numberOf(value);
  const groups = new Map<string, [number, number, number][]>();
  let left = 0;
  rows.forEach((row, at) => {
    const [x, y] = [place(row[choice.x]), numberOf(row[choice.y])];
    if (!Number.isFinite(x) || !Number.isFinite(y)) {
      left += 1;
      return;
    }
    const name = choice.group >= 0 ? cellText(row[choice.group]) : "";
    const found = groups.get(name) ?? [];
    found.push([x, y, at]);
    groups.set(name, found);
  });
  const all = [...groups.values()].flat();
  const [x, y] = [
    axisOf(
      "linear",
      all.map(([at]) => at),
    ),
    axisOf(
      "linear",
      all.map(([, at]) => at),
    ),
  ];
  if (!x || !y) return undefined;
  const wide = column.kind === "text" ? { kind: "linear" as const, low: -0.5, high: words.length - 0.5 } : padded(x);
  return {
    groups: [...groups]
      .sort(([a], [b]) => a.localeCompare(b))
      .map(([name, points], k) => ({ name, points, colour: colourOf(name, k) })),
    x: wide,
    y: padded(y),
    xTicks: (most) =>
      column.kind === "text"
        ? wordTicks(words, wide, most)
        : isTime(column)
          ? timeTicks(wide, most)
          : axisTicks(wide, most),
    left,
  };
}

function colourOf(name: string, k: number): string {
  const axis = /(?:^|\.)([xyz])$/.exec(name)?.[1];
  return axis ? `axis-${axis}` : (COLOURS[k] ?? "");
}

function numberOf(value: AnswerCell): number {
  return typeof value === "number" ? value : typeof value === "string" && value !== "" ? Number(value) : NaN;
}

const PAD_SHARE = 0.03;

function padded({ kind, low, high }: Axis): Axis {
  const more = (high - low) * PAD_SHARE;
  return { kind, low: low - more, high: high + more };
}

const LABEL_CHARS = 14;

function wordTicks(words: readonly string[], { low, high }: Axis, most: number): readonly Tick[] {
  const every = Math.max(1, Math.ceil(words.length / most));
  const text = (word: string) => (word.length > LABEL_CHARS ? `${word.slice(0, LABEL_CHARS - 1)}…` : word);
  return words.flatMap((word, at) => (at % every === 0 ? [{ at: (at - low) / (high - low), text: text(word) }] : []));
}

const [MINUTE, HOUR, DAY] = [60, 3600, 86_400];
const STEPS = [
  ...[1, 2, 5, 10, 30],
  ...[1, 2, 5, 10, 30].map((n) => n * MINUTE),
  ...[1, 2, 6, 12].map((n) => n * HOUR),
  ...[1, 2, 7, 14, 30, 91, 365, 3650].map((n) => n * DAY),
];

/** Ticks of a time axis in UTC: midnights as dates, others as times. */
export function timeTicks({ low, high }: Axis, most: number): readonly Tick[] {
  const step = STEPS.find((one) => (high - low) / one <= most) ?? STEPS.at(-1) ?? DAY;
  const found: Tick[] = [];
  for (let n = Math.ceil(low / step); n * step <= high; n += 1) {
    const text = new Date(n * step * 1000).toISOString();
    found.push({
      at: (n * step - low) / (high - low),
      text: (n * step) % DAY === 0 ? text.slice(0, 10) : step >= MINUTE ? text.slice(11, 16) : text.slice(11, 19),
    });
  }
  return found;
}

export interface Bin {
  readonly low: number;
  readonly high: number;
  readonly count: number;
}

const [FEWEST, MOST_BINS] = [8, 60];

/** Bins of the numbers of a column, of the width after Freedman and Diaconis. */
export function countedBins(rows: readonly AnswerRow[], column: number): readonly Bin[] {
  const values = rows
    .map((row) => numberOf(row[column]))
    .filter((one) => Number.isFinite(one))
    .sort((a, b) => a - b);
  const [low, high] = [values[0], values.at(-1)];
  if (low === undefined || high === undefined) return [];
  if (low === high) return [{ low: low - 0.5, high: high + 0.5, count: values.length }];
  const at = (share: number): number => values[Math.floor(share * (values.length - 1))] ?? low;
  const width = (2 * (at(0.75) - at(0.25))) / Math.cbrt(values.length);
  const n = Math.min(MOST_BINS, Math.max(FEWEST, width > 0 ? Math.ceil((high - low) / width) : FEWEST));
  const counts = new Array<number>(n).fill(0);
  for (const value of values) {
    const bin = Math.min(n - 1, Math.floor(((value - low) / (high - low)) * n));
    counts[bin] = (counts[bin] ?? 0) + 1;
  }
  const edge = (k: number): number => low + ((high - low) * k) / n;
  return counts.map((count, k) => ({ low: edge(k), high: edge(k + 1), count }));
}

/** A position as a reading shows it. */
export function positionText(column: Column | undefined, row: AnswerRow, at: number): string {
  const value = row[at];
  return column && isNumber(column) && typeof value === "number" ? figure(value) : cellText(value);
}
