/** A list to fill in: entries that can be added, removed and put in another order; each a record, a word of flags, or a number. */
import { Button } from "../ui/controls/button";
import { IconButton } from "../ui/controls/icon-button";
import { wasAt } from "./edits";
import { FieldEditor, FieldList } from "./field";
import type { InputProps } from "./inputs";
import type { FormContext } from "./form-context";
import { hasMeanings, meantFields, signedContext } from "./meanings";
import type { FieldForm } from "../wire/form-types";
import { at, initialElement, type Path, type FormValues, valueWords } from "./values";
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
