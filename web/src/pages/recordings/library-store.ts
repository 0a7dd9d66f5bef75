/** Content of the library and its selection; loaded again when the server reports a change. */
import { computed, effect, signal } from "@preact/signals";
import { pass, prepare } from "../../recordings/prefetch";
import { type Choice, chosen, heardOf } from "../../recordings/library-filter";
import { server, upload } from "../../recordings/api";
import type { Edit, RecordingInfo } from "../../recordings/types";
import type { Problem } from "../../ui/http";
import { type App, run } from "../app-state";

export const all = signal<readonly RecordingInfo[] | undefined>(undefined);
/** Why the list could not be loaded. */
export const trouble = signal<Problem | undefined>(undefined);
export const choice = signal<Choice>({ category: "all", device: "", tag: "", query: "" });
export const selected = signal<string | undefined>(undefined);
/** The last deletion, until the next action. */
export const gone = signal<RecordingInfo | undefined>(undefined);

export const shown = computed(() => chosen(all.value ?? [], choice.value));
export const current = computed(() => all.value?.find(({ id }) => id === selected.value));

/** A file being uploaded. */
export interface Coming {
  readonly key: number;
  readonly name: string;
  readonly share: number;
  readonly problem: Problem | undefined;
  readonly cancel: () => void;
}
export const coming = signal<readonly Coming[]>([]);

export function choose(part: Partial<Choice>): void {
  choice.value = { ...choice.peek(), ...part };
}

let asked = 0;

/** Load the list; an answer overtaken by a later one is ignored. */
async function load(): Promise<void> {
  const mine = ++asked;
  const outcome = await server.list();
  if (mine !== asked) return;
  if (outcome.ok) all.value = outcome.value.map(heardOf);
  trouble.value = outcome.ok ? undefined : outcome.problem;
}

/** Follow the library while its page is open. */
export function follow(app: App): () => void {
  return effect(() => {
    void app.store.library.value;
    void app.store.recorder.value?.running;
    if (app.store.connection.value === "open" || all.peek() === undefined) void load();
  });
}

/** Handlers of a link to a recording that prefetch it. */
export function aboutToOpen(info: RecordingInfo, app: App) {
  const start = (now: boolean) => (): void => prepare(info, app.viewState.extraPlots.peek(), now);
  return {
    onPointerEnter: start(false),
    onPointerLeave: pass,
    onFocus: start(false),
    onPointerDown: start(true),
  };
}

function replace(told: RecordingInfo | undefined): void {
  if (told === undefined) return;
  const info = heardOf(told);
  const list = all.peek() ?? [];
  all.value = list.some(({ id }) => id === info.id)
    ? list.map((one) => (one.id === info.id ? info : one))
    : [info, ...list];
}

export async function edit(id: string, change: Partial<Edit>): Promise<void> {
  replace(await run(server.edit(id, change)));
}

/** Rename its file, which changes the recording's id. */
export async function rename(id: string, file: string): Promise<void> {
  const info = await run(server.edit(id, { file }));
  if (info === undefined) return;
  all.value = (all.peek() ?? []).filter((one) => one.id !== id);
  replace(info);
  if (selected.peek() === id) selected.value = info.id;
}

export async function remove(info: RecordingInfo): Promise<void> {
  const deleted = await run(server.remove(info.id));
  if (deleted === undefined) return;
  gone.value = deleted;
  replace(deleted);
  if (selected.peek() === info.id) selected.value = undefined;
}

export async function undelete(id: string): Promise<void> {
  const back = await run(server.undelete(id));
  if (back === undefined) return;
  gone.value = undefined;
  replace(back);
  selected.value = back.id;
}

let keys = 0;

/** Upload files one after the other, so that they do not share a slow line. */
export async function add(files: readonly File[]): Promise<void> {
  for (const file of files) {
    const key = ++keys;
    const change = (part: Partial<Coming>): void => {
      coming.value = coming.peek().map((one) => (one.key === key ? { ...one, ...part } : one));
    };
    const { done, cancel } = upload(file, (share) => change({ share }));
    coming.value = [...coming.peek(), { key, name: file.name, share: 0, problem: undefined, cancel }];
    const outcome = await done;
    if (outcome.ok) {
      replace(outcome.value);
      selected.value = outcome.value.id;
      dismiss(key);
    } else change({ problem: outcome.problem });
  }
}

export function dismiss(key: number): void {
  coming.value = coming.peek().filter((one) => one.key !== key);
}
