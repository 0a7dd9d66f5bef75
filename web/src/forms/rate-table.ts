/**
 * A list of outputs as a table: one row for each available quantity, on or off. Pure. The family declares the table: which field of
 * an entry names the quantity (its key), which has the rate, and which bits of the key choose a variant.
 *
 *     key 0x4024 = quantity 0x4020 | variant 4        rate: Hz, or a divisor of the quantity's own rate
 */
import { NONE, number } from "../ui/format/format";
import type { KeyVariant, RateRow, RateTable } from "../wire/form-types";
import { TEXT } from "../texts/forms";

export type Entry = Readonly<Record<string, number>>;

export interface TableRow {
  /** Quantity; unknown and duplicate ones have a row of their own. */
  readonly key: string;
  readonly choice: RateRow | undefined;
  readonly title: string;
  readonly id: number;
  /** Place in the list; −1: off. */
  readonly place: number;
  readonly rate: number;
  /** Measured or known interval at divisor 1, ms; 0: unknown. */
  readonly interval: number;
  /** "was 100 Hz", "was off"; "" if unchanged. */
  readonly was: string;
}

export const baseOf = (table: RateTable, id: number): number => id & table.key_mask;
const keyOf = (table: RateTable, entry: Entry): number => entry[table.key] ?? 0;
const quantityOf = (table: RateTable, entry: Entry): number => baseOf(table, keyOf(table, entry));
const rateOf = (table: RateTable, entry: Entry): number => entry[table.rate] ?? 0;

export const variantBits = ({ mask }: KeyVariant, id: number): number => id & mask;
export const withVariantBits = ({ mask }: KeyVariant, id: number, bits: number): number => (id & ~mask) | bits;
export const bitsWords = ({ choices }: KeyVariant, bits: number): string =>
  choices.find((choice) => choice.bits === bits)?.words ?? NONE;

/** A key as displayed: "0x4020", or in decimal. */
export function idWords({ key_digits: digits }: RateTable, id: number): string {
  return digits === 0 ? String(id) : `0x${id.toString(16).toUpperCase().padStart(digits, "0")}`;
}

/** A rate in words: "100 Hz", "1 in 5" if the interval is unknown. */
export function rateWords(table: RateTable, { choice, interval }: Paced, rate: number): string {
  if (table.interval !== "") {
    if (interval <= 0) return rate === 1 ? TEXT.nativeRate : TEXT.oneIn(rate);
    const hertz = Number((1000 / (interval * rate)).toPrecision(3)); // 0.05 and 0.0125 Hz are offered side by side
    return `${number(hertz, String(hertz).split(".")[1]?.length ?? 0)} Hz`;
  }
  if (rate !== table.every) return `${rate} Hz`;
  const [most] = choice?.rates ?? [];
  return most === undefined ? TEXT.everySample : TEXT.highestRate(most);
}

type Paced = Pick<TableRow, "choice" | "interval">;

/** Rates to choose from, the present one among them. */
export function offeredRates(table: RateTable, { choice, place, rate }: TableRow): readonly number[] {
  if (table.interval !== "") return [...new Set([...table.divisors, rate])].sort((a, b) => a - b);
  const rates = choice?.rates ?? [];
  if (rates.length === 0) return [];
  return [
    ...(place >= 0 && !rates.includes(rate) ? [rate] : []),
    ...rates,
    ...(table.every === 0 || rate === table.every ? [] : [table.every]),
  ];
}

/** Every row in table order: the choices, then further entries of the device. */
export function tableRows(
  table: RateTable,
  entries: readonly Entry[],
  before: readonly Entry[] | undefined,
): readonly TableRow[] {
  const choices = new Map(table.rows.map((choice) => [baseOf(table, choice.id), choice]));
  const seen = new Set<number>();
  const extra = entries.flatMap((entry, place) => {
    const base = quantityOf(table, entry);
    const first = choices.has(base) && !seen.has(base);
    seen.add(base);
    return first ? [] : [rowOf(table, choices.get(base), entry, place, before, `${base}/${place}`)];
  });
  const rows = [...choices].map(([base, choice]) => {
    const place = entries.findIndex((entry) => quantityOf(table, entry) === base);
    return rowOf(table, choice, entries[place], place, before, String(base));
  });
  return [...rows, ...extra];
}

function rowOf(
  table: RateTable,
  choice: RateRow | undefined,
  entry: Entry | undefined,
  place: number,
  before: readonly Entry[] | undefined,
  key: string,
): TableRow {
  const base = baseOf(table, entry ? keyOf(table, entry) : (choice?.id ?? 0));
  const was = before?.find((one) => quantityOf(table, one) === base);
  // an output that is off keeps its form, so that switching it on again is not a change
  const last = entry ?? was;
  const initial = table.interval === "" ? (choice?.rates[0] ?? table.every) : 1;
  return {
    key,
    choice,
    title: choice?.title ?? TEXT.unknownOutput,
    id: last ? keyOf(table, last) : (choice?.id ?? 0),
    place,
    rate: last ? rateOf(table, last) : initial,
    interval: intervalOf(table, choice, last),
    was: before ? wasWords(table, choice, entry, was) : "",
  };
}

const intervalOf = (table: RateTable, choice: RateRow | undefined, entry: Entry | undefined): number =>
  (choice && entry?.[table.interval]) || (choice?.interval_ms ?? 0);

function wasWords(
  table: RateTable,
  choice: RateRow | undefined,
  entry: Entry | undefined,
  was: Entry | undefined,
): string {
  if (!entry && !was) return "";
  if (!was) return TEXT.wasOff;
  const rate = rateWords(table, { choice, interval: intervalOf(table, choice, was) }, rateOf(table, was));
  if (!entry) return TEXT.wasChoice(rate);
  const [id, former] = [keyOf(table, entry), keyOf(table, was)];
  const parts = [
    rateOf(table, was) === rateOf(table, entry) ? "" : rate,
    ...table.variants.map((one) =>
      variantBits(one, former) === variantBits(one, id) ? "" : bitsWords(one, variantBits(one, former)),
    ),
  ].filter(Boolean);
  return parts.length > 0 ? TEXT.wasParts(parts.join(", ")) : "";
}

/** The list with that row switched on or off; a new entry, made from `blank`, gets its place in the table. */
export function toggled(table: RateTable, entries: readonly Entry[], row: TableRow, blank: Entry): readonly Entry[] {
  if (row.place >= 0) return entries.filter((_, place) => place !== row.place);
  const order = (id: number): number =>
    table.rows.findIndex((choice) => baseOf(table, choice.id) === baseOf(table, id));
  const mine = order(row.id);
  const after = entries.findIndex((entry) => order(keyOf(table, entry)) > mine);
  const interval = table.interval === "" ? {} : { [table.interval]: row.interval };
  const added: Entry = { ...blank, ...interval, [table.key]: row.id, [table.rate]: row.rate };
  return after < 0 ? [...entries, added] : [...entries.slice(0, after), added, ...entries.slice(after)];
}

/** The list with another rate or key in that row; an output that was off is switched on. */
export function changed(
  table: RateTable,
  entries: readonly Entry[],
  row: TableRow,
  part: { readonly id?: number; readonly rate?: number },
  blank: Entry,
): readonly Entry[] {
  const now = { ...row, ...part };
  if (row.place < 0) return toggled(table, entries, now, blank);
  return entries.map((entry, place) =>
    place === row.place ? { ...entry, [table.key]: now.id, [table.rate]: now.rate } : entry,
  );
}
