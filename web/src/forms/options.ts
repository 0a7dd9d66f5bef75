/** Texts that a field can be set to: what the product is known to take, as far as the device lists it. Pure. */
import type { Present } from "./edits";
import type { SettingForm } from "./types";

/** Options of the fields of a setting, by name; fields that may hold any text are not in it. */
export function optionsOf(form: SettingForm, present: Present): Readonly<Record<string, readonly string[]>> {
  const found = form.fields.flatMap((field) => {
    const options = form.name === "FilterProfile" ? listed(field.options, labelsOf(present)) : field.options;
    return field.editor === "text" && options.length > 0 ? [[field.name, options] as const] : [];
  });
  return Object.fromEntries(found);
}

/** The filter profiles that an MTi listed. */
function labelsOf(present: Present): readonly string[] {
  const rows = present.AvailableFilterProfiles?.profiles;
  return Array.isArray(rows) ? rows.filter(({ type }) => Number(type) > 0).map(({ label }) => String(label).trim()).filter(Boolean) : [];
}

/** Options all of whose parts the device lists ("Robust/VRU" of Robust and VRU); what it lists beyond them stands alone. */
function listed(options: readonly string[], labels: readonly string[]): readonly string[] {
  if (labels.length === 0) return options;
  const parts = new Set(options.flatMap((option) => option.split("/")));
  const there = options.filter((option) => option.split("/").every((part) => labels.includes(part)));
  return [...there, ...labels.filter((label) => !parts.has(label))];
}
