/** Asks what evidence is to show, and makes it as a job of the server. */
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import type { ViewState } from "../../data/view-state";
import type { FigureSource } from "../../measure/figure-source";
import { recordingsApi } from "../../recordings/api";
import { Button } from "../../ui/controls/button";
import { Segmented } from "../../ui/controls/choices";
import { Dialog } from "../../ui/controls/dialog";
import type { HttpProblem } from "../../requests/http";
import { ProblemNote } from "../../requests/problem-note";
import type { App } from "../../page/context";
import { evidencePlots } from "./plots";
import { Jobs } from "../../pages/recordings/export-jobs";
import { TEXT } from "./texts";
import "../../pages/recordings/export.css";
import "./dialog.css";

type Part = "view" | "cursors" | "whole";

/** A part of what is on screen; null: from the beginning, or to the end. */
export interface EvidenceRange {
  readonly t0: number | null;
  readonly t1: number | null;
}

interface Props {
  readonly app: App;
  readonly title: string;
  readonly viewState: ViewState;
  readonly source: FigureSource;
  readonly wholeName: string;
  /** The recording with that range; undefined when it failed, and a problem was shown. */
  readonly recordingOf: (range: EvidenceRange) => Promise<string | undefined>;
  readonly problem?: HttpProblem | undefined;
  readonly children?: ComponentChildren;
  readonly onClose: () => void;
}

export function EvidenceDialog(props: Props) {
  const { app, title, viewState, source, wholeName, recordingOf, problem, children, onClose } = props;
  const { view, cursor, measure, actions } = viewState;
  const part = useSignal<Part>("view");
  const leavesOut = useSignal(false);
  const busy = useSignal(false);
  const refused = useSignal<HttpProblem | undefined>(undefined);
  const made = useSignal<string | undefined>(undefined);
  // live, the view goes on while the dialog is open: what was on screen when it was opened is meant
  const now = useSignal(takeView()).value;
  function takeView() {
    const t1 = actions.rightEdge();
    const a = cursor.peek()?.kind === "pinned" ? actions.cursorTime() : undefined;
    return {
      view: { t0: t1 - view.peek().span, t1 },
      a: a ?? null,
      b: (a === undefined ? undefined : measure.peek()) ?? null,
      base: view.peek().timeBase,
      plots: evidencePlots(viewState, source),
    };
  }
  const { a, b, plots } = now;
  const range: EvidenceRange =
    part.value === "view"
      ? now.view
      : part.value === "cursors" && a !== null && b !== null
        ? { t0: Math.min(a, b), t1: Math.max(a, b) }
        : { t0: null, t1: null };
  const make = async (): Promise<void> => {
    busy.value = true;
    const recording = await recordingOf(range);
    if (recording !== undefined) {
      const outcome = await recordingsApi.evidence(recording, {
        ...range,
        base: now.base,
        plots: plots.plots,
        cursor_a: a,
        cursor_b: b,
        with_position: !leavesOut.value,
      });
      refused.value = outcome.ok ? undefined : outcome.problem;
      const { exports } = app.store;
      if (outcome.ok && !exports.peek().some(({ id }) => id === outcome.value.id))
        exports.value = [...exports.peek(), outcome.value];
      made.value = recording;
    }
    busy.value = false;
  };
  const shown = problem ?? refused.value;
  const names = { view: TEXT.inView, cursors: TEXT.betweenCursors, whole: wholeName };
  const parts: readonly Part[] = b === null ? ["view", "whole"] : ["view", "cursors", "whole"];
  return (
    <Dialog title={TEXT.title(title)} onClose={onClose}>
      <div class="export evidence">
        <Segmented
          label={TEXT.part}
          class="full-width"
          value={part.value}
          options={parts.map((one) => [one, names[one]])}
          onChoose={(one) => (part.value = one)}
        />
        <p class="dim">{TEXT.what}</p>
        {children}
        <label class="leave-out">
          <input
            type="checkbox"
            checked={leavesOut.value}
            onChange={(event) => (leavesOut.value = event.currentTarget.checked)}
          />
          <b>{TEXT.leaveOut}</b>
          <small>{TEXT.leaveOutHint}</small>
        </label>
        {plots.without.length > 0 && <p class="dim">{TEXT.without(plots.without.join(", "))}</p>}
        {shown && <ProblemNote problem={shown} />}
        <Button
          changes
          look="main start-export"
          icon="paper"
          words={busy.value ? TEXT.making : TEXT.make}
          disabled={busy.value}
          onClick={() => void make()}
        />
        {(made.value ?? source.id) !== "" && <Jobs app={app} recording={made.value ?? source.id} />}
      </div>
    </Dialog>
  );
}
