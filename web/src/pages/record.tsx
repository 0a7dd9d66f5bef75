/** The record button, in the bar of every page: one click begins, one ends; what goes wrong while recording stands beside it. */
import { effect, signal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { server } from "../recordings/server";
import { bytes, length } from "../recordings/listing";
import { age, clock } from "../ui/format";
import { Icon } from "../ui/icons";
import { type App, problem, run, tick } from "./app";

/** Behind by more than this, s, or with less than this left on the disk, s, it wants to be read. */
const BEHIND_S = 0.5;
const LEFT_S = 900;
/** How long the button says that a marker was dropped, ms. */
const SAID_MS = 2500;

/** When a note was begun, unix s: it is put there, however long it takes to write. */
const noteAt = signal<number | undefined>(undefined);
/** What was dropped last, in words. */
const said = signal("");

export const isRecording = (app: App): boolean => app.store.recorder.value?.running === true;

export async function toggleRecord(app: App): Promise<void> {
  await run(isRecording(app) ? server.stop() : server.start({ devices: null, title: "" }));
}

/** Drop a marker now. */
export async function mark(app: App, text = "", kind: "marker" | "note" = "marker", time = app.store.serverNow()): Promise<void> {
  const done = await run(server.mark({ text, kind, time, device: "" }));
  if (done === undefined) return;
  said.value = `${kind === "note" ? "Note" : "Marker"} at ${clock(time)}`;
  setTimeout(() => (said.value = ""), SAID_MS);
}

/** Ask for the words of a note that belongs here. */
export function beginNote(app: App): void {
  if (isRecording(app)) noteAt.value = app.store.serverNow();
}

/** A recording that stopped by itself says so on whatever page is open. */
export function watchRecorder(app: App): void {
  let told = "";
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
      <button type="button" class="btn edge recbtn" aria-label="Record" title="Record every device (R)" disabled={app.store.devices.value.length === 0} onClick={() => void toggleRecord(app)}>
        <i class="recdot" />
        <span class="desk">Record</span>
      </button>
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
      <button type="button" class="rec" aria-label={`Stop recording, ${time}, ${size.value} ${size.unit}`} title={`Stop recording ${state.title || state.id} (R)`} onClick={() => void toggleRecord(app)}>
        <i class="recdot" />
        <span class="rectime">{time}</span>
        <span class="recsize desk">
          {size.value}
          <span class="u">{size.unit}</span>
        </span>
      </button>
      <button type="button" class={`btn icon flag ${said.value ? "just" : ""}`} aria-label="Drop a marker" title="Drop a marker (M); with words: Shift M" onClick={(event) => void (event.shiftKey ? beginNote(app) : mark(app))}>
        <Icon name="flag" />
      </button>
      {noteAt.value !== undefined && <Note app={app} time={noteAt.value} />}
      <span class="vh" role="status">
        {said.value}
      </span>
    </>
  );
}

/** The words of a note, in a field under the bar. */
function Note({ app, time }: { readonly app: App; readonly time: number }) {
  const field = useRef<HTMLInputElement>(null);
  useEffect(() => field.current?.focus(), []);
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
