/** State of the Configure page beyond its models: level of detail, search, open question; and places in it. */
import type { FunctionComponent } from "preact";
import type { Forms, CautionKind, SettingForm } from "../../wire/form-types";
import { fromExtensions } from "../../extension/extension";
import { signal } from "@preact/signals";
import { perApp } from "../../page/app-state";
import { go, href } from "../../page/route";
import { protocolOf } from "../../wire/capabilities";
import type { Edits, Model } from "./model";
import { TEXT } from "../../texts/configure";

/** A place among the settings of a device, "#/configure/DEVICE/NAME" in the address. */
export interface ConfigurePlace {
  readonly name: string;
  readonly title: string;
  /** A word beside the title in the list. */
  readonly note: string;
  /** Whether the list leads to it. */
  readonly applies: (forms: Forms) => boolean;
  readonly View: FunctionComponent<{ readonly model: Model }>;
}

declare module "../../extension/extension" {
  interface Extension {
    readonly configurePlaces?: readonly ConfigurePlace[];
  }
}

/** A confirmation of possible harm. */
export interface Question {
  readonly title: string;
  /** The sensor that it is about: fullName; "" if the words name several. */
  readonly about: string;
  readonly words: readonly string[];
  readonly caution: CautionKind;
  /** "Write anyway", "Restart the device" */
  readonly go: string;
  readonly act: () => void;
}

const EDITS = "imuscope.edits";

function storedEdits(): Map<string, Edits> {
  try {
    return new Map(JSON.parse(sessionStorage.getItem(EDITS) ?? "[]") as [string, Edits][]);
  } catch {
    return new Map();
  }
}

/** What the models of all devices on one page share; it outlives a change of page. */
export class ConfigureState {
  /** Whether rarely used settings and fields are shown too. */
  readonly all = signal(false);
  /** What is typed into the search field. */
  readonly query = signal("");
  readonly question = signal<Question | undefined>(undefined);
  /** Devices that this page has written to, or answered for: what becomes of it is told here. */
  readonly written = signal<ReadonlySet<string>>(new Set());
  /** By device. */
  readonly models = new Map<string, Model>();
  /** Edits for sensors that are not there now, by their key. */
  readonly aside = storedEdits();

  /** Stores all edits for this tab: a page that is reloaded begins with them. */
  storeEdits(): void {
    const own = [...this.models.values()].flatMap(({ edits }) => (edits ? [edits] : []));
    const all = [...this.aside, ...own].map(([sensor, edits]) => [sensor, { ...edits, undo: [] }]);
    try {
      if (all.length > 0) sessionStorage.setItem(EDITS, JSON.stringify(all));
      else sessionStorage.removeItem(EDITS);
    } catch {
      // forbidden or full: the edits stay as long as the page does
    }
  }

  wrote(device: string): void {
    if (!this.written.peek().has(device)) this.written.value = new Set([...this.written.peek(), device]);
  }
}

export const configureOf = perApp(() => new ConfigureState());

/** Read all settings; if that would discard unfinished work, the user is asked first. */
export function readAll(model: Model): void {
  const unfinished = unfinishedOf(model);
  if (unfinished.length === 0) return void model.readAll();
  model.page.question.value = {
    title: TEXT.confirmRead,
    about: model.fullName,
    words: unfinished,
    caution: "loses-settings",
    go: TEXT.readAndDiscard,
    act: () => void model.readAll(true),
  };
}

/** What reading the settings does to the stream, one sentence; "" for nothing. */
export const pauseOf = (model: Model): string => protocolOf(model.device.value?.protocol)?.pause_hint ?? "";

/** Unfinished work of a command that a change of the device's state discards. */
export const unfinishedOf = (model: Model): readonly string[] => [model.jobs.value?.unfinished ?? ""].filter(Boolean);

export interface FormPlace {
  readonly kind: "setting" | "command" | "group" | "compare" | "restore" | "extension" | "nothing";
  readonly name: string;
}

/** The place of an extension. */
export const extensionPlace = (name: string): ConfigurePlace | undefined =>
  fromExtensions("configurePlaces").find((one) => one.name === name);

/** The place of an address: a setting, a command or a group of that name; by default the first group. */
export function formPlaceOf(model: Model, place: string | undefined): FormPlace {
  const forms = model.forms.value;
  if (place === "compare" || place === "restore") return { kind: place, name: "" };
  if (place !== undefined && extensionPlace(place)) return { kind: "extension", name: place };
  if (forms === undefined) return { kind: "nothing", name: place ?? "" };
  const name = place ?? forms.groups[0] ?? "";
  if (forms.settings.some((form) => form.name === name)) return { kind: "setting", name };
  if (forms.commands.some((form) => form.name === name)) return { kind: "command", name };
  return { kind: forms.groups.includes(name) ? "group" : "nothing", name };
}

/** The settings of a group on screen: basic ones, those with edits, all on request. */
export function visibleSettings(model: Model, group: string): readonly SettingForm[] {
  const own = model.forms.value?.settings.filter((form) => form.group === group) ?? [];
  const shown = own.filter((form) => model.page.all.value || form.basic || model.counts.value.has(form.name));
  return shown.length > 0 ? shown : own;
}

export const linkTo = (model: Model, place: string, more?: string): string =>
  href("configure", model.linkName, place, more);
export const goTo = (model: Model, place: string, more?: string): void => go("configure", model.linkName, place, more);

/** The kind of harm of a caution, in a word. */
export const CAUTIONS: Readonly<Record<CautionKind, string>> = {
  "": "",
  restarts: TEXT.restartsTheDevice,
  "stops-output": TEXT.stopsItsOutput,
  "cuts-line": TEXT.canCutLink,
  "loses-settings": TEXT.losesSettings,
  "wears-flash": TEXT.writesFlashMemory,
  "moves-frame": TEXT.changesMeaning,
};
