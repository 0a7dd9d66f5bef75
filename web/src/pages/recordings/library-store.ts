/** Content of the library and its selection; loaded again when the server reports a change. */
import { computed, effect, signal } from "@preact/signals";
import { Prefetch } from "../../recordings/prefetch";
import {
  type LibraryChoice,
  chosen,
  distinctNames,
  recordingTitle,
  withReceiving,
} from "../../recordings/library-filter";
import { sortRecordings, type LibraryView, storedView, storeView } from "../../recordings/library-view";
import { recordingsApi, upload } from "../../recordings/api";
import type { EditRequest, LibraryStorage, RecordingInfo } from "../../wire/recording-types";
import type { HttpProblem } from "../../requests/http";
import { perApp, run } from "../../page/app-state";
import type { App } from "../../page/context";

/** A file being uploaded. */
export interface Coming {
  readonly key: number;
  readonly name: string;
  readonly share: number;
  readonly problem: HttpProblem | undefined;
  readonly cancel: () => void;
}

export class Library {
  readonly all = signal<readonly RecordingInfo[] | undefined>(undefined);
  /** Why the list could not be loaded. */
  readonly trouble = signal<HttpProblem | undefined>(undefined);
  readonly choice = signal<LibraryChoice>({ category: "all", device: "", tag: "", query: "" });
  /** The recording whose details are shown, from which a selection is extended. */
  readonly selected = signal<string | undefined>(undefined);
  /** Ids of those that are selected, the one above among them. */
  readonly picked = signal<ReadonlySet<string>>(new Set());
  /** Whether rows have boxes to select them where there is no room for them otherwise. */
  readonly isPicking = signal(false);
  readonly table = signal(storedView());
  readonly storage = signal<LibraryStorage | undefined>(undefined);
  /** The last deletion, until the next action. */
  readonly gone = signal<readonly RecordingInfo[]>([]);
  readonly coming = signal<readonly Coming[]>([]);
  readonly #names = computed(() => distinctNames(this.all.value ?? []));
  readonly nameOf = (info: RecordingInfo): string => this.#names.value.get(info) ?? recordingTitle(info);
  readonly #sorted = computed(() => sortRecordings(this.all.value ?? [], this.table.value, this.nameOf));
  readonly shown = computed(() => chosen(this.#sorted.value, this.choice.value));
  /** The selected ones that are listed, in their order. */
  readonly several = computed(() => this.shown.value.filter(({ id }) => this.picked.value.has(id)));
  readonly current = computed(() => this.all.value?.find(({ id }) => id === this.selected.value));
  readonly prefetch = new Prefetch();
  readonly #app: App;
  #anchor: string | undefined;
  #asked = 0;
  #keys = 0;
  #edited = Promise.resolve();

  constructor(app: App) {
    this.#app = app;
  }

  choose(part: Partial<LibraryChoice>): void {
    this.choice.value = { ...this.choice.peek(), ...part };
  }

  look(view: LibraryView): void {
    this.table.value = view;
    storeView(view);
  }

  /** Select a row: alone, or in addition, or all from the last one to it. */
  pick(id: string, how: "alone" | "toggled" | "range" = "alone"): void {
    const picked = new Set(how === "toggled" ? this.picked.peek() : [id]);
    if (how === "toggled" && !picked.delete(id)) picked.add(id);
    if (how === "range") {
      const ids = this.shown.peek().map((one) => one.id);
      const [from, to] = [ids.indexOf(this.#anchor ?? id), ids.indexOf(id)];
      for (const one of ids.slice(Math.max(0, Math.min(from, to)), Math.max(from, to) + 1)) picked.add(one);
    } else this.#anchor = id;
    this.picked.value = picked;
    this.selected.value = id;
  }

  /** Select these alone; the details stay those of the last one. */
  pickAll(ids: readonly string[]): void {
    this.picked.value = new Set(ids);
    if (ids.length === 0) this.isPicking.value = false;
  }

  /** Load the list; an answer overtaken by a later one is ignored. */
  async #load(): Promise<void> {
    const mine = ++this.#asked;
    const outcome = await recordingsApi.list();
    if (mine !== this.#asked) return;
    if (outcome.ok) this.all.value = outcome.value.map(withReceiving);
    this.trouble.value = outcome.ok ? undefined : outcome.problem;
    const storage = await recordingsApi.storage();
    if (storage.ok) this.storage.value = storage.value;
  }

  /** Follow the library while its page is open. */
  follow(): () => void {
    const { store } = this.#app;
    const end = effect(() => {
      void store.library.value;
      void store.recorder.value?.running;
      if (store.connection.value === "open" || this.all.peek() === undefined) void this.#load();
    });
    return () => {
      end();
      this.#asked += 1;
    };
  }

  /** Handlers of a link to a recording that prefetch it. */
  aboutToOpen(info: RecordingInfo) {
    const start = (now: boolean) => (): void => this.prefetch.prepare(info, this.#app.viewState.extraPlots.peek(), now);
    return {
      onPointerEnter: start(false),
      onPointerLeave: () => this.prefetch.pass(),
      onFocus: start(false),
      onPointerDown: start(true),
    };
  }

  #replace(answer: RecordingInfo | undefined): void {
    if (answer === undefined) return;
    const info = withReceiving(answer);
    const list = this.all.peek() ?? [];
    this.all.value = list.some(({ id }) => id === info.id)
      ? list.map((one) => (one.id === info.id ? info : one))
      : [info, ...list];
  }

  /** Change what is kept on a recording: one change after another, each of what the one before has left. */
  edit(info: RecordingInfo, change: (newest: RecordingInfo) => Partial<EditRequest>): void {
    this.#edited = this.#edited.then(async () => {
      const newest = this.all.peek()?.find(({ id }) => id === info.id) ?? info;
      this.#replace(await run(this.#app, recordingsApi.edit(info.id, change(newest))));
    });
  }

  /** Rename its file, which changes the recording's id. */
  async rename(id: string, file: string): Promise<void> {
    const info = await run(this.#app, recordingsApi.edit(id, { file }));
    if (info === undefined) return;
    this.all.value = (this.all.peek() ?? []).filter((one) => one.id !== id);
    this.#replace(info);
    if (this.selected.peek() === id) this.pick(info.id);
  }

  async remove(...list: readonly RecordingInfo[]): Promise<void> {
    const gone: RecordingInfo[] = [];
    for (const { id } of list) {
      const deleted = await run(this.#app, recordingsApi.remove(id));
      if (deleted === undefined) break; // the reason is in a band
      gone.push(deleted);
      this.#replace(deleted);
      if (this.selected.peek() === id) this.selected.value = undefined;
    }
    if (gone.length > 0) this.gone.value = gone;
    this.pickAll([]);
  }

  async undelete(...ids: readonly string[]): Promise<void> {
    for (const id of ids) {
      const back = await run(this.#app, recordingsApi.undelete(id));
      if (back === undefined) return;
      this.gone.value = this.gone.peek().filter((one) => one.id !== id);
      this.#replace(back);
      this.pick(back.id);
    }
  }

  /** Upload files one after the other, so that they do not share a slow line. */
  async add(files: readonly File[]): Promise<void> {
    const { coming } = this;
    for (const file of files) {
      const key = ++this.#keys;
      const change = (part: Partial<Coming>): void => {
        coming.value = coming.peek().map((one) => (one.key === key ? { ...one, ...part } : one));
      };
      const { done, cancel } = upload(file, (share) => change({ share }));
      coming.value = [...coming.peek(), { key, name: file.name, share: 0, problem: undefined, cancel }];
      const outcome = await done;
      if (outcome.ok) {
        this.#replace(outcome.value);
        this.pick(outcome.value.id);
        this.dismiss(key);
      } else change({ problem: outcome.problem });
    }
  }

  dismiss(key: number): void {
    this.coming.value = this.coming.peek().filter((one) => one.key !== key);
  }
}

export const libraryOf = perApp((app) => new Library(app));
