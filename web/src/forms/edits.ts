/**
 * Edits of the user and their requests. Pure: present values and drafts in, differences out. A draft is a whole setting after the
 * edit; a draft equal to the present value is not a change.
 */
import type { ApplyRequest, FieldForm, Forms, SettingForm } from "../wire/form-types";
import { at, joined, type Path, same, type FormValues } from "./values";

/** Whole settings after the edits, by name. */
export type Drafts = Readonly<Record<string, FormValues>>;
export type Present = Readonly<Record<string, FormValues>>;

/** One value that differs. */
interface Change {
  readonly path: Path;
  readonly field: FieldForm;
  readonly before: unknown;
  readonly after: unknown;
}

/** Identity of an entry in a list that is a set. */
export type KeyOf = (entry: FormValues) => number;

/** The list of a setting that is a set (outputs by quantity, streams by data set), and the key of its entries. */
export function keyedList(form: SettingForm): { readonly list: FieldForm; readonly key: KeyOf } | undefined {
  const { table } = form;
  const list = form.fields.find(({ editor }) => editor === "list");
  if (table === null || list === undefined) return undefined;
  return { list, key: (entry) => Number(entry[table.key]) & table.key_mask };
}

const entriesOf = (list: unknown): readonly FormValues[] => (Array.isArray(list) ? (list as FormValues[]) : []);

/**
 * Every value in which two states of fields differ, each at its own path: of a list or a vector the places that differ, not the whole. A
 * removed entry has its former place, beyond the end of the present list.
 */
export function changes(
  fields: readonly FieldForm[],
  before: FormValues | undefined,
  after: FormValues | undefined,
  root: Path = [],
): readonly Change[] {
  if (after === undefined) return [];
  return fields.flatMap((field) => {
    const [was, is] = [before?.[field.name], after[field.name]];
    if (field.read_only || is === undefined || same(was, is)) return [];
    const path = [...root, field.name];
    if (!Array.isArray(is)) {
      return field.fields.length > 0
        ? changes(field.fields, was as FormValues | undefined, is as FormValues, path)
        : [{ path, field, before: was, after: is }];
    }
    if (!Array.isArray(was)) return [{ path, field, before: was, after: is }];
    return places(field, was, is, path);
  });
}

function places(field: FieldForm, was: readonly unknown[], is: readonly unknown[], path: Path): readonly Change[] {
  return Array.from({ length: Math.max(was.length, is.length) }, (_, place) => place).flatMap((place) => {
    const [one, other] = [was[place], is[place]];
    if (same(one, other)) return [];
    const here = [...path, place];
    if (field.fields.length > 0 && one !== undefined && other !== undefined)
      return changes(field.fields, one as FormValues, other as FormValues, here);
    return [{ path: here, field, before: one, after: other }];
  });
}

/** Every value in which two states of a setting differ; a list that is a set is compared entry by entry, in any order. */
export function changesOf(
  form: SettingForm,
  before: FormValues | undefined,
  after: FormValues | undefined,
): readonly Change[] {
  const keyed = keyedList(form);
  if (keyed === undefined || after === undefined || before === undefined) return changes(form.fields, before, after);
  const { list, key } = keyed;
  const rest = form.fields.filter((field) => field !== list);
  return [
    ...keyedChanges(list, key, entriesOf(before[list.name]), entriesOf(after[list.name])),
    ...changes(rest, before, after),
  ];
}

function keyedChanges(
  list: FieldForm,
  key: KeyOf,
  before: readonly FormValues[],
  after: readonly FormValues[],
): readonly Change[] {
  const was = new Map(before.map((entry) => [key(entry), entry]));
  const kept = new Set(after.map(key));
  const found = after.flatMap((entry, place): readonly Change[] => {
    const old = was.get(key(entry));
    const path = [list.name, place];
    return old === undefined
      ? [{ path, field: list, before: undefined, after: entry }]
      : changes(list.fields, old, entry, path);
  });
  const gone = before.filter((entry) => !kept.has(key(entry)));
  return [
    ...found,
    ...gone.map((entry, k) => ({ path: [list.name, after.length + k], field: list, before: entry, after: undefined })),
  ];
}

/** Whether two states of a setting need no write. Read-only values do not count, nor the order of a set. */
export function sameSetting(form: SettingForm, before: FormValues | undefined, after: FormValues | undefined): boolean {
  return before !== undefined && after !== undefined && changesOf(form, before, after).length === 0;
}

/** Number of changes of a setting for display: entries of a set, else single values. */
export function countOf(form: SettingForm, before: FormValues | undefined, after: FormValues | undefined): number {
  const found = changesOf(form, before, after);
  const keyed = keyedList(form);
  const inSet = found.filter(({ path }) => path[0] === keyed?.list.name);
  return found.length - inSet.length + new Set(inSet.map(({ path }) => path[1])).size;
}

/** The request that applies the drafts: single fields if a setting allows it, else whole settings. */
export function toApply(forms: Forms, present: Present, drafts: Drafts): ApplyRequest["changes"] {
  const found: Record<string, FormValues> = {};
  for (const form of forms.settings) {
    const draft = drafts[form.name];
    if (!form.writable || draft === undefined || sameSetting(form, present[form.name], draft)) continue;
    const own = form.fields.filter((field) => !field.read_only && draft[field.name] !== undefined);
    const differing = new Set(changesOf(form, present[form.name], draft).map(({ path }) => path[0]));
    const sent = form.partial ? own.filter(({ name }) => differing.has(name)) : own;
    if (sent.length > 0) found[form.name] = Object.fromEntries(sent.map(({ name }) => [name, draft[name]]));
  }
  return found;
}

/** Whether this path, or one inside it, is among the changed ones. */
export function touches(all: readonly Change[], path: Path): boolean {
  const inside = `${joined(path)}.`;
  return all.some(
    (change) => `${joined(change.path)}.`.startsWith(inside) || inside.startsWith(`${joined(change.path)}.`),
  );
}

/** The draft of a setting if there is one, else the device's value. */
export function current(present: Present, drafts: Drafts, name: string): FormValues | undefined {
  return drafts[name] ?? present[name];
}

/** Previous value of a field, if it changed; null for one that was not there, as in a new entry of a list. */
export function wasAt(before: FormValues | undefined, after: FormValues | undefined, path: Path): unknown {
  const [was, is] = [at(before, path), at(after, path)];
  return before === undefined || same(was, is) ? undefined : (was ?? null);
}
