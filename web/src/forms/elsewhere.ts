/** Words for a change by another user: "Output configuration, Acceleration: 100 → 50 Hz". Pure. */
import { TEXT } from "../texts/forms";
import { NONE } from "../ui/format/format";
import { keyedList } from "./edits";
import type { RemoteChange } from "./rebase";
import type { FieldForm, Forms } from "../wire/form-types";
import { at, joined, type FormValues, whereOf, valueWords } from "./values";

/** @param now the setting as on the device */
export function describe(
  forms: Forms,
  { setting, path, before, now: value }: RemoteChange,
  now: FormValues | undefined,
): string {
  const form = forms.settings.find(({ name }) => name === setting);
  if (form === undefined) return setting;
  const keyed = keyedList(form);
  if (keyed === undefined || path[0] !== keyed.list.name) {
    const field = fieldAt(form.fields, path);
    return `${whereOf(form, joined(path))}: ${said(field, before)} → ${said(field, value)}`;
  }
  const entry = (path.length > 2 ? at(now, path.slice(0, 2)) : (value ?? before)) as FormValues | undefined;
  const id = entry === undefined ? -1 : keyed.key(entry);
  const output = form.table?.rows.find((row) => (row.id & (form.table?.key_mask ?? -1)) === id);
  const title = `${form.title}, ${output?.title ?? id}`;
  if (path.length === 2) return `${title}: ${before === undefined ? TEXT.offToOn : TEXT.onToOff}`;
  const field = fieldAt(form.fields, path);
  return `${title}: ${said(field, before)} → ${said(field, value)}`;
}

function fieldAt(fields: readonly FieldForm[], path: readonly (string | number)[]): FieldForm | undefined {
  let found: FieldForm | undefined;
  for (const part of path) {
    if (typeof part === "number") continue;
    found = (found?.fields ?? fields).find(({ name }) => name === part);
  }
  return found;
}

const said = (field: FieldForm | undefined, value: unknown): string =>
  value === undefined
    ? NONE
    : field && typeof value !== "object"
      ? valueWords(field, value)
      : typeof value === "object"
        ? "…"
        : String(value);
