/** A list to fill in: entries that can be added, removed and put in another order; each a record, a word of flags, or a number. */
import { Icon } from "../ui/icons";
import { wasAt } from "./edits";
import { Editor, Fields } from "./field";
import type { InputProps } from "./inputs";
import type { Sheet } from "./form-context";
import { isSync, signedSheet, syncFields } from "./sync";
import type { FieldForm } from "./types";
import { at, initialElement, type Path, type Values, words } from "./values";

/** Longer lists show their entries closed. */
const OPEN_UP_TO = 4;

export function ListInput({ sheet, field, path }: InputProps) {
  const found = at(sheet.values, path);
  const entries: readonly unknown[] = Array.isArray(found) ? found : [];
  const fixed = field.length > 0 || sheet.readOnly || field.read_only;
  const full = field.most > 0 && entries.length >= field.most;
  const set = (next: readonly unknown[]): void => sheet.set(path, next);
  const swap = (place: number, other: number): void =>
    set(entries.map((entry, k) => (k === place ? entries[other] : k === other ? entries[place] : entry)));
  return (
    <div class="list">
      {entries.length === 0 && <p class="dim">No entry.</p>}
      <ol>
        {entries.map((entry, place) => (
          <li key={place} class={wasAt(sheet.before, sheet.values, [...path, place]) === undefined ? "" : "ch"}>
            <details open={entries.length <= OPEN_UP_TO}>
              <summary>
                <b>{field.axes[place] ?? place + 1}</b>
                <span class="dim ell">{summary(field, entry)}</span>
              </summary>
              {field.fields.length > 0 ? (
                <Entry sheet={sheet} fields={field.fields} root={[...path, place]} />
              ) : (
                <div class="element">
                  <Editor sheet={sheet} field={elementOf(field, place)} path={[...path, place]} label={`${field.title}, ${field.axes[place] ?? `entry ${place + 1}`}`} />
                </div>
              )}
            </details>
            {!fixed && (
              <span class="listacts">
                <button type="button" class="btn icon" aria-label={`Entry ${place + 1} up`} disabled={place === 0} onClick={() => swap(place, place - 1)}>
                  <Icon name="up" />
                </button>
                <button type="button" class="btn icon" aria-label={`Entry ${place + 1} down`} disabled={place === entries.length - 1} onClick={() => swap(place, place + 1)}>
                  <Icon name="down" />
                </button>
                <button type="button" class="btn icon" aria-label={`Remove entry ${place + 1}`} onClick={() => set(entries.filter((_, k) => k !== place))}>
                  <Icon name="close" />
                </button>
              </span>
            )}
          </li>
        ))}
      </ol>
      {!fixed && (
        <button type="button" class="btn edge small" disabled={full} onClick={() => set([...entries, initialElement(field)])}>
          <Icon name="plus" />
          {full ? `At most ${field.most} entries` : "Add an entry"}
        </button>
      )}
    </div>
  );
}

/** One record of a list; of a sync setting what its function means. */
function Entry({ sheet, fields, root }: { readonly sheet: Sheet; readonly fields: readonly FieldForm[]; readonly root: Path }) {
  if (!isSync(fields)) return <Fields sheet={sheet} fields={fields} root={root} />;
  const entry = at(sheet.values, root) as Values | undefined;
  return <Fields sheet={signedSheet(sheet, root)} fields={syncFields(fields, entry)} root={root} />;
}

/** One element of a list of plain values, as a field of its own. */
function elementOf(field: FieldForm, place: number): FieldForm {
  const editor = field.bits.length > 0 ? "flags" : Object.keys(field.choices).length > 0 ? "choice" : field.step === 1 ? "integer" : "number";
  return { ...field, editor, title: field.axes[place] ?? `Entry ${place + 1}`, doc: "", length: 0 };
}

function summary(field: FieldForm, entry: unknown): string {
  if (field.fields.length === 0) return words(elementOf(field, 0), entry);
  const inner = entry as Record<string, unknown>;
  return field.fields.slice(0, 3).map((part) => words(part, inner?.[part.name])).join(" · ");
}
