/** A list to fill in: entries that can be added, removed and put in another order; each a record, a word of flags, or a number. */
import { Button } from "../ui/controls/button";
import { IconButton } from "../ui/controls/icon-button";
import { wasAt } from "./edits";
import { FieldEditor, FieldList, OwnPort } from "./field";
import type { InputProps } from "./inputs";
import type { FormContext } from "./form-context";
import type { FieldForm, Meaning } from "../wire/form-types";
import { at, initialElement, type Path, type FormValues, valueWords, joined, put } from "./values";
import { TEXT } from "../texts/forms";

/** Longer lists show their entries closed. */
const OPEN_UP_TO = 4;

export function ListInput({ sheet, field, path }: InputProps) {
  const found = at(sheet.values, path);
  const entries: readonly unknown[] = Array.isArray(found) ? found : [];
  const fixed = field.length > 0 || sheet.readOnly || field.read_only;
  const full = field.max_length > 0 && entries.length >= field.max_length;
  const set = (next: readonly unknown[]): void => sheet.set(path, next);
  const swap = (place: number, other: number): void =>
    set(entries.map((entry, k) => (k === place ? entries[other] : k === other ? entries[place] : entry)));
  const was = (place: number): unknown => wasAt(sheet.before, sheet.values, [...path, place]);
  return (
    <div class="list">
      {entries.length === 0 && <p class="dim">{TEXT.noEntry}</p>}
      <ol>
        {entries.map((entry, place) => (
          <li key={place} class={was(place) === undefined ? "" : "changed"}>
            <details open={entries.length <= OPEN_UP_TO}>
              <summary>
                <b>{field.axes[place] ?? place + 1}</b>
                <span class="dim ellipsis">{summary(field, entry)}</span>
                <OwnPort sheet={sheet} path={[...path, place]} />
                {was(place) === null && <span class="tag">{TEXT.newEntry}</span>}
              </summary>
              {field.fields.length > 0 ? (
                <Entry sheet={sheet} fields={field.fields} root={[...path, place]} />
              ) : (
                <div class="element">
                  <FieldEditor
                    sheet={sheet}
                    field={elementOf(field, place)}
                    path={[...path, place]}
                    label={`${field.title}, ${field.axes[place] ?? TEXT.entryInSentence(place + 1)}`}
                  />
                </div>
              )}
            </details>
            {!fixed && (
              <span class="list-actions">
                <IconButton
                  icon="up"
                  label={TEXT.moveEntryUp(place + 1)}
                  disabled={place === 0}
                  onClick={() => swap(place, place - 1)}
                />
                <IconButton
                  icon="down"
                  label={TEXT.moveEntryDown(place + 1)}
                  disabled={place === entries.length - 1}
                  onClick={() => swap(place, place + 1)}
                />
                <IconButton
                  icon="close"
                  label={TEXT.removeEntry(place + 1)}
                  onClick={() => set(entries.filter((_, k) => k !== place))}
                />
              </span>
            )}
          </li>
        ))}
      </ol>
      {!fixed && (
        <Button
          look="edge small"
          icon="plus"
          words={full ? TEXT.atMostEntries(field.max_length) : TEXT.addEntry}
          disabled={full}
          onClick={() => set([...entries, initialElement(field)])}
        />
      )}
    </div>
  );
}

/** One record of a list; a field whose meaning depends on another has that meaning. */
function Entry({
  sheet,
  fields,
  root,
}: {
  readonly sheet: FormContext;
  readonly fields: readonly FieldForm[];
  readonly root: Path;
}) {
  if (!hasMeanings(fields)) return <FieldList sheet={sheet} fields={fields} root={root} />;
  const entry = at(sheet.values, root) as FormValues | undefined;
  return <FieldList sheet={signedContext(sheet, root, fields)} fields={meantFields(fields, entry)} root={root} />;
}

/** One element of a list of plain values, as a field of its own. */
function elementOf(field: FieldForm, place: number): FieldForm {
  const editor =
    field.bits.length > 0
      ? "flags"
      : Object.keys(field.choices).length > 0
        ? "choice"
        : field.step === 1
          ? "integer"
          : "number";
  return { ...field, editor, title: field.axes[place] ?? TEXT.entry(place + 1), doc: "", length: 0 };
}

function summary(field: FieldForm, entry: unknown): string {
  if (field.fields.length === 0) return valueWords(elementOf(field, 0), entry);
  const inner = entry as Record<string, unknown>;
  return field.fields
    .slice(0, 3)
    .map((part) => valueWords(part, inner?.[part.name]))
    .join(" · ");
}

/*
 * Fields whose meaning depends on another field of their record: one word of a sync setting is a delay, an offset or a
 * period, as its function says. Pure.
 *
 *     wire 0…65535 ──signed: two's complement──▶ −32768…32767 ──× scale──▶ shown
 */

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
      limited: meaning.low === null && meaning.high === null ? field.limited : ["low", "high"],
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
