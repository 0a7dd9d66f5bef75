/**
 * Rebase of edits when the device changes under them. Pure: three states in, one out.
 *
 *     base    the device's value when the edit was made       theirs   the device's value now, written by another user
 *     mine    the draft                                       ─▶ theirs, with the edits applied on top
 *
 * If both changed the same value, the edit stays in the form, and the page shows the device's value.
 */
import { changesOf, keyedList } from "./edits";
import type { SettingForm } from "../wire/form-types";
import { at, joined, type Path, put, same, type FormValues } from "./values";

/** A value changed by another user. */
export interface RemoteChange {
  readonly setting: string;
  readonly path: Path;
  readonly before: unknown;
  readonly now: unknown;
  /** It was edited here too, to another value. */
  readonly conflict: boolean;
}

export interface Rebased {
  readonly draft: FormValues;
  readonly elsewhere: readonly RemoteChange[];
}

export function rebase(form: SettingForm, base: FormValues, mine: FormValues, theirs: FormValues): Rebased {
  const keyed = keyedList(form);
  const edited = changesOf(form, base, mine);
  let draft = theirs;
  for (const field of new Set(edited.map(({ path }) => path[0] as string))) {
    if (field === keyed?.list.name) continue;
    draft = put(draft, [field], merged(at(base, [field]), at(mine, [field]), at(theirs, [field])));
  }
  if (keyed !== undefined && edited.some(({ path }) => path[0] === keyed.list.name)) {
    const of = (values: FormValues): readonly FormValues[] => (values[keyed.list.name] ?? []) as readonly FormValues[];
    draft = put(draft, [keyed.list.name], mergedSets(of(base), of(mine), of(theirs), keyed.key));
  }
  const elsewhere = changesOf(form, base, theirs).map(({ path, before, after }) => ({
    setting: form.name,
    path,
    before,
    now: after,
    conflict:
      !same(at(draft, path), after) && edited.some((one) => isInside(one.path, path) || isInside(path, one.path)),
  }));
  return { draft, elsewhere };
}

const isInside = (path: Path, outer: Path): boolean => `${joined(path)}.`.startsWith(`${joined(outer)}.`);

/** Merge value by value: the edit, else the present value. A list of another length is taken whole. */
function merged(base: unknown, mine: unknown, theirs: unknown): unknown {
  if (same(base, mine)) return theirs;
  if (Array.isArray(mine)) {
    const alike =
      Array.isArray(base) && Array.isArray(theirs) && base.length === mine.length && theirs.length === mine.length;
    return alike ? mine.map((one, place) => merged(base[place], one, (theirs as readonly unknown[])[place])) : mine;
  }
  if (typeof mine !== "object" || mine === null || typeof theirs !== "object" || theirs === null) return mine;
  return Object.fromEntries(
    Object.entries(mine).map(([name, one]) => [name, merged(at(base, [name]), one, at(theirs, [name]))]),
  );
}

/** Merge entry by entry, by key: added, removed or altered here, else the present entry. */
function mergedSets(
  base: readonly FormValues[],
  mine: readonly FormValues[],
  theirs: readonly FormValues[],
  key: (entry: FormValues) => number,
): readonly FormValues[] {
  const find = (list: readonly FormValues[], wanted: number): FormValues | undefined =>
    list.find((entry) => key(entry) === wanted);
  const kept = theirs.flatMap((entry) => {
    const [was, is] = [find(base, key(entry)), find(mine, key(entry))];
    if (same(was, is)) return [entry];
    return is === undefined ? [] : [merged(was, is, entry) as FormValues];
  });
  const added = mine.filter((entry) => find(theirs, key(entry)) === undefined && !same(find(base, key(entry)), entry));
  return [...kept, ...added];
}
