/** Content of the library and its selection; loaded again when the server reports a change. */
import { computed, effect, signal } from "@preact/signals";
import { Prefetch } from "../../recordings/prefetch";
import { type LibraryChoice, chosen, withReceiving } from "../../recordings/library-filter";
import { recordingsApi, upload } from "../../recordings/api";
import type { EditRequest, RecordingInfo } from "../../wire/recording-types";
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
  readonly selected = signal<string | undefined>(undefined);
  /** The last deletion, until the next action. */
  readonly gone = signal<RecordingInfo | undefined>(undefined);
  readonly coming = signal<readonly Coming[]>([]);
  readonly shown = computed(() => chosen(this.all.value ?? [], this.choice.value));
  readonly current = computed(() => this.all.value?.find(({ id }) => id === this.selected.value));
  readonly prefetch = new Prefetch();
  readonly #app: App;
  #asked = 0;
  #keys = 0;
  #edited = Promise.resolve();

  constructor(app: App) {
    this.#app = app;
  }

  choose(part: Partial<LibraryChoice>): void {
    this.choice.value = { ...this.choice.peek(), ...part };
  }

  /** Load the list; an answer overtaken by a later one is ignored. */
  async #load(): Promise<void> {
    const mine = ++this.#asked;
    const outcome = await recordingsApi.list();
    if (mine !== this.#asked) return;
    if (outcome.ok) this.all.value = outcome.value.map(withReceiving);
    this.trouble.value = outcome.ok ? undefined : outcome.problem;
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
    if (this.selected.peek() === id) this.selected.value = info.id;
  }

  async remove(info: RecordingInfo): Promise<void> {
    const deleted = await run(this.#app, recordingsApi.remove(info.id));
    if (deleted === undefined) return;
    this.gone.value = deleted;
    this.#replace(deleted);
    if (this.selected.peek() === info.id) this.selected.value = undefined;
  }

  async undelete(id: string): Promise<void> {
    const back = await run(this.#app, recordingsApi.undelete(id));
    if (back === undefined) return;
    this.gone.value = undefined;
    this.#replace(back);
    this.selected.value = back.id;
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
        this.selected.value = outcome.value.id;
        this.dismiss(key);
      } else change({ problem: outcome.problem });
    }
  }

  dismiss(key: number): void {
    this.coming.value = this.coming.peek().filter((one) => one.key !== key);
  }
}

export const libraryOf = perApp((app) => new Library(app));
