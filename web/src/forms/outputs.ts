/**
 * The output configuration as a table: one row for each available quantity, on or off. Pure.
 *
 *     data identifier  0x4020 | precision 0…3 | coordinates 0, 4, 8        rate 0xFFFF: with every message, or the highest
 */
import { NONE } from "../ui/format";
import type { OutputChoice } from "./types";
import { TEXT } from "../texts/forms";

export interface Entry {
  readonly data_identifier: number;
  readonly output_frequency: number;
}

export interface OutputRow {
  /** Identifier without its format bits; unknown and duplicate ones have a row of their own. */
  readonly key: string;
  readonly choice: OutputChoice | undefined;
  readonly title: string;
  readonly id: number;
  /** Place in the list; −1: off. */
  readonly place: number;
  readonly rate: number;
  /** "was 100 Hz", "was off"; "" if unchanged. */
  readonly was: string;
}

export const EVERY = 0xffff;
export const PRECISIONS: readonly string[] = ["Float32", "Fp12.20", "Fp16.32", "Float64"];
export const FRAMES: Readonly<Record<number, string>> = { 0: "ENU", 4: "NED", 8: "NWU" };

export const baseOf = (id: number): number => id & 0xfff0;
export const precisionOf = (id: number): number => id & 3;
export const frameOf = (id: number): number => id & 0xc;
export const withPrecision = (id: number, bits: number): number => (id & ~3) | bits;
export const withFrame = (id: number, bits: number): number => (id & ~0xc) | bits;
export const idWords = (id: number): string => `0x${id.toString(16).toUpperCase().padStart(4, "0")}`;

/** A rate in words. */
export function rateWords(choice: OutputChoice | undefined, rate: number): string {
  if (rate !== EVERY) return `${rate} Hz`;
  const [most] = choice?.rates ?? [];
  return most === undefined ? TEXT.everySample : TEXT.highestRate(most);
}

/** Every row in table order: the choices, then further entries of the device. */
export function outputRows(
  choices: readonly OutputChoice[],
  entries: readonly Entry[],
  before: readonly Entry[] | undefined,
): readonly OutputRow[] {
  const known = new Set(choices.map(({ data_identifier }) => baseOf(data_identifier)));
  const seen = new Set<number>();
  const extra = entries.flatMap((entry, place) => {
    const base = baseOf(entry.data_identifier);
    const first = known.has(base) && !seen.has(base);
    seen.add(base);
    return first
      ? []
      : [
          rowOf(
            choices.find(({ data_identifier }) => baseOf(data_identifier) === base),
            entry,
            place,
            before,
            `${base}/${place}`,
          ),
        ];
  });
  const rows = choices.map((choice) => {
    const base = baseOf(choice.data_identifier);
    const place = entries.findIndex((entry) => baseOf(entry.data_identifier) === base);
    return rowOf(choice, entries[place], place, before, String(base));
  });
  return [...rows, ...extra];
}

function rowOf(
  choice: OutputChoice | undefined,
  entry: Entry | undefined,
  place: number,
  before: readonly Entry[] | undefined,
  key: string,
): OutputRow {
  const was = before?.find(
    (one) => baseOf(one.data_identifier) === baseOf(entry?.data_identifier ?? choice?.data_identifier ?? 0),
  );
  // an output that is off keeps its form, so that switching it on again is not a change
  const id = entry?.data_identifier ?? was?.data_identifier ?? choice?.data_identifier ?? 0;
  const rate = entry?.output_frequency ?? was?.output_frequency ?? choice?.rates[0] ?? EVERY;
  return {
    key,
    choice,
    title: choice?.title ?? TEXT.unknownOutput,
    id,
    place,
    rate,
    was: before ? wasWords(choice, entry, was) : "",
  };
}

function wasWords(choice: OutputChoice | undefined, entry: Entry | undefined, was: Entry | undefined): string {
  if (!entry && !was) return "";
  if (!was) return TEXT.wasOff;
  if (!entry) return TEXT.wasChoice(rateWords(choice, was.output_frequency));
  const parts = [
    was.output_frequency === entry.output_frequency ? "" : rateWords(choice, was.output_frequency),
    precisionOf(was.data_identifier) === precisionOf(entry.data_identifier)
      ? ""
      : (PRECISIONS[precisionOf(was.data_identifier)] ?? NONE),
    frameOf(was.data_identifier) === frameOf(entry.data_identifier)
      ? ""
      : (FRAMES[frameOf(was.data_identifier)] ?? NONE),
  ].filter(Boolean);
  return parts.length > 0 ? TEXT.wasParts(parts.join(", ")) : "";
}

/** The list with that row switched on or off; a new entry gets its place in the table. */
export function toggled(choices: readonly OutputChoice[], entries: readonly Entry[], row: OutputRow): readonly Entry[] {
  if (row.place >= 0) return entries.filter((_, place) => place !== row.place);
  const order = (id: number): number =>
    choices.findIndex(({ data_identifier }) => baseOf(data_identifier) === baseOf(id));
  const mine = order(row.id);
  const after = entries.findIndex((entry) => order(entry.data_identifier) > mine);
  const added: Entry = { data_identifier: row.id, output_frequency: row.rate };
  return after < 0 ? [...entries, added] : [...entries.slice(0, after), added, ...entries.slice(after)];
}

/** The list with another rate or format in that row; an output that was off is switched on. */
export function changed(
  choices: readonly OutputChoice[],
  entries: readonly Entry[],
  row: OutputRow,
  part: Partial<Entry>,
): readonly Entry[] {
  if (row.place >= 0) return entries.map((entry, place) => (place === row.place ? { ...entry, ...part } : entry));
  const id = part.data_identifier ?? row.id;
  return toggled(choices, entries, { ...row, id, rate: part.output_frequency ?? row.rate });
}
