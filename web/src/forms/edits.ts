/**
 * What did a person change, and what has to be sent for it? Pure: present values and drafts in, differences out. A draft is a whole
 * setting as it would be; what equals the present is no change, however it came to be so.
 */
import type { Apply, FieldForm, Forms, SettingForm } from "./types";
import { at, joined, type Path, same, type Values } from "./values";

/** Whole settings as they would be, by name. */
export type Drafts = Readonly<Record<string, Values>>;
export type Present = Readonly<Record<string, Values>>;

/** One value that differs. */
export interface Change {
  readonly path: Path;
  readonly field: FieldForm;
  readonly before: unknown;
  readonly after: unknown;
}

/** Every value in which two states of a setting differ. A list that became longer or shorter is one change. */
export function changes(fields: readonly FieldForm[], before: Values | undefined, after: Values | undefined, root: Path = []): readonly Change[] {
  if (after === undefined) return [];
  return fields.flatMap((field) => {
    const [was, is] = [before?.[field.name], after[field.name]];
    if (field.read_only || is === undefined || same(was, is)) return [];
    const path = [...root, field.name];
    const whole: readonly Change[] = [{ path, field, before: was, after: is }];
    if (field.fields.length === 0) return whole;
    if (!Array.isArray(is)) return changes(field.fields, was as Values | undefined, is as Values, path);
    if (!Array.isArray(was) || was.length !== is.length) return whole;
    return is.flatMap((one: Values, place) => changes(field.fields, was[place] as Values, one, [...path, place]));
  });
}

/** How many changes a setting has for a person: rows of the lists that have an editor of their own, else single values. */
export function countOf(form: SettingForm, before: Values | undefined, after: Values | undefined): number {
  if (after === undefined || same(before, after)) return 0;
  const key = form.editor === "outputs" ? "data_identifier" : form.editor === "streams" ? "did" : "";
  const list = form.fields.find(({ editor }) => editor === "list");
  if (!key || !list) return changes(form.fields, before, after).length;
  const rest = form.fields.filter((field) => field !== list);
  return rowsChanged(before?.[list.name], after[list.name], key) + changes(rest, before, after).length;
}

function rowsChanged(before: unknown, after: unknown, key: string): number {
  const rows = (list: unknown): Map<number, Values> =>
    new Map((Array.isArray(list) ? (list as Values[]) : []).map((one) => [Number(one[key]) & (key === "data_identifier" ? 0xfff0 : 0xffff), one]));
  const [was, is] = [rows(before), rows(after)];
  const changed = [...is].filter(([id, one]) => !same(was.get(id), one)).length;
  return changed + [...was.keys()].filter((id) => !is.has(id)).length;
}

/** What is sent to make the device what the drafts say: single fields where a setting allows it, else whole settings. */
export function toApply(forms: Forms, present: Present, drafts: Drafts): Apply["changes"] {
  const found: Record<string, Values> = {};
  for (const form of forms.settings) {
    const draft = drafts[form.name];
    if (!form.writable || draft === undefined || same(present[form.name], draft)) continue;
    const own = form.fields.filter((field) => !field.read_only && draft[field.name] !== undefined);
    const sent = form.partial ? own.filter(({ name }) => !same(present[form.name]?.[name], draft[name])) : own;
    if (sent.length > 0) found[form.name] = Object.fromEntries(sent.map(({ name }) => [name, draft[name]]));
  }
  return found;
}

/** Is this path, or one inside of it, among the changed ones? */
export function touches(all: readonly Change[], path: Path): boolean {
  const inside = `${joined(path)}.`;
  return all.some((change) => `${joined(change.path)}.`.startsWith(inside) || inside.startsWith(`${joined(change.path)}.`));
}

/** The draft of a setting where there is one, else what the device has. */
export function current(present: Present, drafts: Drafts, name: string): Values | undefined {
  return drafts[name] ?? present[name];
}

/** What a field had before, where it is another now. */
export function wasAt(before: Values | undefined, after: Values | undefined, path: Path): unknown {
  const [was, is] = [at(before, path), at(after, path)];
  return before === undefined || same(was, is) ? undefined : (was ?? null);
}
