/**
 * What does the Configure page know of a device? Its forms, what it has now, what a person changed, and what the server says of that.
 *
 *     forms ── GET ──┐                  ┌─ toApply ──▶ Apply
 *     present ─ GET ─┤─ drafts (edits) ─┤
 *                    │                  └─ preview, 150 ms after the last key ──▶ bytes, problems, load
 *     control, exchange come by themselves over the WebSocket
 *
 * A draft is dropped when the device has it. Models outlive a change of page: what was typed stays.
 */
import { computed, effect, type ReadonlySignal, type Signal, signal } from "@preact/signals";
import type { Store } from "../../data/store";
import { capacityAt, overWords, ratesOf } from "../../forms/budget";
import { countOf, current, type Drafts, type Present, toApply } from "../../forms/edits";
import { indexOf } from "../../forms/search";
import type { CommandForm, Forms, LoadInfo, PreviewAnswer, SettingForm, SnapshotBody, SnapshotInfo } from "../../forms/types";
import { initials, joined, type Path, put, same, type Values } from "../../forms/values";
import { isRefusal, type Outcome, type Problem } from "../../ui/api";
import type { ControlState, DeviceInfo, ExchangeEntry } from "../../wire/types";
import { server } from "./server";

const PREVIEW_AFTER_MS = 150;
const UNDO_KEPT = 100;
const OLDER_BY = 200;

/** This token may look, not change: the server says so, or refuses a request for it. */
export const viewOnly = signal(false);
/** The row that the pointer is on: a path of the setting that is shown. Row, bytes and share light together. */
export const hot = signal("");

const NONE: Drafts = {};

export class Model {
  readonly forms: Signal<Forms | undefined> = signal(undefined);
  readonly body: Signal<SnapshotBody | undefined> = signal(undefined);
  readonly snapshots: Signal<readonly SnapshotInfo[]> = signal([]);
  readonly drafts: Signal<Drafts> = signal(NONE);
  /** Arguments of commands, as typed so far. */
  readonly arguments: Signal<Drafts> = signal(NONE);
  /** What the server says of a draft ("Setting"), of what the device has ("=Setting"), of a command ("!Command"). */
  readonly previews: Signal<Readonly<Record<string, PreviewAnswer>>> = signal({});
  /** What cannot even be read as a value: `Setting/path` → why. */
  readonly wrong: Signal<ReadonlyMap<string, string>> = signal(new Map());
  /** Why the forms cannot be shown, or the last request failed. */
  readonly problem: Signal<Problem | undefined> = signal(undefined);
  readonly older: Signal<readonly ExchangeEntry[]> = signal([]);
  readonly noOlder: Signal<boolean> = signal(false);
  /** The job that reads all settings, where a person asked for it. */
  readonly lastRead: Signal<number | undefined> = signal(undefined);

  readonly present: ReadonlySignal<Present> = computed(() => this.body.value?.values ?? {});
  readonly isRead = computed(() => (this.body.value?.info.taken ?? 0) > 0);
  readonly index = computed(() => (this.forms.value ? indexOf(this.forms.value) : []));
  readonly rates = computed(() => (this.forms.value ? ratesOf(this.forms.value) : []));
  readonly changes = computed(() => (this.forms.value ? toApply(this.forms.value, this.present.value, this.drafts.value) : {}));
  /** Edits of each setting, by name. */
  readonly counts = computed(() => {
    const found = new Map<string, number>();
    for (const form of this.forms.value?.settings ?? []) {
      const count = this.drafts.value[form.name] && this.changes.value[form.name] ? countOf(form, this.present.value[form.name], this.drafts.value[form.name]) : 0;
      if (count > 0) found.set(form.name, count);
    }
    return found;
  });
  readonly control: ReadonlySignal<ControlState | undefined>;
  readonly device: ReadonlySignal<DeviceInfo | undefined>;
  readonly exchange: ReadonlySignal<readonly ExchangeEntry[]>;

  #timers = new Map<string, ReturnType<typeof setTimeout>>();
  #asked = new Map<string, number>();
  #undo: Drafts[] = [];

  constructor(
    readonly id: string,
    store: Store,
  ) {
    this.control = computed(() => store.control.value.get(id));
    this.device = computed(() => store.devices.value.find((device) => device.id === id));
    this.exchange = computed(() => {
      const own = store.exchange.value.filter(({ device }) => device === id);
      const heard = new Set(own.map(({ seq }) => seq)); // what was missed while the connection was lost lies between them
      return [...this.older.value.filter(({ seq }) => !heard.has(seq)), ...own].sort((a, b) => a.seq - b.seq);
    });
    const who = computed(() => [this.device.value?.protocol, this.device.value?.product, this.device.value?.serial_number, store.connection.value].join("|"));
    effect(() => {
      void who.value;
      if (this.device.peek()?.protocol && store.connection.peek() === "open") void this.load();
    });
    const finished = computed(() => this.control.value?.done[0]?.id ?? 0);
    effect(() => {
      if (finished.value > 0) void this.refresh();
    });
  }

  // ---- from the server

  async load(): Promise<void> {
    const forms = await server.forms(this.id);
    this.problem.value = forms.ok ? undefined : forms.problem;
    if (!forms.ok) return;
    const build = await server.build();
    if (build.ok) viewOnly.value = build.value.role === "view";
    this.forms.value = forms.value;
    await Promise.all([this.refresh(), this.loadOlder(undefined)]);
  }

  /** What the device has now, and which snapshots there are. Drafts that it has by now are none any more. */
  async refresh(): Promise<void> {
    const [body, snapshots] = await Promise.all([server.values(this.id), server.snapshots(this.id)]);
    if (snapshots.ok) this.snapshots.value = snapshots.value;
    if (!body.ok) return;
    this.body.value = body.value;
    const left = Object.entries(this.drafts.peek()).filter(([name, draft]) => !same(body.value.values[name], draft));
    this.drafts.value = Object.fromEntries(left);
    this.previews.value = {};
    for (const key of this.#asked.keys()) this.preview(key);
  }

  async loadOlder(before = this.exchange.peek()[0]?.seq): Promise<void> {
    const found = await server.exchange(this.id, before, OLDER_BY);
    if (!found.ok) return;
    this.noOlder.value = found.value.length < OLDER_BY;
    const known = new Set(this.older.peek().map(({ seq }) => seq));
    this.older.value = [...found.value.filter(({ seq }) => !known.has(seq)), ...this.older.peek()].sort((a, b) => a.seq - b.seq);
  }

  /** Shows what went wrong, if anything did. */
  async run<T>(request: Promise<Outcome<T>>): Promise<T | undefined> {
    const outcome = await request;
    this.problem.value = outcome.ok ? undefined : outcome.problem;
    if (!outcome.ok && isRefusal(outcome.problem)) viewOnly.value = true;
    return outcome.ok ? outcome.value : undefined;
  }

  /** Ask the device for everything; `confirmed`: also where that discards what a command left unfinished. */
  async readAll(confirmed = false): Promise<void> {
    const job = await this.run(server.read(this.id, confirmed));
    this.lastRead.value = job?.id;
  }

  // ---- edits

  setting(name: string): SettingForm | undefined {
    return this.forms.value?.settings.find((form) => form.name === name);
  }

  command(name: string): CommandForm | undefined {
    return this.forms.value?.commands.find((form) => form.name === name);
  }

  /** A setting as it would be; of one that was never read, what the tables begin with. */
  valuesOf(form: SettingForm): Values {
    return current(this.present.value, this.drafts.value, form.name) ?? (form.partial ? {} : initials(form.fields));
  }

  argumentsOf(form: CommandForm): Values {
    return this.arguments.value[form.name] ?? initials(form.arguments);
  }

  edit(form: SettingForm, path: Path, value: unknown): void {
    this.#remember();
    const draft = put(this.valuesOf(form), path, value);
    const { [form.name]: _, ...others } = this.drafts.peek();
    this.drafts.value = same(this.present.peek()[form.name], draft) ? others : { ...others, [form.name]: draft };
    this.preview(form.name);
  }

  fill(form: CommandForm, path: Path, value: unknown): void {
    this.arguments.value = { ...this.arguments.peek(), [form.name]: put(this.argumentsOf(form), path, value) };
    this.preview(`!${form.name}`);
  }

  /** Take edits back: of one setting, or all. */
  discard(name?: string): void {
    this.#remember();
    const left = Object.entries(this.drafts.peek()).filter(([key]) => name !== undefined && key !== name);
    this.drafts.value = Object.fromEntries(left);
    this.wrong.value = new Map([...this.wrong.peek()].filter(([key]) => name !== undefined && !key.startsWith(`${name}/`)));
    for (const key of this.#asked.keys()) this.preview(key);
  }

  undo(): void {
    const before = this.#undo.pop();
    if (before === undefined) return;
    this.drafts.value = before;
    for (const key of this.#asked.keys()) this.preview(key);
  }

  #remember(): void {
    this.#undo = [...this.#undo.slice(1 - UNDO_KEPT), this.drafts.peek()];
  }

  setWrong(owner: string, path: Path, why: string | undefined): void {
    const key = `${owner}/${joined(path)}`;
    if (this.wrong.peek().get(key) === why) return;
    const next = new Map(this.wrong.peek());
    if (why === undefined) next.delete(key);
    else next.set(key, why);
    this.wrong.value = next;
  }

  // ---- previews

  /** Ask what the server says of a draft, a moment after the last key. */
  preview(key: string, afterMs = PREVIEW_AFTER_MS): void {
    clearTimeout(this.#timers.get(key));
    if (!this.#asked.has(key)) this.#asked.set(key, 0);
    this.#timers.set(key, setTimeout(() => void this.#ask(key), afterMs));
  }

  /** What is not on screen any more is not asked about. */
  forget(key: string): void {
    clearTimeout(this.#timers.get(key));
    if (!(key in this.drafts.peek())) this.#asked.delete(key);
  }

  async #ask(key: string): Promise<void> {
    const turn = (this.#asked.get(key) ?? 0) + 1;
    this.#asked.set(key, turn);
    const request = this.#request(key);
    const answer = request === undefined ? undefined : await request;
    if (this.#asked.get(key) !== turn) return; // a newer one is under way
    const { [key]: _, ...others } = this.previews.peek();
    if (answer === undefined) this.previews.value = others;
    else if (answer.ok) this.previews.value = { ...others, [key]: answer.value };
    else this.problem.value = answer.problem;
  }

  #request(key: string): Promise<Outcome<PreviewAnswer>> | undefined {
    if (key.startsWith("!")) {
      const command = this.command(key.slice(1));
      return command && server.previewCommand(this.id, command.name, this.argumentsOf(command));
    }
    const isPresent = key.startsWith("=");
    const form = this.setting(isPresent ? key.slice(1) : key);
    if (form === undefined || !form.writable) return undefined;
    const values = isPresent ? this.present.peek()[form.name] : form.partial ? this.changes.peek()[form.name] : this.valuesOf(form);
    if (values === undefined) return undefined;
    const own = form.fields.filter(({ name, read_only }) => !read_only && values[name] !== undefined);
    return server.previewSetting(this.id, form.name, Object.fromEntries(own.map(({ name }) => [name, values[name]])));
  }

  /** The rate that the line will have once all edits are written; undefined while none changes it. */
  readonly baud = computed(() => {
    const now = this.device.value?.baud ?? undefined;
    for (const name of Object.keys(this.changes.value)) {
      const preview = this.previews.value[name];
      const baud = preview?.line ? preview.load?.baud : undefined;
      if (baud && baud !== now) return baud;
    }
    return undefined;
  });

  /** The newest load of all outputs that some preview told. */
  loadOf(name: string): LoadInfo | null {
    return this.previews.value[name]?.load ?? null;
  }

  /** Why nothing can be written now; "" when it can. */
  readonly blocked = computed(() => {
    const names = Object.keys(this.changes.value);
    if (viewOnly.value) return "This page may look, not change: open it with a control token.";
    const title = (name: string): string => this.setting(name)?.title ?? name;
    for (const [key, why] of this.wrong.value) {
      const [owner = ""] = key.split("/");
      if (owner in this.drafts.value || this.setting(owner)) return `${title(owner)}: ${why}`;
    }
    for (const name of names) {
      const [problem] = this.previews.value[name]?.problems ?? [];
      if (problem) return `${title(name)}: ${problem.message}`;
    }
    for (const name of names) {
      const load = this.loadOf(name);
      const why = this.setting(name)?.editor ? overWords(load, this.baud.value) : "";
      if (why) return why;
    }
    const status = this.device.value?.status;
    return status === "lost" || status === "denied" || status === "ended" ? "The device is not reached." : "";
  });

  /** Capacity at the rate that will be in effect. */
  capacity(load: LoadInfo): number | null {
    return capacityAt(load, this.baud.value);
  }
}

const models = new Map<string, Model>();

/** The model of a device; made when it is first looked at. */
export function modelOf(id: string, store: Store): Model {
  const known = models.get(id) ?? new Model(id, store);
  models.set(id, known);
  return known;
}
