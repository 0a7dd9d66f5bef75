/**
 * Load of the line: the share of every output in a bar, and the possible rates of the device as marks on it. Pure.
 *
 *     0 ──────── parts ──────── total ┄┄┄ free ┄┄┄ capacity        beyond the capacity: the surplus, hatched
 */
import type { Forms, LoadInfo, FieldForm } from "../wire/form-types";
import { TEXT } from "../texts/forms";

interface Share {
  readonly path: string;
  readonly title: string;
  readonly bytes: number;
  /** Of the bar's width, 0…1. */
  readonly from: number;
  readonly width: number;
}

interface Mark {
  readonly baud: number;
  /** Of the bar's width. */
  readonly at: number;
  readonly is: "capacity" | "now" | "other";
}

interface Bar {
  readonly shares: readonly Share[];
  /** Fraction of the capacity, 0…; undefined if the link has no such limit. */
  readonly fill: number | undefined;
  /** Start of the surplus, as a fraction of the bar's width; undefined while all fits. */
  readonly over: number | undefined;
  /** Load before the change, as a fraction of the bar's width. */
  readonly before: number | undefined;
  readonly marks: readonly Mark[];
}

/** Marks nearer than this to another, or to the left end, would cover its label. */
const MIN_LABEL_GAP = 0.14;

/**
 * @param load of the outputs after the edits
 * @param baud rate after the edits, if they change it; capacities follow it
 * @param rates possible rates of the device
 */
export function barOf(
  load: LoadInfo,
  before: LoadInfo | null,
  baud: number | undefined,
  rates: readonly number[],
): Bar {
  const capacity = capacityAt(load, baud);
  const scale = Math.max(load.total, capacity ?? 0, before?.total ?? 0, 1);
  let from = 0;
  const shares = load.parts
    .filter(({ bytes_per_s }) => bytes_per_s > 0)
    .map(({ path, title, bytes_per_s }) => {
      const width = bytes_per_s / scale;
      from += width;
      return { path, title, bytes: bytes_per_s, from: from - width, width };
    });
  const effective = baud ?? load.baud ?? undefined;
  return {
    shares,
    fill: capacity === null ? undefined : load.total / capacity,
    over: capacity !== null && load.total > capacity ? capacity / scale : undefined,
    before: before && Math.abs(before.total - load.total) > 0.5 ? before.total / scale : undefined,
    marks:
      capacity === null || effective === undefined
        ? []
        : marksOf(capacity, effective, load.baud ?? effective, scale, rates),
  };
}

/** Bytes/s at another rate, with the same bits per byte. */
export function capacityAt(load: LoadInfo, baud: number | undefined): number | null {
  if (load.capacity === null || baud === undefined || !load.baud) return load.capacity;
  return (load.capacity * baud) / load.baud;
}

function marksOf(
  capacity: number,
  baud: number,
  now: number,
  scale: number,
  rates: readonly number[],
): readonly Mark[] {
  const perBaud = capacity / baud;
  const marks: Mark[] = [{ baud, at: capacity / scale, is: "capacity" }];
  // slower rates than the present one are useless; faster ones are of interest while an edit sets them
  const wanted = [...new Set([now, ...rates.filter((rate) => rate > now).sort((a, b) => b - a)])];
  for (const rate of wanted) {
    const at = (rate * perBaud) / scale;
    if (at > 1 || at < MIN_LABEL_GAP / 2 || marks.some((mark) => Math.abs(mark.at - at) < MIN_LABEL_GAP)) continue;
    marks.push({ baud: rate, at, is: rate === now ? "now" : "other" });
  }
  return marks;
}

const RATE = /^([\d\s\u2009\u00a0]+)\s*(?:Bd|bps|baud)?$/i;

/** Every baud rate available in a field of the device's settings. */
export function ratesOf(forms: Forms): readonly number[] {
  const found = new Set<number>();
  const visit = (field: FieldForm): void => {
    if (/baud/i.test(field.name)) addRates(field.choices, found);
    for (const bits of field.bits) if (/baud/i.test(bits.name)) addRates(bits.choices, found);
    field.fields.forEach(visit);
  };
  for (const setting of forms.settings) setting.fields.forEach(visit);
  return [...found].sort((a, b) => a - b);
}

function addRates(choices: Readonly<Record<string, string>>, to: Set<number>): void {
  for (const words of Object.values(choices)) {
    const digits = RATE.exec(words)?.[1]?.replace(/\D/g, "");
    if (digits && Number(digits) >= 4800) to.add(Number(digits));
  }
}

/** Sentence on why the line cannot carry this; "" if it can. */
export function overWords(load: LoadInfo | null, baud: number | undefined): string {
  if (load === null) return "";
  const [broken] = load.limits;
  if (broken !== undefined) return broken;
  const capacity = capacityAt(load, baud);
  if (capacity === null || load.total <= capacity) return "";
  const percent = Math.max(100.1, (100 * load.total) / capacity); // never "100.0 %" for a load that does not fit
  return TEXT.outputsNeedShare(percent.toFixed(1));
}
