/**
 * The record button, in the bar of every page: one click starts, one stops; the recording is then shown with a link to it, and problems
 * during recording are shown beside it.
 */
import { effect, signal } from "@preact/signals";
import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { recordingsApi } from "../recordings/api";
import { bytes, length } from "../recordings/library-filter";
import { Button } from "../ui/controls/button";
import { age, clock } from "../ui/format/format";
import { IconButton } from "../ui/controls/icon-button";
import type { RecorderState } from "../wire/types";
import { perApp, run } from "../page/app-state";
import type { App } from "../page/context";
import { href, route } from "../page/route";
import { isViewOnly } from "../wire/capabilities";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/live";

/** With a longer delay, s, or less time left on the disk, s, it needs attention. */
const BEHIND_S = 0.5;
const LEFT_S = 900;
/** How long the button confirms a marker, ms. */
const SAID_MS = 2500;
/** How long a recording that has ended is offered, ms; the list has it from then on. */
const SAVED_MS = 60_000;

/** A recording that has ended, until it is dismissed. */
export interface Saved {
  readonly id: string;
  readonly title: string;
}

class RecordState {
  readonly saved = signal<Saved | undefined>(undefined);
  /** Time at which a note was begun, unix s: its position, however long it takes to write. */
  readonly noteAt = signal<number | undefined>(undefined);
  /** Confirmation of the last marker or note. */
  readonly said = signal("");
  /** Whether the button shows its second key, after the first was pressed. */
  readonly asking = signal(false);
  #timer: ReturnType<typeof setTimeout> | undefined;

  say(words: string): void {
    this.said.value = words;
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => {
      this.said.value = "";
      this.asking.value = false;
    }, SAID_MS);
  }
}

/** Shows a recording that was made from memory, with a link to it. */
export function showSaved(app: App, saved: Saved): void {
  recordOf(app).saved.value = saved;
}

const recordOf = perApp(() => new RecordState());

/** The recording that ended between `before` and `now`; undefined while it goes on, and if it failed. */
export function endedOf(
  before: RecorderState | undefined,
  now: RecorderState | undefined,
  names: readonly string[] = [],
): Saved | undefined {
  if (!before?.running || !now || now.running || now.message !== "") return undefined;
  return { id: before.id, title: before.title || [...new Set(names)].join(" + ") || before.id };
}

export const isRecording = (app: App): boolean => app.store.recorder.value?.running === true;

export async function toggleRecord(app: App): Promise<void> {
  await run(
    app,
    isRecording(app)
      ? recordingsApi.stop()
      : recordingsApi.start({ devices: null, title: "", before_s: 0, with_head: null }),
  );
}

/** Handles a press. The second click of a double click is ignored: it would end what the first began. */
const press =
  (app: App) =>
  ({ detail }: MouseEvent): void =>
    void (detail < 2 && toggleRecord(app));

/** The first press only shows the second key: it lies beside keys that are pressed often. */
export function askForRecord(app: App): void {
  const state = recordOf(app);
  state.asking.value = true;
  state.say(isRecording(app) ? TEXT.shiftREndsRecording : TEXT.shiftRRecords);
}

/** Drop a marker now. */
export async function mark(
  app: App,
  text = "",
  kind: "marker" | "note" = "marker",
  time = app.store.serverNow(),
): Promise<void> {
  const done = await run(app, recordingsApi.mark({ text, kind, time, device: "" }));
  if (done === undefined) return;
  recordOf(app).say(TEXT.markerSet(kind === "note" ? TEXT.note : COMMON.marker, clock(time)));
}

/** Ask for the words of a note at this time. */
export function beginNote(app: App): void {
  if (isRecording(app)) recordOf(app).noteAt.value = app.store.serverNow();
}

/** Shows on every page that a recording stopped by itself. */
export function watchRecorder(app: App): void {
  const { saved } = recordOf(app);
  let shownMessage = "";
  let before: RecorderState | undefined;
  effect(() => {
    const now = app.store.recorder.value;
    const recorded = app.store.devices
      .peek()
      .filter(({ id, last_arrival: last }) => before?.devices.includes(id) && last !== null);
    const ended = endedOf(
      before,
      now,
      recorded.map(({ name }) => name),
    );
    if (ended) saved.value = ended;
    else if (now?.running) saved.value = undefined;
    before = now;
  });
  effect(() => {
    if (app.store.connection.value !== "open" || app.store.recorder.peek() !== undefined) return;
    void recordingsApi.recorder().then((outcome) => {
      if (outcome.ok) app.store.recorder.value ??= outcome.value;
    });
  });
  effect(() => {
    const state = app.store.recorder.value;
    const message = state?.message ?? "";
    if (state && message !== "" && message !== shownMessage)
      app.problem.value = { kind: "recorder", message, hint: state.hint, status: 0 };
    shownMessage = message;
  });
}

export function Record({ app }: { readonly app: App }) {
  const { asking, said, noteAt } = recordOf(app);
  const state = app.store.recorder.value;
  void app.tick.value;
  if (!state) return null;
  if (!state.running && isViewOnly.value) {
    return (
      <span class="tag view-only" title={COMMON.viewOnlyHint}>
        {COMMON.viewOnly}
      </span>
    );
  }
  if (!state.running) {
    return (
      <>
        <Button
          changes
          look="edge record-button"
          aria-label={TEXT.record}
          title={TEXT.recordAllDevices}
          disabled={app.store.devices.value.length === 0}
          onClick={press(app)}
        >
          <i class="record-dot" />
          <span class="desk">{asking.value ? TEXT.shiftR : TEXT.record}</span>
        </Button>
        <FromMemory app={app} />
        <Said words={said.value} />
      </>
    );
  }
  const size = bytes(state.bytes);
  const time = length(state.started === null ? null : Math.max(0, app.store.serverNow() - state.started));
  const behind = state.behind_s > BEHIND_S ? TEXT.behindBy(age(state.behind_s).value, age(state.behind_s).unit) : "";
  const left =
    state.seconds_left !== null && state.seconds_left < LEFT_S ? TEXT.diskFullIn(length(state.seconds_left)) : "";
  return (
    <>
      {(behind || left) && (
        <span class="tag warn" role="status">
          {[left, behind].filter(Boolean).join(", ")}
        </span>
      )}
      <Button
        changes
        look="stop-recording"
        aria-label={TEXT.stopRecordingState(time, size.value, size.unit)}
        title={TEXT.stopRecordingTitle(state.title || state.id)}
        onClick={press(app)}
      >
        <i class="record-dot" />
        <span class="recording-time">{asking.value ? TEXT.shiftR : time}</span>
        <span class="recording-size mid desk">
          {size.value}
          <span class="unit">{size.unit}</span>
        </span>
      </Button>
      <IconButton
        changes
        class={`flag ${said.value && !asking.value ? "just-done" : ""}`}
        icon="flag"
        label={TEXT.addMarker}
        title={TEXT.addMarkerHint}
        onClick={(event) => void (event.shiftKey ? beginNote(app) : mark(app))}
      />
      {state.headless.length > 0 && (
        <IconButton
          changes
          icon="paper"
          label={TEXT.readHeader(state.headless.join(", "))}
          onClick={() => void run(app, recordingsApi.readHeaders())}
        />
      )}
      <FromMemory app={app} />
      {noteAt.value !== undefined && <Note app={app} time={noteAt.value} />}
      <Said words={said.value} />
    </>
  );
}

/** What was not recorded, from memory: beside the button on Live. */
function FromMemory({ app }: { readonly app: App }) {
  if (route.value.page !== "live" || app.store.devices.value.length === 0) return null;
  return (
    <IconButton
      changes
      icon="down"
      label={TEXT.saveFromMemory}
      class="from-memory"
      title={TEXT.saveFromMemoryHint}
      onClick={() => (app.overlay.value = "memory")}
    />
  );
}

/** The last or next action, in words for screen readers, and the line on the plots. */
function Said({ words }: { readonly words: string }) {
  return (
    <span class="visually-hidden" role="status">
      {words}
    </span>
  );
}

/** A recording that has ended, with its link; a band on every page but that of the recordings, for a minute. */
export function SavedBand({ app }: { readonly app: App }) {
  const { saved } = recordOf(app);
  const one = saved.value;
  const { page, recording } = route.value;
  const isListed = page === "recordings" && recording === undefined; // the list has it, with its length and size
  useEffect(() => {
    if (one === undefined) return undefined;
    if (isListed) saved.value = undefined;
    const timer = setTimeout(() => (saved.value = undefined), SAVED_MS);
    return () => clearTimeout(timer);
  }, [one, isListed, saved]);
  if (!one || isListed) return null;
  const close = (): void => {
    saved.value = undefined;
  };
  return (
    <div class="band calm saved" role="status">
      <b class="ellipsis">{TEXT.recordingSaved(one.title)}</b>
      <span class="grow" />
      <a class="btn edge" href={href("recordings", one.id)} onClick={close}>
        {COMMON.open}
      </a>
      <IconButton icon="close" label={COMMON.close} onClick={close} />
    </div>
  );
}

/** The words of a note, in a field under the bar. */
function Note({ app, time }: { readonly app: App; readonly time: number }) {
  const field = useRef<HTMLInputElement>(null);
  useLayoutEffect(() => field.current?.focus(), []); // before the next key is pressed: it belongs to the note
  const close = (): void => {
    recordOf(app).noteAt.value = undefined;
  };
  const send = (event: Event): void => {
    event.preventDefault();
    void mark(app, field.current?.value.trim() ?? "", "note", time);
    close();
  };
  return (
    <form class="note-form" onSubmit={send} onKeyDown={(event) => event.key === "Escape" && close()}>
      <label class="field">
        <span class="visually-hidden">{TEXT.noteAt(clock(time))}</span>
        <input ref={field} maxLength={2000} placeholder={TEXT.noteAt(clock(time))} />
      </label>
      <Button changes type="submit" look="main" words={COMMON.save} />
      <IconButton icon="close" label={TEXT.discardNote} onClick={close} />
    </form>
  );
}
