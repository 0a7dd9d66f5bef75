/** Choices on how a table is read: as the form has them, and as the server takes them. */
import type { FileReadingBody, PreviewColumn, TablePreview } from "../../wire/routes";
import { number } from "../../ui/format/format";

/** The option that counts the rows, in place of a column of times. */
export const COUNT_ROWS = "none";

export type Unit = NonNullable<FileReadingBody["unit"]>;
export type Reading = Required<Omit<FileReadingBody, "clock">>;

/** Name and unit of a column, or left out. */
export interface ColumnChoice {
  readonly name: string;
  readonly unit: string;
  readonly isRead: boolean;
}

export const readingOf = (body: FileReadingBody): Reading => ({
  time_column: body.time_column ?? "",
  unit: body.unit ?? "",
  date_order: body.date_order ?? "",
  rate: body.rate ?? 0,
  packet_stamp: body.packet_stamp ?? "",
  columns: body.columns ?? {},
});

/** The spelling of a unit in a request. */
export const unitOption = (unit: string): Unit => (unit === "µs" ? "us" : (unit as Unit));

/** The choices with another column of times: what was chosen for the one before does not apply to it. */
export const withTimes = (reading: Reading, column: string): Reading => ({
  ...reading,
  time_column: column,
  unit: "",
  date_order: "",
  rate: column === COUNT_ROWS ? reading.rate : 0,
  packet_stamp: "",
});

/** The choices with a column under another name, with another unit, or left out. */
export function withColumn(reading: Reading, column: PreviewColumn, choice: ColumnChoice): Reading {
  const { [String(column.number)]: _, ...others } = reading.columns;
  const name = choice.name.trim();
  const unit = choice.unit.trim();
  if (!choice.isRead) return { ...reading, columns: { ...others, [column.number]: "" } };
  const text = unit === "" ? name : `${name} (${unit})`;
  return { ...reading, columns: name === "" ? others : { ...others, [column.number]: text } };
}

export const choiceOf = ({ name, unit, role }: PreviewColumn): ColumnChoice => ({
  name,
  unit,
  isRead: role !== "left out",
});

/** The columns that can be the times: clocks that were found first, by the name of each, then the others. */
export function timeChoices(
  { clocks, columns }: TablePreview,
  renamed: Reading["columns"],
): readonly (readonly [string, string])[] {
  const found = Object.entries(clocks).map(([name, option]) => [option, name] as const);
  const known = new Set(found.map(([option]) => option));
  const texts = columns.map(({ heading }) => heading);
  const others = columns
    .filter(({ role }) => role === "value" || role === "left out")
    .map(({ heading, number: place, name }): readonly [string, string] => {
      const isUnique = heading !== "" && texts.filter((text) => text === heading).length === 1 && !(place in renamed);
      return [isUnique ? heading : String(place), heading === "" ? name : heading];
    })
    .filter(([option]) => !known.has(option));
  return [...found, ...others];
}

const LARGE = [
  [1e9, "GHz"],
  [1e6, "MHz"],
  [1e3, "kHz"],
] as const;

/** A sampling rate in words: "100 Hz", "34 kHz", "one in 10 s". */
export function samplingWords(perSecond: number, slow: (seconds: string) => string): string {
  for (const [size, unit] of LARGE)
    if (perSecond >= size * 0.9995) return `${Number((perSecond / size).toPrecision(3))} ${unit}`;
  if (perSecond >= 0.1) return `${Number(perSecond.toPrecision(4))} Hz`;
  return slow(number(1 / perSecond, 0));
}

/** A number of a table, with the digits that it has. */
export function previewCell(cell: string | number | null): string {
  if (typeof cell === "string") return cell;
  return cell === null ? "" : String(Number(cell.toPrecision(9))).replace("-", "\u2212");
}

/** Decimals of seconds that tell neighbouring samples apart. */
export const decimalsAt = (rate: number | null): number => (rate !== null && rate > 900 ? 6 : 3);
