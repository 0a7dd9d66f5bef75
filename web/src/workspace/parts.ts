/**
 * What a workspace consists of: each part of a view's state registers itself here by a key, reads its state as plain JSON, and writes
 * it back. A workspace is saved on the server, exported as a file, shared in a link and restored after a reload; none of these knows
 * the parts.
 *
 *     {"format": "imuscope-workspace", "version": 1, "parts": {"extraPlots": ["Temperature"], "frame": "NED", …}}
 *
 * To add a part: call `registerPart` in a file of this folder, and import that file in all.ts. A part reads as undefined while it is
 * at its default, so that a workspace holds only what a person changed. A workspace may come from another version, another device or
 * an editor: what is unknown or broken is left out and said, and the rest is applied.
 */
import { type Json, type JsonObject, isObject } from "../data/json";
import type { Signal } from "@preact/signals";
import type { ViewState } from "../data/view-state";
import { TEXT } from "../texts/workspace";

/** The state that parts read and write: of Live, or of an open recording. */
export interface WorkspaceView {
  readonly viewState: ViewState;
  /** Whether the side column is folded. */
  readonly folded: Signal<boolean>;
  /** Range of what can be shown, unix s, if the view cannot follow a device: that of a recording. */
  readonly bounds?: { readonly first: number; readonly last: number };
}

export interface WorkspacePart<T extends Json = Json> {
  /** Unique; the name of the part in files and links, so it never changes. */
  readonly key: string;
  /** Where in time the view is: such a part is not stored in a workspace saved by name, and stays as it is if it is absent. */
  readonly isMoment?: boolean;
  /** A link has it by a name of its own (page/permalink.ts). */
  readonly isNamedInLinks?: boolean;
  /** The state of a view; undefined at its default. */
  readonly read: (view: WorkspaceView) => T | undefined;
  /** The state that `json` describes; undefined if it describes none. */
  readonly check: (json: Json) => T | undefined;
  /** Set the state of a view; undefined: its default. */
  readonly write: (view: WorkspaceView, state: T | undefined) => void;
}

export interface Workspace {
  readonly format: typeof FORMAT;
  readonly version: typeof VERSION;
  readonly parts: JsonObject;
}

export const FORMAT = "imuscope-workspace";
/** Grows with each change that an older page would misread; a new part is not one. */
export const VERSION = 1;

const parts = new Map<string, WorkspacePart>();

export function registerPart<T extends Json>(part: WorkspacePart<T>): void {
  if (parts.has(part.key)) throw new Error(`two parts of a workspace have the key ${part.key}`);
  parts.set(part.key, part as unknown as WorkspacePart);
}

/** Whether `json` has one choice or more, each of them known and valid; one at its default is absent. */
export function areChoices<T extends object>(
  json: Json,
  checks: Readonly<Record<keyof T, (json: Json) => boolean>>,
): json is JsonObject {
  if (!isObject(json) || Object.keys(json).length === 0) return false;
  return Object.entries(json).every(([name, value]) => Object.hasOwn(checks, name) && checks[name as keyof T](value));
}

/** In one order of names. */
export const choicesJson = (choices: object): JsonObject =>
  Object.fromEntries(Object.entries(choices).sort(([a], [b]) => (a < b ? -1 : 1)));

/** Registers the choices of a panel as a part. */
export function registerChoices<T extends object>(
  key: string,
  choicesOf: (viewState: ViewState) => Signal<T>,
  checks: Readonly<Record<keyof T, (json: Json) => boolean>>,
): void {
  registerPart<JsonObject>({
    key,
    read({ viewState }) {
      const choices = choicesOf(viewState).peek();
      return Object.keys(choices).length > 0 ? choicesJson(choices) : undefined;
    },
    check: (json) => (areChoices(json, checks) ? json : undefined),
    write: ({ viewState }, json) => void (choicesOf(viewState).value = (json ?? {}) as T),
  });
}

export const everyPart = (): boolean => true;
/** What is stored by name: everything but where in time the view is. */
export const withoutMoment = ({ isMoment }: WorkspacePart): boolean => isMoment !== true;

const inLinkOnly = ({ isNamedInLinks }: WorkspacePart): boolean => isNamedInLinks !== true;

/** What a link has to hold besides what it names, as text; undefined if everything of it is at its default. */
export function linkTextOf(view: WorkspaceView): string | undefined {
  const json = workspaceOf(view, inLinkOnly).parts;
  return Object.keys(json).length > 0 ? JSON.stringify(json) : undefined;
}

/** Set what a link holds besides what it names. @returns what was left out, in words */
export function applyLinkText(view: WorkspaceView, text: string | undefined): readonly string[] {
  let json: unknown;
  try {
    json = JSON.parse(text ?? "{}");
  } catch {
    return [TEXT.notAWorkspace]; // a link that was cut
  }
  return applyWorkspace(view, { format: FORMAT, version: VERSION, parts: json }, inLinkOnly);
}

/** The workspace of a view. @param which its parts; default: all */
export function workspaceOf(view: WorkspaceView, which: (part: WorkspacePart) => boolean = everyPart): Workspace {
  const states = [...parts.values()]
    .filter(which)
    .sort((a, b) => (a.key < b.key ? -1 : 1))
    .flatMap((part): readonly (readonly [string, Json])[] => {
      const state = part.read(view);
      return state === undefined ? [] : [[part.key, state]];
    });
  return { format: FORMAT, version: VERSION, parts: Object.fromEntries(states) };
}

/**
 * Set a view as `json` says; a part that is absent gets its default, but one of the moment stays.
 *
 * @param which the parts that are set; default: all
 * @returns what was left out, in words; empty if everything was applied
 */
export function applyWorkspace(
  view: WorkspaceView,
  json: unknown,
  which: (part: WorkspacePart) => boolean = everyPart,
): readonly string[] {
  if (!isObject(json) || json["format"] !== FORMAT || !isObject(json["parts"])) return [TEXT.notAWorkspace];
  if (json["version"] !== VERSION) return [TEXT.otherVersion(String(json["version"]), VERSION)];
  const given = json["parts"];
  const problems = Object.keys(given)
    .filter((key) => !parts.has(key))
    .map((key) => TEXT.unknownPart(key));
  for (const part of [...parts.values()].filter(which)) {
    const state = Object.hasOwn(given, part.key) ? part.check(given[part.key] as Json) : undefined;
    if (Object.hasOwn(given, part.key) && state === undefined) problems.push(TEXT.brokenPart(part.key));
    else if (state !== undefined || part.isMoment !== true) part.write(view, state);
  }
  return problems;
}
