/** What is on screen of the Configure page beyond the model: which place, how much of it, which question is open. */
import { computed, signal } from "@preact/signals";
import { go, href, route } from "../route";
import type { CautionKind, SettingForm } from "../../forms/types";
import type { Model } from "./model";

/** Also settings and fields that most people never change. */
export const all = signal(false);
/** What is typed into the search field. */
export const query = signal("");

/** Something that could harm, until a person has read what. */
export interface Question {
  readonly title: string;
  readonly words: readonly string[];
  readonly caution: CautionKind;
  /** "Write anyway", "Restart the device" */
  readonly go: string;
  readonly act: () => void;
}
export const question = signal<Question | undefined>(undefined);

/** Ask the device for everything; where that would discard something unfinished, a person is asked first. */
export function readAll(model: Model): void {
  const unfinished = unfinishedOf(model);
  if (unfinished.length === 0) return void model.readAll();
  question.value = {
    title: "Read the settings now?",
    words: unfinished,
    caution: "loses-settings",
    go: "Read and discard it",
    act: () => void model.readAll(true),
  };
}

/** What a command left open that a change of the device's state discards. */
export const unfinishedOf = (model: Model): readonly string[] => [model.control.value?.unfinished ?? ""].filter(Boolean);

/** Sheets over the page that only this page has. */
export const sending = signal(false);

export interface Place {
  readonly kind: "setting" | "command" | "group" | "compare" | "corrections" | "restore" | "nothing";
  readonly name: string;
}

/** What an address means for a device: a setting, a command or a group of that name; without one, the first group. */
export function placeOf(model: Model, place: string | undefined): Place {
  const forms = model.forms.value;
  if (place === "compare" || place === "corrections" || place === "restore") return { kind: place, name: "" };
  if (forms === undefined) return { kind: "nothing", name: place ?? "" };
  const name = place ?? forms.groups[0] ?? "";
  if (forms.settings.some((form) => form.name === name)) return { kind: "setting", name };
  if (forms.commands.some((form) => form.name === name)) return { kind: "command", name };
  return { kind: forms.groups.includes(name) ? "group" : "nothing", name };
}

export const here = computed(() => ({ place: route.value.place, more: route.value.more }));

/** The settings of a group that are on screen: simple ones, those with edits, all where that was asked for. */
export function visibleSettings(model: Model, group: string): readonly SettingForm[] {
  const own = model.forms.value?.settings.filter((form) => form.group === group) ?? [];
  const shown = own.filter((form) => all.value || form.simple || model.counts.value.has(form.name));
  return shown.length > 0 ? shown : own;
}

export const linkTo = (model: Model, place: string, more?: string): string => href("configure", model.id, place, more);
export const goTo = (model: Model, place: string, more?: string): void => go("configure", model.id, place, more);

/** What harm a caution stands for, in a word. */
export const CAUTIONS: Readonly<Record<CautionKind, string>> = {
  "": "",
  restarts: "restarts the device",
  "stops-output": "stops its output",
  "cuts-line": "can cut the line",
  "loses-settings": "loses settings",
  "wears-flash": "writes flash memory",
  "moves-frame": "changes what the numbers mean",
};
