/** Texts that a field can be set to: those that its product takes, as far as the device lists them. Pure. */
import type { Present } from "./edits";
import type { SettingForm, TextList } from "../wire/form-types";

/** Options of the fields of a setting, by name; fields that may hold any text are not in it. */
export function optionsOf(form: SettingForm, present: Present): Readonly<Record<string, readonly string[]>> {
  const found = form.fields.flatMap((field) => {
    const options = field.listed ? listed(field.options, textsOf(field.listed, present)) : field.options;
    return field.editor === "text" && options.length > 0 ? [[field.name, options] as const] : [];
  });
  return Object.fromEntries(found);
}

/** The texts that the device listed. */
function textsOf({ setting, records, text, used }: TextList, present: Present): readonly string[] {
  const rows = present[setting]?.[records];
  return Array.isArray(rows)
    ? rows
        .filter((row) => Number(row[used]) > 0)
        .map((row) => String(row[text]).trim())
        .filter(Boolean)
    : [];
}

/** Options all of whose parts the device lists ("Robust/VRU" of Robust and VRU), then what it lists beyond them. */
function listed(options: readonly string[], texts: readonly string[]): readonly string[] {
  if (texts.length === 0) return options;
  const parts = new Set(options.flatMap((option) => option.split("/")));
  const there = options.filter((option) => option.split("/").every((part) => texts.includes(part)));
  return [...there, ...texts.filter((text) => !parts.has(text))];
}
