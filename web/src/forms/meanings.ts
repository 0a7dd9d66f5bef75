/**
 * Fields whose meaning depends on another field of their record: one word of a sync setting is a delay, an offset or a
 * period, as its function says. Pure.
 *
 *     wire 0…65535 ──signed: two's complement──▶ −32768…32767 ──× scale──▶ shown
 */
import type { FormContext } from "./form-context";
import type { FieldForm, Meaning } from "../wire/form-types";
import { at, joined, type Path, put, type FormValues } from "./values";

/** The fields of a record, each with the meaning that it has there. */
export function meantFields(fields: readonly FieldForm[], record: FormValues | undefined): readonly FieldForm[] {
  return fields.map((field) => {
    const meaning = meaningIn(field, record);
    if (meaning === undefined) return field;
    const { title, unit, scale, decimals, doc } = meaning;
    return {
      ...field,
      title,
      unit,
      scale,
      decimals,
      doc,
      low: meaning.low ?? field.low,
      high: meaning.high ?? field.high,
    };
  });
}

/** The values of a form in which the signed words of one record have their sign, and which takes such words. */
export function signedContext(form: FormContext, root: Path, fields: readonly FieldForm[]): FormContext {
  const words = new Map(
    fields.filter(({ meanings }) => meanings.some(({ signed }) => signed)).map((field) => [field.name, field]),
  );
  const signed = (values: FormValues): FormValues => {
    const record = at(values, root) as FormValues | undefined;
    return [...words.values()].reduce((all, field) => {
      const word = record?.[field.name];
      const wraps = typeof word === "number" && word > half(field) && meaningIn(field, record)?.signed === true;
      return wraps ? put(all, [...root, field.name], word - span(field)) : all;
    }, values);
  };
  return {
    ...form,
    values: signed(form.values),
    before: form.before && signed(form.before),
    set: (path, value) => {
      const field = words.get(String(path.at(-1)));
      const isWord = field !== undefined && joined(path) === joined([...root, field.name]);
      form.set(path, isWord && typeof value === "number" && value < 0 ? value + span(field) : value);
    },
  };
}

export const hasMeanings = (fields: readonly FieldForm[]): boolean =>
  fields.some(({ meanings }) => meanings.length > 0);

function meaningIn(field: FieldForm, record: FormValues | undefined): Meaning | undefined {
  const value = Number(record?.[field.meaning_of]);
  return field.meanings.find(({ values }) => values.length === 0 || values.includes(value));
}

/** How many values an unsigned word has. */
const span = (field: FieldForm): number => (field.high ?? 0) + 1;
const half = (field: FieldForm): number => span(field) / 2 - 1;
