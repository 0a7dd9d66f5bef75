/**
 * A sync setting of an MTi: one 16-bit word is a delay, an offset with a sign, or a period, as its function says. Pure.
 *
 *     wire 0…65535 ──offset: two's complement──▶ −32768…32767 ──× 0.1──▶ ms
 */
import type { Sheet } from "./form-context";
import type { FieldForm } from "./types";
import { at, joined, type Path, put, type Values } from "./values";

const WORD = "delay_offset_or_clock_period";
const SYNC_OUT = new Set([4, 14]); // IntervalTransitionMeasurement, Gnss1Pps
const CLOCK_BIAS = 9;
const TENTH_MS = { unit: "ms", scale: 0.1, decimals: 1 };

/** The fields of a sync setting, as its function means them; other fields as they are. */
export function syncFields(fields: readonly FieldForm[], entry: Values | undefined): readonly FieldForm[] {
  return fields.map((field) => (field.name === WORD ? meant(field, Number(entry?.function)) : field));
}

function meant(field: FieldForm, what: number): FieldForm {
  if (what === CLOCK_BIAS) return { ...field, title: "Clock period", unit: "ms", doc: "Period of the clock at the input." };
  if (SYNC_OUT.has(what)) return { ...field, ...TENTH_MS, title: "Offset", low: -30_000, high: 30_000, doc: "Of the pulse from the sample; negative: before it." };
  return { ...field, ...TENTH_MS, title: "Delay", low: 0, high: 60_000, doc: "From the edge to what it causes." };
}

/** A sheet on which the offset of a sync out has its sign. */
export function signedSheet(sheet: Sheet, root: Path): Sheet {
  const path = [...root, WORD];
  const signed = (values: Values): Values => {
    const [word, what] = [at(values, path), Number(at(values, [...root, "function"]))];
    return typeof word === "number" && word > 32_767 && SYNC_OUT.has(what) ? put(values, path, word - 65_536) : values;
  };
  return {
    ...sheet,
    values: signed(sheet.values),
    before: sheet.before && signed(sheet.before),
    set: (where, value) => sheet.set(where, joined(where) === joined(path) && typeof value === "number" && value < 0 ? value + 65_536 : value),
  };
}

export const isSync = (fields: readonly FieldForm[]): boolean => fields.some(({ name }) => name === WORD);
