/** Notes of a recording: a text whose times lead into the plots. Stored with the recording; on Live with the running one. */
import { useComputed, useSignal } from "@preact/signals";
import { useLayoutEffect, useRef } from "preact/hooks";
import type { Deps } from "../../page/context";
import { recordingsApi } from "../../recordings/api";
import type { RecordingInfo } from "../../wire/recording-types";
import { Button } from "../../ui/controls/button";
import type { Panel } from "../../ui/dom/dom";
import type { Outcome } from "../../requests/http";
import { ProblemNote } from "../../requests/problem-note";
import { Answered, useAnswer } from "../../requests/use-answer";
import { renderedPanel } from "../../panels/panel-host";
import { TEXT } from "./texts";
import { clock } from "../../ui/format/format";
import "./notes.css";

/** Room around a range that is shown, as a part of it. */
const MARGIN_SHARE = 0.25;
const CHANGED = "changed";

export function mountNotes(host: HTMLElement, deps: Deps): Panel {
  return renderedPanel(host, <NotesPanel deps={deps} />);
}

function NotesPanel({ deps }: { readonly deps: Deps }) {
  const running = useComputed(() => {
    const recorder = deps.store.recorder.value;
    return recorder?.running ? recorder.id : undefined;
  });
  const id = deps.recording?.id ?? running.value;
  if (id === undefined) return <p class="foot-note dim">{TEXT.noRecording}</p>;
  return <Notes key={id} deps={deps} id={id} />;
}

function Notes({ deps, id }: { readonly deps: Deps; readonly id: string }) {
  const { actions, cursor, measure } = deps.viewState;
  /** While they are edited: the text that was begun with, and the one that it replaces. */
  const edited = useSignal<{ readonly begun: string; readonly base: string } | undefined>(undefined);
  const cancelled = useSignal(0);
  const theirs = useSignal<string | undefined>(undefined);
  const field = useRef<HTMLTextAreaElement>(null);
  const read = async (): Promise<Outcome<RecordingInfo> | undefined> => {
    const list = await recordingsApi.list();
    const value = list.ok ? list.value.find((one) => one.id === id) : undefined;
    return value ? { ok: true, value } : list.ok ? undefined : list;
  };
  const isEditing = edited.value !== undefined;
  const { library } = deps.store; // incremented when a recording changes; not looked at while one writes
  const turn = useRef(0);
  if (!isEditing) turn.current = library.value;
  const stored = useAnswer(`${id} ${turn.current} ${cancelled.value}`, read);
  useLayoutEffect(() => field.current?.focus(), [isEditing]);
  const started = stored.answer?.started ?? undefined;
  const first = deps.recording ? (actions.bounds()?.first ?? started) : started;
  const go = (t0: number, t1: number | undefined): void => {
    if (t1 !== undefined) actions.select(t0 - MARGIN_SHARE * (t1 - t0), t1 + MARGIN_SHARE * (t1 - t0));
    else if (!deps.jump) actions.centreAt(t0);
    deps.jump?.({ t0, t1: t1 ?? t0 });
    actions.pinInView(t0);
    if (t1 !== undefined) actions.pinMeasure(t1);
  };
  const insert = (): void => {
    const area = field.current;
    const a = actions.cursorTime() ?? actions.rightEdge();
    const b = cursor.peek()?.kind === "pinned" ? measure.peek() : undefined;
    if (area === null) return;
    const span = Math.abs((actions.bounds()?.last ?? a) - (first ?? a));
    const { selectionStart: at, selectionEnd: to, value } = area;
    area.setRangeText(`${at > 0 && !/\s$/.test(value.slice(0, at)) ? " " : ""}${timeText(a, b, span)} `, at, to, "end");
    area.focus();
  };
  const save = async (): Promise<void> => {
    const notes = field.current?.value ?? "";
    const change = recordingsApi.edit(id, { notes, notes_before: edited.peek()?.base ?? "" });
    if (await stored.send(change)) edited.value = theirs.value = undefined;
    const outcome = await change;
    if (outcome.ok || outcome.problem.kind !== CHANGED) return;
    const now = await read(); // what is saved next replaces the text that is shown below
    theirs.value = now?.ok ? now.value.notes : "";
    edited.value = { begun: edited.peek()?.begun ?? "", base: theirs.value };
  };
  const cancel = (): void => {
    edited.value = theirs.value = undefined;
    cancelled.value++; // changes by other users were not checked
  };
  if (edited.value === undefined) {
    return (
      <div class="notes-panel text-sm">
        <Answered of={stored} waiting={<p class="foot-note dim" aria-busy="true" />}>
          {({ notes }) => (
            <>
              <p class="notes-text">
                {notes === "" && <span class="dim">{TEXT.empty}</span>}
                {piecesOf(notes, first ?? 0).map(({ text, t0, t1 }, k) =>
                  t0 === undefined ? (
                    text
                  ) : (
                    <button type="button" class="notes-time" key={k} onClick={() => go(t0, t1)}>
                      {text}
                    </button>
                  ),
                )}
              </p>
              <Button
                changes
                look="small edge"
                words={notes === "" ? TEXT.write : TEXT.edit}
                onClick={() => (edited.value = { begun: notes, base: notes })}
              />
            </>
          )}
        </Answered>
      </div>
    );
  }
  return (
    <form
      class="notes-panel text-sm"
      onSubmit={(event) => {
        event.preventDefault();
        void save();
      }}
      onKeyDown={(event) => {
        if (event.key === "Escape") cancel();
        if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) void save();
      }}
    >
      <textarea
        ref={field}
        class="notes-field"
        aria-label={TEXT.label}
        placeholder={TEXT.placeholder}
        maxLength={20_000}
        rows={6}
        defaultValue={edited.value.begun}
      />
      {stored.problem && <ProblemNote problem={stored.problem} />}
      {theirs.value !== undefined && (
        <>
          <p class="dim">{TEXT.changed}</p>
          <p class="notes-text notes-theirs">{theirs.value || TEXT.empty}</p>
        </>
      )}
      <div class="notes-foot control-row">
        <Button
          look="small edge"
          words={measure.value === undefined ? TEXT.insertTime : TEXT.insertRange}
          title={TEXT.insertHint}
          onClick={insert}
        />
        <span class="grow" />
        <Button look="small" words={TEXT.cancel} onClick={cancel} />
        <Button changes type="submit" look="small main" words={TEXT.save} />
      </div>
    </form>
  );
}

/*
 * Times in a text: `[14:32:18.500]`, a range `[14:32:18 – 14:32:20.5]`, with the day `[2026-11-21 14:32:18]` where a recording lasts
 * longer than one. In UTC, as everywhere on the page. Pure; server/extensions/evidence/document.py reads the same.
 */

interface Piece {
  readonly text: string;
  /** Unix s; a moment has no t1. */
  readonly t0?: number;
  readonly t1?: number;
}

const CLOCK = String.raw`(?:(\d{4}-\d\d-\d\d) )?(\d\d):(\d\d):(\d\d(?:\.\d{1,7})?)`;
const TIMES = new RegExp(String.raw`\[${CLOCK}(?:\s*[–-]\s*${CLOCK})?\]`, "g");
const DAY_S = 86_400;

/** The moment of a clock; without a day the first one from `from` on. */
function momentOf([day, hours, minutes, seconds]: readonly (string | undefined)[], from: number): number {
  const time = 3600 * Number(hours) + 60 * Number(minutes) + Number(seconds);
  if (day !== undefined) return Date.parse(`${day}T00:00:00Z`) / 1000 + time;
  const midnight = Math.floor(from / DAY_S) * DAY_S;
  return midnight + time + (midnight + time < from ? DAY_S : 0);
}

/** The text in pieces; `first` is the beginning of the recording, unix s. */
export function piecesOf(text: string, first: number): readonly Piece[] {
  const pieces: Piece[] = [];
  let at = 0;
  for (const found of text.matchAll(TIMES)) {
    // a time without its fraction may lie just before the beginning
    const t0 = momentOf(found.slice(1, 5), Math.floor(first));
    const t1 = found[6] === undefined ? undefined : momentOf(found.slice(5, 9), t0);
    if (found.index > at) pieces.push({ text: text.slice(at, found.index) });
    pieces.push({ text: found[0].slice(1, -1), t0, ...(t1 === undefined ? {} : { t1 }) });
    at = found.index + found[0].length;
  }
  if (at < text.length) pieces.push({ text: text.slice(at) });
  return pieces;
}

/** A moment or a range as text; with the day where `span` is longer than one. */
export function timeText(t0: number, t1: number | undefined, span: number): string {
  const word = (t: number): string =>
    span < DAY_S ? clock(t, 3) : `${new Date(t * 1000).toISOString().slice(0, 10)} ${clock(t, 3)}`;
  return t1 === undefined ? `[${word(t0)}]` : `[${word(Math.min(t0, t1))} – ${word(Math.max(t0, t1))}]`;
}
