/**
 * The streams of an Inertial Sense device as a table: one row for each data set, on with a multiple of its source's period, or off. Pure.
 */
import { number } from "../ui/format";
import type { StreamChoice } from "./types";
import { TEXT } from "../texts/forms";

export interface StreamEntry {
  readonly did: number;
  readonly period: number;
  /** The source's measured period; source_ms × period is the interval of the packets. 0 or absent: that of the choice. */
  readonly source_ms?: number;
}

export interface StreamRow {
  readonly key: string;
  readonly choice: StreamChoice | undefined;
  readonly title: string;
  readonly did: number;
  /** Place in the list; −1: off. */
  readonly place: number;
  readonly period: number;
  readonly was: string;
}

/** Multiples of the source's period in the menu. */
export const PERIODS: readonly number[] = [1, 2, 3, 4, 5, 8, 10, 15, 20, 25, 50, 75, 100, 200, 500, 1000];

/** Rate of a stream: "143 Hz", "1 in 5" if the source's period is unknown, "when it happens". */
export function paceWords(choice: StreamChoice | undefined, period: number): string {
  const source = choice?.source_ms ?? 0;
  if (source <= 0) return period === 1 ? TEXT.nativeRate : TEXT.oneIn(period);
  const hertz = 1000 / (source * period);
  return `${number(hertz, hertz >= 20 ? 0 : hertz >= 2 ? 1 : 2)} Hz`;
}

export function streamRows(
  choices: readonly StreamChoice[],
  entries: readonly StreamEntry[],
  before: readonly StreamEntry[] | undefined,
): readonly StreamRow[] {
  const known = new Set(choices.map(({ did }) => did));
  const row = (choice: StreamChoice | undefined, did: number): StreamRow => {
    const place = entries.findIndex((entry) => entry.did === did);
    const [is, was] = [entries[place], before?.find((entry) => entry.did === did)];
    return {
      key: String(did),
      choice: paced(choice, is ?? was),
      title: choice?.title ?? TEXT.unknownOutput,
      did,
      place,
      period: is?.period ?? was?.period ?? 1,
      was: before === undefined ? "" : wasWords(paced(choice, was), is, was),
    };
  };
  const extra = entries.filter(({ did }) => !known.has(did));
  return [...choices.map((choice) => row(choice, choice.did)), ...extra.map(({ did }) => row(undefined, did))];
}

/** A choice with the measured period of its stream. */
function paced(choice: StreamChoice | undefined, entry: StreamEntry | undefined): StreamChoice | undefined {
  return choice && entry?.source_ms ? { ...choice, source_ms: entry.source_ms } : choice;
}

function wasWords(choice: StreamChoice | undefined, is: StreamEntry | undefined, was: StreamEntry | undefined): string {
  if (is?.period === was?.period) return "";
  return was ? TEXT.wasChoice(paceWords(choice, was.period)) : TEXT.wasOff;
}

/** The list with that row on at a period, or off. */
export function streamed<T extends StreamEntry>(
  entries: readonly T[],
  row: StreamRow,
  period: number | undefined,
  blank: T,
): readonly T[] {
  if (row.place < 0)
    return period === undefined
      ? entries
      : [...entries, { ...blank, did: row.did, period, source_ms: row.choice?.source_ms ?? 0 }];
  if (period === undefined) return entries.filter((_, place) => place !== row.place);
  return entries.map((entry, place) => (place === row.place ? { ...entry, period } : entry));
}
