/**
 * The record button, in the bar of every page: one click begins, one ends, and what was recorded is told with a link to it; what goes
 * wrong while recording stands beside it.
 */
import { effect, signal } from "@preact/signals";
import { useLayoutEffect, useRef } from "preact/hooks";
import { server } from "../recordings/api";
import { bytes, length } from "../recordings/library-filter";
import { age, clock } from "../ui/format";
import { Icon } from "../ui/icons";
import type { RecorderState } from "../wire/types";
import { type App, problem, run, tick } from "./app-state";
import { href } from "./route";

/** Behind by more than this, s, or with less than this left on the disk, s, it wants to be read. */
const BEHIND_S = 0.5;
const LEFT_S = 900;
/** How long the button says that a marker was dropped, ms. */
const SAID_MS = 2500;

/** When a note was begun, unix s: it is put there, however long it takes to write. */
const noteAt = signal<number | undefined>(undefined);
/** What was dropped last, in words. */
const said = signal("");

/** A recording that has ended, until that was read. */
export interface Saved {
  readonly id: string;
  readonly title: string;
  /** s */
  readonly duration: number | null;
  readonly bytes: number;
}
export const saved = signal<Saved | undefined>(undefined);

/** What was recorded, when `now` follows `before`; undefined while it goes on, and where it failed. */
export function endedOf(before: RecorderState | undefined, now: RecorderState | undefined, at: number, names: readonly string[] = []): Saved | undefined {
  if (!before?.running || !now || now.running || now.message !== "") return undefined;
  return { id: before.id, title: before.title || [...new Set(names)].join(" + ") || before.id, duration: before.started === null ? null : at - before.started, bytes: Math.max(before.bytes, now.bytes) };
}

export const isRecording = (app: App): boolean => app.store.recorder.value?.running === true;

export async function toggleRecord(app: App): Promise<void> {
  await run(isRecording(app) ? server.stop() : server.start({ devices: null, title: "" }));
}

/** The key alone does nothing but say which one records: it lies beside those that are pressed often. */
export function askForRecord(app: App): void {
  asking.value = true;
  say(isRecording(app) ? "Shift R ends the recording" : "Shift R records");
}

/** The button shows its key, because half of that was pressed. */
const asking = signal(false);

function say(words: string): void {
  said.value = words;
  clearTimeout(saying);
  saying = setTimeout(() => {
    said.value = "";
    asking.value = false;
  }, SAID_MS);
}
let saying: ReturnType<typeof setTimeout> | undefined;

/** Drop a marker now. */
export async function mark(app: App, text = "", kind: "marker" | "note" = "marker", time = app.store.serverNow()): Promise<void> {
  const done = await run(server.mark({ text, kind, time, device: "" }));
  if (done === undefined) return;
  say(`${kind === "note" ? "Note" : "Marker"} at ${clock(time)}`);
}

/** Ask for the words of a note that belongs here. */
export function beginNote(app: App): void {
  if (isRecording(app)) noteAt.value = app.store.serverNow();
}

/** A recording that stopped by itself says so on whatever page is open. */
export function watchRecorder(app: App): void {
  let told = "";
  let before: RecorderState | undefined;
  effect(() => {
    const now = app.store.recorder.value;
    const heard = app.store.devices.peek().filter(({ id, last_arrival: last }) => before?.devices.includes(id) && last !== null);
    const ended = endedOf(before, now, app.store.serverNow(), heard.map(({ name }) => name));
    if (ended) saved.value = ended;
    else if (now?.running) saved.value = undefined;
    before = now;
  });
  effect(() => {
    if (app.store.connection.value !== "open" || app.store.recorder.peek() !== undefined) return;
    void server.recorder().then((outcome) => {
      if (outcome.ok) app.store.recorder.value ??= outcome.value;
    });
  });
  effect(() => {
    const state = app.store.recorder.value;
    const message = state?.message ?? "";
    if (state && message !== "" && message !== told) problem.value = { kind: "recorder", message, hint: state.hint, status: 0 };
    told = message;
  });
}

export function Record({ app }: { readonly app: App }) {
  const state = app.store.recorder.value;
  void tick.value;
  if (!state) return null;
  if (!state.running) {
    return (
      <>
        <button type="button" class="btn edge recbtn" aria-label="Record" title="Record every device (Shift R)" disabled={app.store.devices.value.length === 0} onClick={() => void toggleRecord(app)}>
          <i class="recdot" />
          <span class="desk">{asking.value ? "Shift R" : "Record"}</span>
        </button>
        <Said />
      </>
    );
  }
  const size = bytes(state.bytes);
  const time = length(state.started === null ? null : Math.max(0, app.store.serverNow() - state.started));
  const behind = state.behind_s > BEHIND_S ? `${age(state.behind_s).value} ${age(state.behind_s).unit} behind` : "";
  const left = state.seconds_left !== null && state.seconds_left < LEFT_S ? `disk full in ${length(state.seconds_left)}` : "";
  return (
    <>
      {(behind || left) && (
        <span class="tag warn" role="status">
          {[left, behind].filter(Boolean).join(", ")}
        </span>
      )}
      <button type="button" class="rec" aria-label={`Stop recording, ${time}, ${size.value} ${size.unit}`} title={`Stop recording ${state.title || state.id} (Shift R)`} onClick={() => void toggleRecord(app)}>
        <i class="recdot" />
        <span class="rectime">{asking.value ? "Shift R" : time}</span>
        <span class="recsize desk">
          {size.value}
          <span class="u">{size.unit}</span>
        </span>
      </button>
      <button type="button" class={`btn icon flag ${said.value && !asking.value ? "just" : ""}`} aria-label="Drop a marker" title="Drop a marker (M); with words: Shift M" onClick={(event) => void (event.shiftKey ? beginNote(app) : mark(app))}>
        <Icon name="flag" />
      </button>
      {noteAt.value !== undefined && <Note app={app} time={noteAt.value} />}
      <Said />
    </>
  );
}

/** What was just done, or is to be done: in words for who does not see the button change, and the line on the plots. */
function Said() {
  return (
    <span class="vh" role="status">
      {said.value}
    </span>
  );
}

/** A recording that has ended: where it is. In a band of its own on every page, until it is read. */
export function SavedBand() {
  const one = saved.value;
  if (!one) return null;
  const size = bytes(one.bytes);
  const close = (): void => {
    saved.value = undefined;
  };
  return (
    <div class="band calm saved" role="status">
      <b class="ell">{one.title} is recorded</b>
      <span class="mid">
        {length(one.duration)} · {size.value} {size.unit}
      </span>
      <span class="grow" />
      <a class="btn edge" href={href("recordings", one.id)} onClick={close}>
        Open
      </a>
      <button type="button" class="btn icon" aria-label="Close" onClick={close}>
        <Icon name="close" />
      </button>
    </div>
  );
}

/** The words of a note, in a field under the bar. */
function Note({ app, time }: { readonly app: App; readonly time: number }) {
  const field = useRef<HTMLInputElement>(null);
  useLayoutEffect(() => field.current?.focus(), []); // before the next key is pressed: it belongs to the words
  const close = (): void => {
    noteAt.value = undefined;
  };
  const send = (event: Event): void => {
    event.preventDefault();
    void mark(app, field.current?.value.trim() ?? "", "note", time);
    close();
  };
  return (
    <form class="notefield" onSubmit={send} onKeyDown={(event) => event.key === "Escape" && close()}>
      <label class="field">
        <span class="vh">Note at {clock(time)}</span>
        <input ref={field} maxLength={2000} placeholder={`Note at ${clock(time)}`} />
      </label>
      <button type="submit" class="btn main">
        Keep
      </button>
      <button type="button" class="btn icon" aria-label="No note" onClick={close}>
        <Icon name="close" />
      </button>
    </form>
  );
}
