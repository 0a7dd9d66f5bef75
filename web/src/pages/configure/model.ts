/**
 * Model of a device on the Configure page: its forms, present values, edits, and the server's answers on these.
 *
 *     forms ── GET ──┐                  ┌─ toApply ──▶ Apply
 *     present ─ GET ─┤─ drafts (edits) ─┤
 *                    │                  └─ preview, 150 ms after the last key ──▶ bytes, problems, load
 *     jobs arrive over the WebSocket
 *
 * A draft is dropped when the device has it, and rebased on changes by other users (forms/rebase.ts). Models outlive a change of page,
 * so edits stay. They are for one sensor, known by its serial number: if another one comes to the device's place, they are put aside
 * until it is back, on whichever port; a page that is reloaded has them too, as long as its tab is open. All state of one device is here; modules keep none.
 */
import { batch, computed, effect, type ReadonlySignal, type Signal, signal, untracked } from "@preact/signals";
import type { Store } from "../../data/store";
import { capacityAt, overWords, ratesOf } from "../../forms/budget";
import { countOf, current, type Drafts, type Present, sameSetting, toApply } from "../../forms/edits";
import { type RemoteChange, rebase } from "../../forms/rebase";
import { indexOf } from "../../forms/search";
import type {
  CommandForm,
  Forms,
  LoadInfo,
  PreviewResult,
  SettingForm,
  SnapshotBody,
  SnapshotInfo,
} from "../../wire/form-types";
import { initials, joined, type Path, put, type FormValues, whereOf } from "../../forms/values";
import type { Outcome, HttpProblem } from "../../requests/http";
import { fullName, linkName, writeName } from "../../wire/device-name";
import type { DeviceJobs, DeviceInfo } from "../../wire/types";
import type { App } from "../../page/context";
import { configureApi } from "./api";
import { Previews } from "./previews";
import { type ConfigureState, configureOf } from "./view-state";
import { isViewOnly } from "../../wire/capabilities";
import { TEXT } from "../../texts/configure";

const UNDO_KEPT = 100;

const NONE: Drafts = {};

/** Edits for one sensor. */
export interface Edits {
  readonly drafts: Drafts;
  readonly arguments: Drafts;
  readonly reason: string;
  readonly undo: readonly Drafts[];
  readonly bases: Drafts;
}

export interface Fitting {
  readonly setting: string;
  readonly words: readonly string[];
  readonly draft: FormValues | undefined;
}

export class Model {
  readonly forms: Signal<Forms | undefined> = signal(undefined);
  readonly body: Signal<SnapshotBody | undefined> = signal(undefined);
  readonly snapshots: Signal<readonly SnapshotInfo[]> = signal([]);
  readonly drafts: Signal<Drafts> = signal(NONE);
  /** Arguments of commands, as typed so far. */
  readonly arguments: Signal<Drafts> = signal(NONE);
  /** The server's answers on a draft ("Setting"), on the device's values ("=Setting"), on a command ("!Command"). */
  readonly previews: Signal<Readonly<Record<string, PreviewResult>>> = signal({});
  /** Unreadable input: `Setting/path` → why. */
  readonly wrong: Signal<ReadonlyMap<string, string>> = signal(new Map());
  /** Why the forms cannot be shown, or the last request failed. */
  readonly problem: Signal<HttpProblem | undefined> = signal(undefined);
  /** Counts how often forms and values were loaded: again after each connection. */
  readonly loads = signal(0);
  /** Number of discards or undos of each setting's edits, which reset typed texts. */
  readonly epochs: Signal<Readonly<Record<string, number>>> = signal({});
  /** Changes by other users in settings being edited here. */
  readonly elsewhere: Signal<readonly RemoteChange[]> = signal([]);
  /** The row under the pointer: a path of the shown setting. Row, bytes and share are highlighted together. */
  readonly hot: Signal<string> = signal("");
  /** The user's reason for the change; stored with the snapshot. */
  readonly reason: Signal<string> = signal("");
  /** The job of the last Apply, until it is dismissed. */
  readonly applied: Signal<number | undefined> = signal(undefined);
  /** The jobs of commands, by name. */
  readonly sent: Signal<Readonly<Record<string, number>>> = signal({});
  /** The job that restores communication. */
  readonly restoring: Signal<number | undefined> = signal(undefined);
  /** The result of "Fit to link", and its draft. */
  readonly fitting: Signal<Fitting | undefined> = signal(undefined);
  /** The left side of the page Compare, and the file that was opened there. */
  readonly left: Signal<string> = signal("device");
  readonly file: Signal<{ readonly name: string; readonly text: string } | undefined> = signal(undefined);
  /** The job that reads all settings, if requested. */
  readonly lastRead: Signal<number | undefined> = signal(undefined);

  readonly present: ReadonlySignal<Present> = computed(() => this.body.value?.values ?? {});
  readonly isRead = computed(() => (this.body.value?.info.taken ?? 0) > 0);
  readonly index = computed(() => (this.forms.value ? indexOf(this.forms.value) : []));
  readonly rates = computed(() => (this.forms.value ? ratesOf(this.forms.value) : []));
  readonly changes = computed(() =>
    this.forms.value ? toApply(this.forms.value, this.present.value, this.drafts.value) : {},
  );
  /** Edits of each setting, by name. */
  readonly counts = computed(() => {
    const found = new Map<string, number>();
    for (const form of this.forms.value?.settings ?? []) {
      const count =
        this.drafts.value[form.name] && this.changes.value[form.name]
          ? countOf(form, this.present.value[form.name], this.drafts.value[form.name])
          : 0;
      if (count > 0) found.set(form.name, count);
    }
    return found;
  });
  readonly jobs: ReadonlySignal<DeviceJobs | undefined>;
  readonly device: ReadonlySignal<DeviceInfo | undefined>;
  /** What was put aside when another sensor came: the sensor, and the number of its settings with edits. */
  readonly putAside: Signal<{ readonly of: string; readonly count: number } | undefined> = signal(undefined);

  readonly asking = new Previews(this);
  /** Forms that are shown once the values have arrived: values that were read are never shown as "never read". */
  #coming: Forms | undefined;
  /** Of requests for the values: an answer that a later one has overtaken is old. */
  #turn = 0;
  #newest = Promise.resolve();
  #undo: Drafts[] = [];
  /** The device's values when a draft was begun, or last rebased. */
  #bases: Drafts = {};
  /** The key of the sensor that the edits are for; "" until its serial number is known. */
  #sensor = "";
  #sensorName = "";

  constructor(
    readonly id: string,
    readonly store: Store,
    readonly page: ConfigureState,
  ) {
    page.models.set(id, this);
    this.jobs = computed(() => store.jobs.value.get(id));
    this.device = computed(() => store.devices.value.find((device) => device.id === id));
    const sensor = computed(() => (this.device.value?.serial_number ? this.device.value.key : ""));
    effect(() => {
      if (sensor.value !== "") untracked(() => this.#serve(sensor.value));
    });
    effect(() => {
      void [this.drafts.value, this.arguments.value, this.reason.value];
      untracked(() => page.storeEdits());
    });
    const who = computed(() =>
      [
        this.device.value?.protocol,
        this.device.value?.product,
        this.device.value?.serial_number,
        store.connection.value,
      ].join("|"),
    );
    effect(() => {
      void who.value;
      if (this.device.peek()?.protocol && store.connection.peek() === "open") void this.load();
    });
    effect(() => {
      if (this.jobs.value !== undefined) return;
      // another run of the server renumbers jobs
      this.applied.value = this.restoring.value = this.lastRead.value = undefined;
      this.sent.value = {};
    });
    const finished = computed(() => this.jobs.value?.done[0]?.id ?? 0);
    effect(() => {
      if (finished.value > 0) void this.refresh();
    });
  }

  // ---- names

  /** The device with all that tells it from others. */
  get fullName(): string {
    const device = this.device.value;
    return device === undefined ? "" : fullName(device);
  }

  get linkName(): string {
    return linkName(this.id, this.store.devices.value);
  }

  /** What a request that writes calls the device. */
  get writeName(): string {
    return this.writeNameOf(this.id);
  }

  writeNameOf(id: string): string {
    return writeName(id, this.store.devices.peek());
  }

  // ---- edits of another sensor

  /** Edit this sensor from now on; edits of the sensor before are put aside, own ones that were put aside are back. */
  #serve(sensor: string): void {
    if (sensor !== this.#sensor && this.#sensor !== "") {
      const count = Object.keys(this.drafts.peek()).length;
      const of = this.#sensorName;
      const edits = this.#release();
      if (edits !== undefined) this.page.aside.set(this.#sensor, edits);
      this.putAside.value = count > 0 ? { of, count } : undefined;
      this.body.value = undefined;
      this.previews.value = {};
      this.lastRead.value = undefined;
    }
    const isNew = sensor !== this.#sensor;
    this.#sensor = sensor;
    this.#sensorName = this.fullName;
    if (isNew) this.#adopt(sensor);
  }

  #adopt(sensor: string): void {
    const elsewhere = [...this.page.models.values()].find(
      (one) => one !== this && one.#sensor === sensor && one.device.peek()?.key !== sensor,
    );
    const edits = this.page.aside.get(sensor) ?? (elsewhere === undefined ? undefined : elsewhere.#release());
    this.page.aside.delete(sensor);
    if (edits === undefined || Object.keys(this.drafts.peek()).length > 0) return;
    this.drafts.value = edits.drafts;
    this.arguments.value = edits.arguments;
    this.reason.value = edits.reason;
    this.#undo = [...edits.undo];
    this.#bases = edits.bases;
    for (const key of Object.keys(edits.drafts)) this.asking.request(key);
  }

  /** The edits, with the key of their sensor; undefined if there are none. */
  get edits(): readonly [sensor: string, Edits] | undefined {
    const [drafts, args, reason] = [this.drafts.peek(), this.arguments.peek(), this.reason.peek()];
    if (this.#sensor === "" || Object.keys(drafts).length + Object.keys(args).length === 0) return undefined;
    return [this.#sensor, { drafts, arguments: args, reason, undo: this.#undo, bases: this.#bases }];
  }

  /** Give the edits away; undefined if there are none. */
  #release(): Edits | undefined {
    const edits = this.edits?.[1];
    this.drafts.value = NONE;
    this.arguments.value = NONE;
    this.reason.value = "";
    this.#undo = [];
    this.#bases = {};
    this.wrong.value = new Map();
    this.elsewhere.value = [];
    this.fitting.value = undefined;
    this.applied.value = undefined;
    this.sent.value = {};
    this.#forget(undefined);
    return edits;
  }

  // ---- from the server

  async load(): Promise<void> {
    const forms = await configureApi.forms(this.id);
    this.problem.value = forms.ok ? undefined : forms.problem;
    if (!forms.ok) return;
    this.#coming = forms.value;
    if (this.forms.peek() !== undefined) this.forms.value = forms.value;
    this.loads.value = this.loads.peek() + 1;
    await this.refresh();
    this.forms.value = this.#coming;
  }

  /** Load present values and snapshots, as in the newest answer. Drafts equal to them are dropped. */
  refresh(): Promise<void> {
    return (this.#newest = this.#refresh(++this.#turn));
  }

  async #refresh(turn: number): Promise<void> {
    const [body, snapshots] = await Promise.all([configureApi.values(this.id), configureApi.snapshots(this.id)]);
    if (turn !== this.#turn) return this.#newest;
    if (snapshots.ok) this.snapshots.value = snapshots.value;
    if (!body.ok) return;
    const measured = this.forms.peek()?.settings.some(({ table }) => table !== null && table.interval !== "");
    if (measured && body.value.info.taken !== this.body.peek()?.info.taken) {
      const forms = await configureApi.forms(this.id); // streams that are off also get rates of the device once it was read
      if (turn !== this.#turn) return this.#newest;
      if (forms.ok) this.forms.value = forms.value;
    }
    batch(() => {
      this.forms.value ??= this.#coming;
      if (this.forms.peek() !== undefined) this.#follow(body.value.values);
      this.body.value = body.value;
      this.previews.value = {};
    });
    this.asking.again();
  }

  /** Rebase drafts on present values, and report changes by other users in them. */
  #follow(now: Present): void {
    const finished = this.jobs.peek()?.done[0]?.id;
    const isOurs = finished !== undefined && finished === this.applied.peek(); // values altered by the device are reported with the job
    const reported: RemoteChange[] = [];
    const rebased = (drafts: Drafts, tell: boolean): Drafts =>
      Object.fromEntries(
        Object.entries(drafts).flatMap(([name, draft]) => {
          const [form, base, theirs] = [this.setting(name), this.#bases[name], now[name]];
          if (form === undefined || theirs === undefined) return [[name, draft]];
          if (base === undefined || sameSetting(form, base, theirs))
            return sameSetting(form, theirs, draft) ? [] : [[name, draft]];
          const found = rebase(form, base, draft, theirs);
          if (tell && !isOurs) reported.push(...found.elsewhere);
          return sameSetting(form, theirs, found.draft) ? [] : [[name, found.draft]];
        }),
      );
    this.#undo = this.#undo.map((before) => rebased(before, false));
    const drafts = rebased(this.drafts.peek(), true);
    this.drafts.value = drafts;
    this.#bases = Object.fromEntries(
      Object.keys({ ...this.#bases, ...drafts }).flatMap((name) => (now[name] ? [[name, now[name]]] : [])),
    );
    if (reported.length > 0)
      this.elsewhere.value = [
        ...this.elsewhere.peek().filter((one) => !reported.some(({ setting }) => setting === one.setting)),
        ...reported,
      ];
  }

  /** The device's values when these settings were edited: the server does not overwrite another user's change. */
  basesOf(names: readonly string[]): Drafts {
    return Object.fromEntries(names.flatMap((name) => (this.#bases[name] ? [[name, this.#bases[name]]] : [])));
  }

  /** Shows the problem of a request, if any. */
  async run<T>(request: Promise<Outcome<T>>): Promise<T | undefined> {
    const outcome = await request;
    this.problem.value = outcome.ok ? undefined : outcome.problem;
    return outcome.ok ? outcome.value : undefined;
  }

  /** Read all settings; `confirmed`: even if that discards unfinished work of a command. */
  async readAll(confirmed = false): Promise<void> {
    const job = await this.run(configureApi.read(this.id, confirmed));
    this.lastRead.value = job?.id;
  }

  // ---- edits

  setting(name: string): SettingForm | undefined {
    return this.forms.value?.settings.find((form) => form.name === name);
  }

  command(name: string): CommandForm | undefined {
    return this.forms.value?.commands.find((form) => form.name === name);
  }

  /** A setting after the edits; if never read, the initial values of the tables. */
  valuesOf(form: SettingForm): FormValues {
    return current(this.present.value, this.drafts.value, form.name) ?? (form.partial ? {} : initials(form.fields));
  }

  /** Whether a setting has values of the device or of the user. */
  isKnown(form: SettingForm): boolean {
    return current(this.present.value, this.drafts.value, form.name) !== undefined;
  }

  argumentsOf(form: CommandForm): FormValues {
    const held = this.present.value[form.writes] ?? {}; // a form that writes a setting opens with what the device has
    const own = Object.fromEntries(
      form.arguments.flatMap(({ name }) => (held[name] === undefined ? [] : [[name, held[name]]])),
    );
    return this.arguments.value[form.name] ?? { ...initials(form.arguments), ...own };
  }

  edit(form: SettingForm, path: Path, value: unknown): void {
    this.#remember();
    this.problem.value = undefined; // it was about what is changed now
    const draft = put(this.valuesOf(form), path, value);
    const { [form.name]: begun, ...others } = this.drafts.peek();
    const before = this.present.peek()[form.name];
    if (begun === undefined && before !== undefined) this.#bases = { ...this.#bases, [form.name]: before };
    this.drafts.value = sameSetting(form, before, draft) ? others : { ...others, [form.name]: draft };
    this.asking.request(form.name);
  }

  fill(form: CommandForm, path: Path, value: unknown): void {
    this.arguments.value = { ...this.arguments.peek(), [form.name]: put(this.argumentsOf(form), path, value) };
    this.asking.request(`!${form.name}`);
  }

  /** Discard edits: of one setting, or all. */
  discard(name?: string): void {
    this.#remember();
    this.problem.value = undefined;
    const left = Object.entries(this.drafts.peek()).filter(([key]) => name !== undefined && key !== name);
    this.drafts.value = Object.fromEntries(left);
    this.wrong.value = new Map(
      [...this.wrong.peek()].filter(([key]) => name !== undefined && !key.startsWith(`${name}/`)),
    );
    this.elsewhere.value = this.elsewhere.peek().filter(({ setting }) => name !== undefined && setting !== name);
    this.#forget(name);
    this.asking.again();
  }

  undo(): void {
    const before = this.#undo.pop();
    if (before === undefined) return;
    this.drafts.value = before;
    this.#forget(undefined);
    this.asking.again();
  }

  /** Discard invalid input with the edits; of one setting, or all. */
  #forget(name: string | undefined): void {
    const names = name === undefined ? (this.forms.peek()?.settings.map((form) => form.name) ?? []) : [name];
    const epochs = this.epochs.peek();
    this.epochs.value = { ...epochs, ...Object.fromEntries(names.map((one) => [one, (epochs[one] ?? 0) + 1])) };
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

  /** The line's rate after all edits; undefined if none changes it. */
  readonly baud = computed(() => {
    const now = this.device.value?.baud ?? undefined;
    for (const name of Object.keys(this.changes.value)) {
      const preview = this.previews.value[name];
      const baud = preview?.line ? preview.load?.baud : undefined;
      if (baud && baud !== now) return baud;
    }
    return undefined;
  });

  /** The newest load of all outputs in a preview. */
  loadOf(name: string): LoadInfo | null {
    return this.previews.value[name]?.load ?? null;
  }

  /** Why nothing can be written now; "" if it can. */
  readonly blocked = computed(() => {
    const names = Object.keys(this.changes.value);
    if (isViewOnly.value) return TEXT.viewOnlyChange;
    for (const [key, why] of this.wrong.value) {
      const [owner = "", path = ""] = key.split("/");
      const form = this.setting(owner);
      if (form) return `${whereOf(form, path)}: ${why}`;
    }
    for (const name of names) {
      const [problem] = this.previews.value[name]?.problems ?? [];
      const form = this.setting(name);
      if (problem && form) return `${whereOf(form, problem.path)}: ${problem.message}`;
    }
    for (const name of names) {
      const load = this.loadOf(name);
      const why = this.setting(name)?.table ? overWords(load, this.baud.value) : "";
      if (why) return why;
    }
    const device = this.device.value;
    // a device that is silent on an open link may still answer: its streams were stopped, or it is in the config state
    const isGone = device !== undefined && (device.status === "denied" || device.status === "ended" || !device.is_open);
    return isGone ? TEXT.deviceUnreachable : "";
  });

  /** Capacity at the rate in effect after the edits. */
  capacity(load: LoadInfo): number | null {
    return capacityAt(load, this.baud.value);
  }
}

/** The model of a device on a page; created on first use. */
export function modelOf(id: string, app: App): Model {
  const page = configureOf(app);
  return page.models.get(id) ?? new Model(id, app.store, page);
}
