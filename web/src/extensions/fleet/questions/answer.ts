/** An answer as a table shows it: order of rows, text of cells, CSV, and the moment that a row speaks of. */
import type { QueryAnswer } from "../../../wire/routes";

export type AnswerCell = unknown;
export type AnswerRow = readonly AnswerCell[];

export interface Order {
  readonly column: number;
  readonly isDescending: boolean;
}

/** Rows in an order; those without a value are last. */
export function sorted(rows: readonly AnswerRow[], order: Order | undefined): readonly AnswerRow[] {
  if (!order) return rows;
  const { column, isDescending } = order;
  const sign = isDescending ? -1 : 1;
  return [...rows].sort((a, b) => {
    const [left, right] = [a[column] ?? null, b[column] ?? null];
    if (left === null || right === null) return Number(left === null) - Number(right === null);
    if (typeof left === "number" && typeof right === "number") return sign * (left - right);
    return sign * cellText(left).localeCompare(cellText(right), undefined, { numeric: true });
  });
}

export function cellText(value: AnswerCell): string {
  if (value === null || value === undefined) return "";
  return typeof value === "object" ? JSON.stringify(value) : String(value);
}

const SHOWN_DIGITS = 6;

export function shownCell(value: AnswerCell): string {
  if (typeof value !== "number" || Number.isInteger(value)) return cellText(value).replace("-", "-");
  return String(Number(value.toPrecision(SHOWN_DIGITS)));
}

/** Rows as CSV, RFC 4180. */
export function answerCsv({ columns }: Pick<QueryAnswer, "columns">, rows: readonly AnswerRow[]): string {
  const field = (text: string): string => (/[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
  const lines = [columns.map(({ name }) => name), ...rows.map((row) => row.map(cellText))];
  return `${lines.map((line) => line.map(field).join(",")).join("\n")}\n`;
}

/** Names of times by how well they name a moment: a sample before the start of a recording. */
const MOMENTS = ["time", "hardest_minute", "minute", "began", "ended"];

export interface Opening {
  readonly recording: string;
  /** Unix seconds. */
  readonly at: number | undefined;
  /** Whether the moment stands for the minute that begins there. */
  readonly isMinute: boolean;
}

export function openingOf({ columns }: Pick<QueryAnswer, "columns">, row: AnswerRow): Opening | undefined {
  const recording = row[columns.findIndex(({ name }) => name === "recording")];
  if (typeof recording !== "string" || recording === "") return undefined;
  const times = columns.flatMap(({ name, kind }, at) => (kind === "time" && name !== "uploaded" ? [{ name, at }] : []));
  const rank = (name: string): number => (MOMENTS.includes(name) ? MOMENTS.indexOf(name) : MOMENTS.length);
  const [best] = times.sort((a, b) => rank(a.name) - rank(b.name));
  const time = best ? secondsOf(row[best.at]) : undefined;
  const isStart = best?.name === "started";
  return { recording, at: isStart ? undefined : time, isMinute: !isStart && /minute/.test(best?.name ?? "") };
}

/** Unix seconds of a time or a date of an answer. */
export function secondsOf(value: AnswerCell): number | undefined {
  const ms = typeof value === "string" ? Date.parse(value) : NaN;
  return Number.isFinite(ms) ? ms / 1000 : undefined;
}
