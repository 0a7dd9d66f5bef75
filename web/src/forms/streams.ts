/**
 * The streams of an Inertial Sense device as a table: one row for each data set, on with a multiple of its source's period, or off. Pure.
 */
import { number } from "../ui/format";
import type { PartInfo, StreamChoice } from "./types";

export interface StreamEntry {
  readonly did: number;
  readonly period: number;
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

/** Multiples of the source's period that a menu offers. */
export const PERIODS: readonly number[] = [1, 2, 3, 4, 5, 8, 10, 15, 20, 25, 50, 75, 100, 200, 500, 1000];

/** What a packet has around its data: header, offset-free, and checksum. */
const ENVELOPE = 8;

/**
 * The same choices with the periods that this device has, not the document's: what its present streams cost tells how often they
 * come, and sources of one period in the document have one on the device too.
 */
export function told(choices: readonly StreamChoice[], entries: readonly StreamEntry[], parts: readonly PartInfo[], list: string): readonly StreamChoice[] {
  const actual = new Map<number, number>();
  entries.forEach(({ did, period }, place) => {
    const choice = choices.find((one) => one.did === did);
    const bytes = parts.find(({ path }) => path === `${list}.${place}`)?.bytes_per_s ?? 0;
    if (choice && choice.size > 0 && choice.source_ms > 0 && bytes > 0) actual.set(choice.source_ms, (1000 * (choice.size + ENVELOPE)) / (bytes * period));
  });
  return choices.map((choice) => ({ ...choice, source_ms: actual.get(choice.source_ms) ?? choice.source_ms }));
}

/** How often it comes: "143 Hz", "1 in 5" where the source's period is not known, "when it happens". */
export function paceWords(choice: StreamChoice | undefined, period: number): string {
  const source = choice?.source_ms ?? 0;
  if (source <= 0) return period === 1 ? "as it comes" : `1 in ${period}`;
  const hertz = 1000 / (source * period);
  return `${number(hertz, hertz >= 20 ? 0 : hertz >= 2 ? 1 : 2)} Hz`;
}

export function streamRows(choices: readonly StreamChoice[], entries: readonly StreamEntry[], before: readonly StreamEntry[] | undefined): readonly StreamRow[] {
  const known = new Set(choices.map(({ did }) => did));
  const row = (choice: StreamChoice | undefined, did: number): StreamRow => {
    const place = entries.findIndex((entry) => entry.did === did);
    const [is, was] = [entries[place], before?.find((entry) => entry.did === did)];
    return {
      key: String(did),
      choice,
      title: choice?.title ?? "Not in the table",
      did,
      place,
      period: is?.period ?? was?.period ?? 1,
      was: before === undefined ? "" : wasWords(choice, is, was),
    };
  };
  const extra = entries.filter(({ did }) => !known.has(did));
  return [...choices.map((choice) => row(choice, choice.did)), ...extra.map(({ did }) => row(undefined, did))];
}

function wasWords(choice: StreamChoice | undefined, is: StreamEntry | undefined, was: StreamEntry | undefined): string {
  if (is?.period === was?.period) return "";
  return was ? `was ${paceWords(choice, was.period)}` : "was off";
}

/** The list with that row on at a period, or off. */
export function streamed<T extends StreamEntry>(entries: readonly T[], row: StreamRow, period: number | undefined, blank: T): readonly T[] {
  if (row.place < 0) return period === undefined ? entries : [...entries, { ...blank, did: row.did, period }];
  if (period === undefined) return entries.filter((_, place) => place !== row.place);
  return entries.map((entry, place) => (place === row.place ? { ...entry, period } : entry));
}
